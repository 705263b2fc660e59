# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bytes of a write-ahead log and of its index, as SQLite documents them.

The log is a header of 32 bytes and frames: 24 bytes and one page each. Every frame carries the two
salts of the header and a check sum over all frames up to it, so that a log proves itself. How many
frames are in force says its index, the file `-shm`, which all processes share. See
https://www.sqlite.org/fileformat2.html#walformat and walformat.html.
"""

from __future__ import annotations

import os
import struct
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEADER_B, FRAME_B = 32, 24
"""Header of the log, and of one frame [B]."""

_MAGIC = {0x377F0682: "<u4", 0x377F0683: ">u4"}
_INDEX_HEAD = struct.Struct("=4x4x4xBBHII2I8s")
_INDEX_COPY_B, _INDEX_B = 48, 100

Sum = tuple[int, int]
"""A check sum of SQLite's log."""


@dataclass(frozen=True, slots=True)
class Header:
    """What the header of a log says.

    Attributes
    ----------
    words : str
        Order of bytes in which check sums are made.
    page_b : int
        Size of a page [B].
    salts : bytes
        What tells the frames of this log from those it held before.
    check_sum : tuple of int
        Of the header; that of the first frame goes on from it.
    """

    words: str
    page_b: int
    salts: bytes
    check_sum: Sum

    @property
    def frame_b(self) -> int:
        """Size of a frame with its page [B]."""
        return FRAME_B + self.page_b


class Frame(NamedTuple):
    """What a frame says: whether it ends a transaction, and its check sum."""

    commits: bool
    check_sum: Sum


class Index(NamedTuple):
    """What the index of a log says.

    Attributes
    ----------
    frames, taken_in : int
        Frames in force, and how many of them the database has, too [1].
    salts : bytes
        Of the log.
    check_sum : tuple of int
        Of the last frame.
    pages, page_b : int
        Pages that the database then has [1], and their size [B].
    """

    frames: int
    salts: bytes
    check_sum: Sum
    pages: int
    page_b: int
    taken_in: int

    def tells_of_the_log_of(self, later: Index) -> bool:
        """Return whether the log was not begun anew since: what it held stands there still."""
        return self.salts == later.salts and self.frames <= later.frames


def read_header(data: bytes) -> Header | None:
    """Return what a header says, None if it is none."""
    if len(data) < HEADER_B:
        return None
    magic, _, page_b, _ = struct.unpack_from(">4I", data)
    words = _MAGIC.get(magic)
    if words is None:
        return None
    stated: Sum = struct.unpack_from(">2I", data, 24)
    if add_up(np.frombuffer(data, words, 6), (0, 0)) != stated:
        return None
    return Header(words, 65536 if page_b == 1 else page_b, bytes(data[16:24]), stated)


def read_frame(header: Header, data: bytes, before: Sum) -> Frame | None:
    """Return what a frame says; None if it does not follow a frame with that check sum.

    Parameters
    ----------
    header : Header
        Of its log.
    data : bytes
        The frame with its page, `header.frame_b` long [B].
    before : tuple of int
        The check sum of the frame before, of the header for the first one.
    """
    if len(data) < header.frame_b or data[8:16] != header.salts:
        return None
    stated: Sum = struct.unpack_from(">2I", data, 16)
    found = add_up(np.frombuffer(data, header.words, 2), before)
    words = np.frombuffer(data, header.words, header.page_b // 4, FRAME_B)
    if add_up(words, found) != stated:
        return None
    return Frame(any(data[4:8]), stated)


def add_up(words: NDArray[np.uint32], before: Sum) -> Sum:
    """Return the check sum of an even number of words that follow others.

    SQLite adds word by word, `s0 += a + s1; s1 += b + s0`; both sums are linear in the words.

    Parameters
    ----------
    words : (2 n,) array of uint32
        As the log's header wants them read.
    before : tuple of int
        The check sum before.
    """
    weights, state = _weights(len(words) // 2)
    found = weights @ words.astype(np.uint64) + state @ np.array(before, np.uint64)
    return int(found[0]) & 0xFFFFFFFF, int(found[1]) & 0xFFFFFFFF


@cache
def _weights(pairs: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """Return the weights of the words and of the sums before, modulo 2^32.

    Products of two numbers below 2^32 fit 64 bits, and sums that wrap there are right below.
    """
    step = np.array([[1, 1], [1, 2]], dtype=np.uint64)
    power = np.eye(2, dtype=np.uint64)
    columns = []
    for _ in range(pairs):
        columns.append((power @ np.array([[1, 0], [1, 1]], dtype=np.uint64)) & 0xFFFFFFFF)
        power = (power @ step) & np.uint64(0xFFFFFFFF)
    return np.hstack(columns[::-1]), power


def index_of(log: str) -> str:
    """Return the path of the index of a log, NAME-wal."""
    return f"{log.removesuffix('-wal')}-shm"


def read_index(log: str) -> Index | None:
    """Return what the index of a log says, None where it cannot be read.

    Parameters
    ----------
    log : str
        Path of the log, NAME-wal.
    """
    with suppress(OSError):
        file = keep_open(index_of(log))
        for _ in range(100):  # a writer changes both copies, one after the other
            data = os.pread(file, _INDEX_B, 0)
            first, second = data[:_INDEX_COPY_B], data[_INDEX_COPY_B : 2 * _INDEX_COPY_B]
            if first == second and len(data) == _INDEX_B:
                _, _, page_b, frames, pages, s0, s1, salts = _INDEX_HEAD.unpack_from(first)
                page_b = 65536 if page_b == 1 else page_b
                taken_in = int.from_bytes(data[2 * _INDEX_COPY_B :], sys.byteorder)
                return Index(frames, salts, (s0, s1), pages, page_b, taken_in)
    return None


def keep_open(path: str, flags: int = os.O_RDONLY) -> int:
    """Open a file that SQLite has locked, until it was deleted and SQLite has let go of it.

    To close it before would free the locks that SQLite holds on it in this process (POSIX).

    Parameters
    ----------
    path : str
        The file.
    flags : int
        How to open it, as `os.open` takes it.
    """
    with _turn:
        key = *_inode(os.stat(path)), flags
        if key not in _kept:
            _let_go()
            file = os.open(path, flags | os.O_CLOEXEC)
            key = *_inode(os.fstat(file)), flags  # the path may have been replaced meanwhile
            _kept.setdefault(key, []).append(file)
        return _kept[key][0]


def _let_go() -> None:
    """Close what was deleted and only this has open: each opening of a history makes an index."""
    gone = [key for key, files in _kept.items() if os.fstat(files[0]).st_nlink == 0]
    gone = gone[:-_MOST_GONE]
    if not gone:
        return
    with suppress(FileNotFoundError):
        used = _others()
        for key in gone:
            if key[:2] not in used:
                for file in _kept.pop(key):
                    os.close(file)


def _others() -> set[tuple[int, int]]:
    """Return what is open in this process apart from what is kept."""
    kept = {file for files in _kept.values() for file in files}
    found = set()
    for file in {int(name) for name in os.listdir("/proc/self/fd")} - kept:
        with suppress(OSError):  # another thread has closed it
            found.add(_inode(os.fstat(file)))
    return found


def _inode(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


_MOST_GONE = 8  # the last ones may be in use by another thread at this moment
_kept: dict[tuple[int, int, int], list[int]] = {}
_turn = threading.Lock()
