# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep in memory what the write-ahead log holds, and notice when the log lost it.

What was committed stands in the log alone until it is taken into the database, every 4 MB. Where
somebody truncates the log meanwhile, SQLite does not notice: it writes on behind the hole, and all
of the log is lost with the process. The copy is compared in size, header and last frame with each
transaction. What differs is only a doubt: others write, and begin the log anew, at any time. A
loss it is where the log lacks what its index says, while the index tells of the same log before
and after it was read. Missing frames are written back while nobody else can write, and only if
they make up all that the index says: its check sum is over every byte of every frame.
"""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING

from valve_twin.io.history.wal.frames import (
    FRAME_B,
    HEADER_B,
    Header,
    Index,
    Sum,
    read_frame,
    read_header,
    read_index,
)
from valve_twin.io.history.wal.hold import nobody_writes

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_B = 32 * 2**20
"""Of a longer log, which a reader that does not end keeps from being taken in, no more is kept."""

_TRIES = 20
"""How often a log is read that is begun anew meanwhile [1]."""


class LogCopy:
    """What the log of an open database holds.

    Parameters
    ----------
    path : str
        The log, NAME-wal, which is there.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)  # SQLite locks the other two alone
        self._turn = threading.Lock()
        self._doubted = False  # looks whole again where the last transaction alone is missing
        self._clear()

    def close(self) -> None:
        """Give the file back."""
        with self._turn:
            file, self._file = self._file, -1
            if file >= 0:
                os.close(file)

    @property
    def content(self) -> bytes:
        """The log up to the last transaction that was seen in it."""
        with self._turn:
            return bytes(self._content)

    def is_whole(self, *, grown: bool = False) -> bool:
        """Take in what was added; return whether all that was there is there.

        Parameters
        ----------
        grown : bool
            Whether a transaction was written since.
        """
        with self._turn:
            if self._file < 0:
                return True
            before = len(self._content)
            follows = self._follows()
            grew = len(self._content) > before or (self._is_full and self._reaches())
            self._doubted = self._doubted or not follows or (grown and not grew)
            if self._doubted:
                self._doubted = not self._settled(self._is_as_said)
            return not self._doubted

    def restore(self) -> bool:
        """Write back what is missing, on the disk on return; False where that is not certain.

        Raises
        ------
        OSError
            If it cannot be written, or others do not stop writing.
        """
        with nobody_writes(self._path), self._turn:
            index = read_index(self._path)
            if index is None or self._file < 0:
                return False
            missing = self._missing(index)
            if missing is None:
                return False
            for at, data in missing:
                _write(self._file, data, at)
            os.fsync(self._file)
            return self._is_as_said(index)

    def holds_pages(self, size_b: Callable[[], int]) -> bool:
        """Return whether all pages that a shorter database lacks are still to come from the log.

        Parameters
        ----------
        size_b : callable
            Returns the size of the database [B].
        """
        with self._turn:
            return self._file < 0 or self._settled(lambda index: self._fills_up(index, size_b()))

    def reaches_what_was_taken_in(self) -> bool:
        """Return whether no page of the database is newer than what is kept."""
        with self._turn:
            index = read_index(self._path)
            if index is None or self._header is None or self._header.salts != index.salts:
                return index is None or index.taken_in == 0
            return len(self._content) >= HEADER_B + index.taken_in * self._header.frame_b

    def _clear(self) -> None:
        self._header: Header | None = None
        self._content = bytearray()
        self._last: Sum = (0, 0)
        self._is_full = False

    def _settled(self, is_true: Callable[[Index], bool]) -> bool:
        """Return what is true of the log in force; True where nobody can tell."""
        for _ in range(_TRIES):
            index = read_index(self._path)
            if index is None or is_true(index):
                return True
            after = read_index(self._path)
            if after is not None and index.tells_of_the_log_of(after):
                return False
        return True

    def _reaches(self) -> bool:
        """Return whether a log that is not kept to its end is as long as its index says."""
        index, size_b = read_index(self._path), os.fstat(self._file).st_size
        return index is None or size_b >= HEADER_B + index.frames * (FRAME_B + index.page_b)

    def _follows(self) -> bool:
        """Take in what was added to what is kept; return whether that still stands there."""
        head = os.pread(self._file, HEADER_B, 0)
        if self._header is None or head != self._content[:HEADER_B]:
            header = read_header(head)
            if header is None:
                return self._header is None
            self._begin(header, head)  # anew, once all of it was taken into the database
        elif len(self._content) > HEADER_B:
            size = self._header.frame_b
            if os.pread(self._file, size, len(self._content) - size) != self._content[-size:]:
                return False
        self._take_in()
        return True

    def _begin(self, header: Header, head: bytes) -> None:
        self._clear()
        self._header, self._content, self._last = header, bytearray(head), header.check_sum

    def _take_in(self) -> None:
        """Take in whole transactions; what another process is writing right now comes later."""
        assert self._header is not None
        size, at, last = self._header.frame_b, len(self._content), self._last
        found = bytearray()
        while not self._is_full:
            data = os.pread(self._file, size, at + len(found))
            frame = read_frame(self._header, data, last)
            if frame is None:
                break
            found += data
            last = frame.check_sum
            if frame.commits:
                self._content += found
                self._last = last
                at, found = len(self._content), bytearray()
            self._is_full = at + len(found) >= MOST_B

    def _is_as_said(self, index: Index) -> bool:
        """Read the log anew; take it in if it holds what is in force; else nothing is changed."""
        if index.frames == 0:  # all was taken into the database
            self._clear()
            return True
        head = os.pread(self._file, HEADER_B, 0)
        header = read_header(head)
        if header is None or header.salts != index.salts:
            return False
        last, size = header.check_sum, header.frame_b
        for number in range(index.frames):
            frame = read_frame(header, os.pread(self._file, size, HEADER_B + number * size), last)
            if frame is None:
                return False
            last = frame.check_sum
        if last != index.check_sum:
            return False
        self._begin(header, head)
        self._take_in()
        return True

    def _missing(self, index: Index) -> list[tuple[int, bytes]] | None:
        """Return place and bytes of all that the log lacks; None if the copy has it not either."""
        if index.frames == 0:
            return []
        if self._header is None or self._header.salts != index.salts:
            return None
        head = bytes(self._content[:HEADER_B])
        found = [] if os.pread(self._file, HEADER_B, 0) == head else [(0, head)]
        last, size = self._header.check_sum, self._header.frame_b
        for at in range(HEADER_B, HEADER_B + index.frames * size, size):
            frame = read_frame(self._header, os.pread(self._file, size, at), last)
            if frame is None:
                data = bytes(self._content[at : at + size])
                frame = read_frame(self._header, data, last)
                if frame is None:
                    return None
                found.append((at, data))
            last = frame.check_sum
        return found if last == index.check_sum else None

    def _fills_up(self, index: Index, size_b: int) -> bool:
        """Return whether pages beyond a size stand in frames that the database did not get yet."""
        if not size_b or not index.pages or not index.page_b:
            return False
        lacking = set(range(size_b // index.page_b + 1, index.pages + 1))
        for number in range(index.taken_in, index.frames):
            if not lacking:
                break
            at = HEADER_B + number * (index.page_b + FRAME_B)
            lacking.discard(int.from_bytes(os.pread(self._file, 4, at), "big"))
        return not lacking


def _write(file: int, data: bytes, at: int) -> None:
    """Write all of it: a full disk takes a part and refuses the rest."""
    done = 0
    while done < len(data):
        done += os.pwrite(file, memoryview(data)[done:], at + done)
