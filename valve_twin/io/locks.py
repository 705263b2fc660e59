# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Locks on parts of a file, those of Linux that belong to an open file and not to a process."""

from __future__ import annotations

import os
import struct

_LOCK = struct.Struct("hhqqi4x")
"""The system's struct flock: type, whence, start, length, process."""


def lock_part(
    file: int,
    start: int,
    length: int,
    *,
    wait: bool = False,
    free: bool = False,
    shared: bool = False,
) -> None:
    """Lock a part of the file for this open file alone, not for the process as a whole.

    Parameters
    ----------
    file : int
        The open file.
    start, length : int
        Which part [B].
    wait : bool
        Until others have freed it; else refuse.
    free : bool
        Free it instead.
    shared : bool
        Keep others from locking it alone; it may be locked so by several.

    Raises
    ------
    OSError
        If others have it.
    """
    import fcntl

    kind = fcntl.F_UNLCK if free else fcntl.F_RDLCK if shared else fcntl.F_WRLCK
    command = fcntl.F_OFD_SETLKW if wait else fcntl.F_OFD_SETLK
    fcntl.fcntl(file, command, _LOCK.pack(kind, os.SEEK_SET, start, length, 0))


def others_lock(file: int, start: int) -> bool:
    """Return whether another process has locked a byte, as SQLite does."""
    import fcntl

    asked = _LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, start, 1, 0)
    kind, *_ = _LOCK.unpack(fcntl.fcntl(file, fcntl.F_GETLK, asked))
    return bool(kind != fcntl.F_UNLCK)
