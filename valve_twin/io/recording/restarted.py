# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A recording that is begun again under its name: NAME, then NAME_002, NAME_003 and so on.

The files of earlier ones count as files of the recording when the oldest are deleted, unless
another process still writes there: a recording holds a lock on its folder. A folder that only has
such a name, as that of valve press_101 beside press, is somebody else's: one's own are marked.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.bags.folder import natural_order
from valve_twin.io.bags.metadata import FILE_NAME
from valve_twin.io.mcap.format import MAGIC, RECORD_HEAD, Op
from valve_twin.io.whole import write_whole

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

MARK = ".valve_twin_recording"
"""File in a folder NAME_002 and so on that holds NAME, then the folders that other bags took."""

_NUMBERED = re.compile(r"(.+)_(\d{3,})")
_SECOND = 2

_LAST_CODE, _LONGEST = 0x0F, 2**24
"""Greatest code of a record that MCAP knows, and longest record without messages that is believed
[B]: anything else is damage, which `recover` may read."""


def next_folder(path: str | Path) -> Path:
    """Return the folder itself, or where there was one already, NAME_ with the next number.

    Parameters
    ----------
    path : path
        Folder of the first recording of this name.
    """
    path = Path(path)
    number = max((number for number, _ in _numbered(path)), default=0)
    if not number and not os.path.lexists(path):
        return path
    number = max(number + 1, _SECOND)
    while os.path.lexists(found := path.with_name(f"{path.name}_{number:03d}")):
        number += 1
    return found


def mark(path: Path, first: Path, foreign: Collection[str] = ()) -> None:
    """Mark a folder as a later recording of a name; nothing where it is the first one.

    Parameters
    ----------
    path : Path
        Folder of the present recording, as `next_folder` gave it.
    first : Path
        That of the first recording of its name.
    foreign : collection of str
        Names of the folders of which other bags took the place; those of earlier marks stay.
    """
    if path.name != first.name:
        names = {*foreign, *_foreign(path.with_name(first.name))}
        write_whole(path / MARK, "\n".join([first.name, *sorted(names)]))


def earlier_files(path: Path, first: Path) -> list[Path]:
    """Return the files of earlier recordings of a name that was given, oldest first.

    Files without any message, as a recorder leaves that is killed at its start, are deleted.

    Parameters
    ----------
    path : Path
        Folder of the present recording, as `next_folder` gave it.
    first : Path
        That of the first recording of its name.
    """
    found = _NUMBERED.fullmatch(path.name)
    if path.name == first.name or found is None or found[1] != first.name:
        return []
    first = path.with_name(first.name)
    folders = [first, *(f for n, f in sorted(_numbered(first)) if n < int(found[2]))]
    files: list[Path] = []
    foreign = _foreign(first)
    for folder in (f for f in folders if f.name not in foreign):
        held = lock(folder)
        if held is None:
            continue
        for file in sorted(folder.glob("*.mcap"), key=natural_order):
            if _has_messages(file):
                files.append(file)
            else:
                delete(file)
        os.close(held)
    return files


def delete(file: Path) -> int:
    """Delete a file of an earlier recording and return its size [B].

    The metadata of its folder, which would name it, go with it, and the folder with its last file.
    """
    with suppress(OSError):
        size = file.stat().st_size
        (file.parent / FILE_NAME).unlink(missing_ok=True)
        file.unlink()
        if not any(file.parent.glob("*.mcap")):
            (file.parent / MARK).unlink(missing_ok=True)
        file.parent.rmdir()
        return size
    return 0


def lock(folder: Path) -> int | None:
    """Hold a folder until the number that is returned is closed; None where another holds it."""
    try:
        import fcntl
    except ImportError:  # not on Windows, where no recorder runs
        return None
    try:
        number = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(number)
        return None
    return number


def _numbered(first: Path) -> Iterator[tuple[int, Path]]:
    for folder in first.parent.glob(f"{first.name}_*"):
        found = _NUMBERED.fullmatch(folder.name)
        if found is not None and found[1] == first.name and _is_of(folder, first.name):
            yield int(found[2]), folder


def _foreign(first: Path) -> set[str]:
    """Return the folders of a name of which other bags took the place."""
    return {name for _, folder in _numbered(first) for name in _marked(folder)[1:]}


def _is_of(folder: Path, name: str) -> bool:
    return _marked(folder)[:1] == [name]


def _marked(folder: Path) -> list[str]:
    """Return what the mark of a folder holds, line by line."""
    try:
        return (folder / MARK).read_text(encoding="utf-8").split("\n")
    except (OSError, ValueError):
        return []


def _has_messages(file: Path) -> bool:
    """Return whether a chunk or message begins in a file; True where damage hides that."""
    try:
        with file.open("rb") as stream:
            stream.seek(len(MAGIC))
            while len(head := stream.read(RECORD_HEAD.size)) == RECORD_HEAD.size:
                code, length = RECORD_HEAD.unpack(head)
                if code in {Op.MESSAGE, Op.CHUNK} or code > _LAST_CODE or length > _LONGEST:
                    return True
                stream.seek(length, os.SEEK_CUR)
    except (OSError, ValueError):
        return True
    return False
