# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A file in memory as it stands on the disk, which others may cut or change meanwhile."""

from __future__ import annotations

import mmap
import os
from contextlib import suppress
from typing import TYPE_CHECKING

from valve_twin.io.errors import BagError
from valve_twin.io.mcap.checksum import crc32
from valve_twin.io.mcap.format import MAGIC

if TYPE_CHECKING:
    from pathlib import Path

_FOREIGN = {
    b"SQLite format 3": "a SQLite bag; convert it to MCAP with 'ros2 bag convert'",
    b"#ROSBAG V": "a ROS 1 bag; convert it to a ROS 2 MCAP bag with 'rosbags-convert'",
    b"\x28\xb5\x2f\xfd": "compressed as a whole file; unpack it with 'zstd -d'",
}

STRIDE = 1 << 16
"""Bytes that may be looked into before it is checked again that the file is whole [B]."""

_KNOWN_BY = 1 << 12
"""Bytes at either end of a file by which it is known again [B]."""


class MappedFile:
    """One open file, `data` is all of it.

    Parameters
    ----------
    path : path
        The file.

    Raises
    ------
    BagError
        If it cannot be opened or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.data, self._status = _open(path)
        self._ends = self._read_ends()

    def check_whole(self) -> None:
        """Refuse to look into a file of which a part is gone: that would end the process (SIGBUS).

        Raises
        ------
        BagError
            If it was cut since it was opened.
        """
        if self.data.size() < len(self.data):
            raise changed(self._path)

    def check_same(self) -> None:
        """Refuse a file that is another one now, or no more there; one that only grew is the same.

        Raises
        ------
        BagError
            If it was cut, changed, replaced or deleted since it was opened.
        """
        self.check_whole()
        with suppress(OSError):
            is_own = os.path.samestat(self._status, os.stat(self._path))
            if is_own and self._read_ends() == self._ends:
                return
        raise changed(self._path)

    def _read_ends(self) -> tuple[int, int]:
        return crc32(self.data[:_KNOWN_BY]), crc32(self.data[-_KNOWN_BY:])


def changed(path: str | Path) -> BagError:
    """Return the error that tells of a file, or bag, that is another one than was opened.

    Parameters
    ----------
    path : path
        Its name.
    """
    return BagError(
        f"{path}: was cut, changed, replaced or deleted while it was read; read it anew"
    )


def unreadable(path: str | Path, err: OSError) -> BagError:
    """Return the error that tells what the system said of a file that is to be read.

    Parameters
    ----------
    path : path
        The file, as far as the system does not name it.
    err : OSError
        What it said.
    """
    path = err.filename or path
    if isinstance(err, FileNotFoundError):
        msg = f"{path}: there is no such file; give a bag folder, a metadata.yaml or an .mcap file"
        return BagError(msg)
    msg = f"{path}: cannot be read ({err.strerror}); check the path and its permissions"
    return BagError(msg)


def _open(path: Path) -> tuple[mmap.mmap, os.stat_result]:
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
            if not path.stat().st_size:
                msg = f"{path}: the file is empty; nothing was recorded"
                raise BagError(msg)
            status = os.fstat(stream.fileno())
            data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as err:
        raise unreadable(path, err) from err
    problem = _foreign(head, data)
    if problem:
        data.close()
        msg = f"{path}: {problem}"
        raise BagError(msg)
    return data, status


def _foreign(head: bytes, data: mmap.mmap) -> str:
    for magic, what in _FOREIGN.items():
        if head.startswith(magic):
            return f"is no MCAP file but {what}"
    same = sum(a == b for a, b in zip(head, MAGIC, strict=False))
    if same < min(len(head), len(MAGIC)) - 1 and data[-len(MAGIC) :] != MAGIC:
        return "is no MCAP file; give a bag that a ROS 2 recorder wrote with MCAP storage"
    return ""
