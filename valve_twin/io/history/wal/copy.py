# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep in memory what the write-ahead log holds, and notice when the log lost it.

What was committed stands in the log alone until it is taken into the database, every 4 MB. Where
somebody truncates the log meanwhile, SQLite does not notice: it writes on behind the hole, and all
of the log is lost with the process. The copy is compared in size, header and last frame with each
transaction, and written back byte for byte where something is missing.
"""

from __future__ import annotations

import os
import threading
from contextlib import suppress

from valve_twin.io.history.wal.frames import (
    HEADER_B,
    Header,
    Sum,
    read_frame,
    read_header,
    read_index,
)

MOST_B = 32 * 2**20
"""A longer log, which a reader that does not end keeps from being taken in, is not kept [B]."""


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
            follows = self._follows() and (len(self._content) > before or not grown)
            self._doubted = self._doubted or not follows
            if self._doubted:
                self._doubted = not self._is_as_its_index_says()
            return not self._doubted

    def restore(self) -> bool:
        """Write back what is missing, on the disk on return; False where more than that is."""
        with self._turn:
            index = read_index(self._path)
            if index is None or self._file < 0:
                return False
            if self._header is not None and index.salts == self._header.salts and index.frames:
                end = HEADER_B + index.frames * self._header.frame_b
                os.pwrite(self._file, memoryview(self._content)[:end], 0)
                os.fsync(self._file)
            return self._is_as_its_index_says()

    def _clear(self) -> None:
        self._header: Header | None = None
        self._content = bytearray()
        self._last: Sum = (0, 0)

    def _follows(self) -> bool:
        """Take in what was added to what is kept; return whether that still stands there."""
        head = os.pread(self._file, HEADER_B, 0)
        if self._header is None or head != self._content[:HEADER_B]:
            header = read_header(head)
            if header is None:
                return self._header is None
            self._clear()  # it begins anew once all of it was taken into the database
            self._header, self._content = header, bytearray(head)
            self._last = header.check_sum
        elif len(self._content) > HEADER_B:
            size = self._header.frame_b
            if os.pread(self._file, size, len(self._content) - size) != self._content[-size:]:
                return False
        return os.fstat(self._file).st_size >= len(self._content) and self._take_in()

    def _take_in(self) -> bool:
        """Take in whole transactions; what another process is writing right now comes later."""
        assert self._header is not None
        size, at = self._header.frame_b, len(self._content)
        found, last = bytearray(), self._last
        while at + len(found) < MOST_B:
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
        return True

    def _is_as_its_index_says(self) -> bool:
        """Read the log anew; return whether it holds what is in force; else nothing is changed."""
        kept = self._header, self._content, self._last
        index = read_index(self._path)
        if index is None:
            return True  # nobody can tell
        self._clear()
        if index.frames == 0:  # all was taken into the database
            return True
        with suppress(OSError):
            if self._follows() and self._header is not None:
                end = HEADER_B + index.frames * self._header.frame_b
                if self._header.salts == index.salts and len(self._content) >= min(end, MOST_B):
                    return True
        self._header, self._content, self._last = kept
        return False
