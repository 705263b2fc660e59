# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find the definition of a topic that a damaged file has lost in the other files of its bag."""

from __future__ import annotations

import mmap
from typing import TYPE_CHECKING

from valve_twin.io.salvage.tail import Trust, read_tail

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from valve_twin.io.mcap.format import Channel, Schema
    from valve_twin.io.mcap.summary import Summary


def definitions_beside(
    path: Path, wanted: set[int], known: Mapping[int, Channel]
) -> tuple[dict[int, Channel], dict[int, Schema]]:
    """Return topics and schemas by number from a file that numbers all known topics alike.

    Parameters
    ----------
    path : Path
        The damaged file.
    wanted : set of int
        Numbers of the topics that it does not define any more.
    known : mapping
        Topics that it still defines.

    Returns
    -------
    dict, dict
        Empty where no sound file of the folder has them all.
    """
    for other in sorted(path.parent.glob("*.mcap")):
        summary = None if other == path else _verified(other)
        if summary is None or not wanted <= set(summary.channels):
            continue
        shared = [i for i in known if i in summary.channels]
        if any(summary.channels[i].topic != known[i].topic for i in shared):
            continue
        channels = {i: summary.channels[i] for i in wanted}
        numbers = {c.schema_id for c in channels.values()}
        return channels, {i: s for i, s in summary.schemas.items() if i in numbers}
    return {}, {}


def _verified(path: Path) -> Summary | None:
    try:
        with (
            path.open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            tail = read_tail(data)
    except (OSError, ValueError):
        return None
    return tail.summary if tail.trust is Trust.VERIFIED else None
