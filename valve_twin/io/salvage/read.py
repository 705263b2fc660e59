# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read whatever is intact of a damaged MCAP file, and say what is not.

The records of the data section are walked one by one. Where one does not fit, the next that fits
is looked for; where the summary survives, it says which chunks lie between. A chunk counts as
intact where its check sum is right. What unpacks of a cut chunk, and everything of a file without
check sums, is handed on only after its messages were found plausible, and marked as unverified.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from valve_twin.io.mcap.mapped import MappedFile
from valve_twin.io.mcap.reader import McapFile, RawMessage, messages
from valve_twin.io.salvage.scan import Scan

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.io.mcap.damage import Salvage

_LOGGER = logging.getLogger("valve_twin")


_CACHE: dict[Path, tuple[tuple[int, int], Salvage]] = {}
_CACHED = 8


def salvage(path: Path) -> Salvage:
    """Read a damaged file once and remember it; say on the log what is lost.

    Raises
    ------
    BagError
        If the file cannot be opened or is no MCAP file.
    """
    state = path.stat()
    key = (state.st_mtime_ns, state.st_size)
    before = known(path)
    if before is not None:
        return before
    found = salvage_file(path)
    for loss in found.losses:
        _LOGGER.warning("%s", loss.line())
    while len(_CACHE) >= _CACHED:
        _CACHE.pop(next(iter(_CACHE)))
    _CACHE[path] = (key, found)
    return found


def known(path: Path) -> Salvage | None:
    """Return what was remembered of a damaged file, None if nothing or it has changed."""
    try:
        state = path.stat()
    except OSError:
        return None
    found = _CACHE.get(path)
    return found[1] if found and found[0] == (state.st_mtime_ns, state.st_size) else None


def forget() -> None:
    """Forget what was remembered of damaged files."""
    _CACHE.clear()


def salvage_file(path: Path) -> Salvage:
    """Read whatever is intact of a file.

    Raises
    ------
    BagError
        If it cannot be opened or is no MCAP file.
    """
    file = MappedFile(path)
    with file.data:
        return Scan(path, file.data, file.check_whole).run()


def salvaged_messages(path: Path, found: Salvage) -> Iterator[tuple[RawMessage, bool]]:
    """Yield every message of a salvaged file in its order, and whether it is verified."""
    channels = set(found.summary.channels)
    file = McapFile(path, salvage=salvage, salvaged=found)
    try:
        for chunk in found.summary.chunks:
            verified = chunk.offset not in found.unverified
            for message in messages(file.chunk(chunk), channels):
                yield message, verified
    finally:
        file.close()
