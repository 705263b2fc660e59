# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep all others from writing a database in use, by the locks that SQLite itself asks for."""

from __future__ import annotations

import errno
import os
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from valve_twin.io.history.wal.frames import index_of, keep_open
from valve_twin.io.locks import lock_part, others_lock

if TYPE_CHECKING:
    from collections.abc import Iterator

WAIT_S = 5.0
"""How long others are waited for [s]."""

_WRITE, _COUNT = 120, 2
"""Where SQLite locks an index for who writes the log, and behind it for who takes it in [B]."""

_LOCKS = 8
"""Locks of an index, from `_WRITE` on: writing, taking in, making anew and reading [B]."""

_OPEN = 128
"""Where each process that has a database open keeps its index locked [B]."""

_turn = threading.RLock()
_held: set[int] = set()


@contextmanager
def nobody_writes(log: str) -> Iterator[None]:
    """Keep everybody, this process too, from writing the log or taking it in.

    Parameters
    ----------
    log : str
        Path of the log, NAME-wal.

    Raises
    ------
    OSError
        If others do not stop, or the index cannot be opened.
    """
    with _turn:
        file = keep_open(index_of(log), os.O_RDWR)
        if file in _held:
            yield
            return
        with _locked(file, _COUNT):
            _held.add(file)
            try:
                yield
            finally:
                _held.discard(file)


@contextmanager
def nobody_uses(log: str) -> Iterator[None]:
    """Keep everybody, this process too, from any transaction, also one that reads.

    Parameters
    ----------
    log : str
        Path of the log, NAME-wal.

    Raises
    ------
    OSError
        If others do not stop, or the index cannot be opened.
    """
    with _turn, _locked(keep_open(index_of(log), os.O_RDWR), _LOCKS):
        yield


def others_have(log: str) -> bool:
    """Return whether another process has the database of a log open, by SQLite's own lock.

    Parameters
    ----------
    log : str
        Path of the log, NAME-wal.
    """
    return os.path.exists(index_of(log)) and others_lock(keep_open(index_of(log)), _OPEN)


@contextmanager
def _locked(file: int, count: int) -> Iterator[None]:
    """Keep so many of SQLite's locks, from `_WRITE` on."""
    _take(file, count)
    try:
        yield
    finally:
        lock_part(file, _WRITE, count, free=True)


def _take(file: int, count: int) -> None:
    """Take the lock, which SQLite's own locks in this process keep from it, too."""
    end_s = time.monotonic() + WAIT_S
    while True:
        try:
            lock_part(file, _WRITE, count)
        except (BlockingIOError, PermissionError):
            if time.monotonic() > end_s:
                text = "others do not stop writing its log"
                raise BlockingIOError(errno.EAGAIN, text) from None
            time.sleep(0.002)
        else:
            return
