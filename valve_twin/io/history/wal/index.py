# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Watch the index of the write-ahead log, which all processes share as memory: the file `-shm`.

SQLite looks at it through a map of the file. Where somebody truncates it, the system kills whoever
looks (SIGBUS); where somebody deletes it, the next process makes another one and neither sees the
locks and frames of the other: they write over each other. All that it says follows from the log.
"""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager, nullcontext, suppress
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.io.history.wal.frames import (
    HEADER_B,
    index_of,
    keep_open,
    read_header,
    read_index,
)
from valve_twin.io.history.wal.hold import nobody_uses
from valve_twin.io.locks import lock_part

if TYPE_CHECKING:
    from collections.abc import Iterator

_HEAD_B = 136
_REGION_B, _FIRST_FRAMES, _FRAMES = 32768, 4062, 4096
"""Bytes of a part of an index, and frames in the first and in each other part [1]."""

_NONE = -1, -1
"""Device and file that no index is."""

_SHARED, _SHARED_B = 0x40000002, 510
"""Where SQLite locks a database that it has open [B]."""


def _is_watched() -> bool:
    """Return whether this system has the locks to mend an index; elsewhere none is written."""
    return sys.platform == "linux"


class State(Enum):
    """What can become of an index."""

    SOUND = "it is the one that was opened"
    CUT = "it is shorter than it was"
    LOST = "it was deleted or replaced"


class IndexWatch:
    """What the index of an open database was.

    Parameters
    ----------
    log : str
        The log, NAME-wal.
    """

    def __init__(self, log: str) -> None:
        self._log, self._path = log, index_of(log)
        self.forget()

    def forget(self) -> None:
        """Know nothing of it: what is there next is the one in use."""
        self._identity: tuple[int, int] | None = None
        self._size_b = self._changed_ns = 0

    def adopt(self) -> None:
        """Take the one that is there for the one in use, where none is known.

        To be called while SQLite has it open: before, it may end with whoever made it. Where the
        one in use was deleted since, it is lost, whatever is there.
        """
        if not _is_watched():
            return
        if self._identity is None and os.path.exists(self._log):
            with suppress(OSError):
                status = os.stat(self._path)
                self._identity, self._size_b = (status.st_dev, status.st_ino), status.st_size
            if self.is_used() and not self._is_mapped(""):
                self._identity = _NONE

    def state(self) -> State:
        """Return what became of it since it was opened; sound where nobody can tell."""
        if self._identity is None:
            return State.SOUND
        try:
            status = os.stat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            return State.LOST
        except OSError:
            return State.SOUND
        if (status.st_dev, status.st_ino) != self._identity:
            return State.LOST
        if status.st_size < self._size_b:
            return State.CUT
        if status.st_ctime_ns != self._changed_ns:  # also where its size is what it was
            self._changed_ns = status.st_ctime_ns
            if self._lacks_frames():
                self._changed_ns = 0
                return State.CUT
        self._size_b = status.st_size
        return State.SOUND

    def heal(self) -> None:
        """Restore one that is too short for what it says, before SQLite opens it.

        SQLite would make it as long as it should be, with what it lacks taken to be there.

        Raises
        ------
        OSError
            As `restore`.
        """
        if not _is_watched():
            return
        with suppress(FileNotFoundError):
            if os.stat(self._path).st_size < self._least_b():
                index = read_index(self._log)
                if index and index.frames and os.stat(self._path).st_size < _size_b(index.frames):
                    self.restore()
            elif self._lacks_frames():
                self.restore()

    def restore(self) -> None:
        """Make a cut one as long as before and empty: SQLite then makes it anew from the log.

        Raises
        ------
        OSError
            If it cannot be written, or others do not stop using it.
        """
        with nobody_uses(self._log):
            file = keep_open(self._path, os.O_RDWR)
            os.pwrite(file, bytes(_HEAD_B), 0)
            os.ftruncate(file, max(self._size_b, self._least_b()))

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Let SQLite close the database without harm: it would take the log in by this index."""
        state = self.state()
        if state is State.CUT:
            with suppress(OSError):
                self.restore()
        database = self._log.removesuffix("-wal")
        lost = state is State.LOST and os.path.exists(database)
        with _held(database) if lost else nullcontext():
            yield

    def is_used(self) -> bool:
        """Return whether another part of this process still uses one that was deleted."""
        return self._is_mapped(" (deleted)")

    def _is_mapped(self, what: str) -> bool:
        name = os.fsencode(f" {os.path.realpath(self._path)}{what}\n")
        with suppress(FileNotFoundError), open("/proc/self/maps", "rb") as maps:
            return name in maps.read()
        return False

    def _lacks_frames(self) -> bool:
        """Return whether it counts frames that it does not lead to.

        So it is where another program met it cut: SQLite makes it as long again, with zeros.
        """
        with suppress(OSError):
            index = read_index(self._log)
            if index is None or not index.frames:
                return False
            held = os.pread(keep_open(self._path), _size_b(index.frames), 0)
            return not _leads_to(held, index.frames) and read_index(self._log) == index
        return False

    def _least_b(self) -> int:
        """Return how long it is at least for as many frames as the log may hold [B]."""
        with suppress(OSError), open(self._log, "rb") as log:
            header = read_header(log.read(HEADER_B))
            if header is not None:
                frames = (os.fstat(log.fileno()).st_size - HEADER_B) // header.frame_b
                return _size_b(frames)
        return _REGION_B


def _size_b(frames: int) -> int:
    return _REGION_B * (1 + -(-max(frames - _FIRST_FRAMES, 0) // _FRAMES))


def _leads_to(held: bytes, frames: int) -> bool:
    """Return whether an index holds the page of each frame, and a place in its table for it."""
    base = 0
    for at in range(0, _size_b(frames), _REGION_B):
        head = 0 if at else _HEAD_B
        count = min(frames - base, _FRAMES if at else _FIRST_FRAMES)
        region = held[at : at + _REGION_B]
        if len(region) < _REGION_B:
            return False
        pages = np.frombuffer(region, np.uint32, count, head)
        table = np.frombuffer(region, np.uint16, offset=_REGION_B // 2)
        if not pages.all() or np.count_nonzero((table > 0) & (table <= count)) != count:
            return False
        base += count
    return True


@contextmanager
def _held(database: str) -> Iterator[None]:
    """Keep this process from being the last to close the database, which would end the log."""
    file = keep_open(database)
    lock_part(file, _SHARED, _SHARED_B, shared=True)
    try:
        yield
    finally:
        lock_part(file, _SHARED, _SHARED_B, free=True)
