# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Watch the files of an open SQLite database: whether they are what was opened, and whole."""

from __future__ import annotations

import gc
import logging
import math
import os
import sqlite3
import time
from contextlib import suppress
from enum import Enum
from typing import TYPE_CHECKING

from valve_twin.io.errors import StoreError
from valve_twin.io.history.wal.copy import LogCopy
from valve_twin.io.history.wal.index import IndexWatch, State

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


_LOGGER = logging.getLogger("valve_twin")


class Trouble(Enum):
    """What can happen to the file under an open history."""

    DELETED = "the file was deleted while in use"
    REPLACED = "the file was replaced while in use"
    LOG_DELETED = "its write-ahead log was deleted while in use"
    CUT = "the file was truncated while in use"
    LOG_CUT = "its write-ahead log was truncated while in use"
    INDEX_CUT = "its index (-shm) was truncated while in use"
    INDEX_LOST = "its index (-shm) was deleted or replaced while in use"


_OF_INDEX = {State.SOUND: None, State.CUT: Trouble.INDEX_CUT, State.LOST: Trouble.INDEX_LOST}


class FileWatch:
    """What the files of a database were when it was opened.

    Parameters
    ----------
    file : Path
        The database.
    driver : callable
        Returns SQLite's connection that stays open.

    Attributes
    ----------
    is_known : bool
        Whether the file was seen.
    log_copy : LogCopy or None
        What its log holds, from `begin` on.
    index : IndexWatch
        The index of the log.
    """

    def __init__(self, file: Path, driver: Callable[[], sqlite3.Connection]) -> None:
        self._file, self._driver = file, driver
        self._log = f"{file}-wal"
        self._identity: tuple[int, int] | None = None
        self._log_identity: tuple[int, int] | None = None
        self._size_b = 0
        self.log_copy: LogCopy | None = None
        self._since_s = math.inf
        self.index = IndexWatch(self._log)
        self._frozen: tuple[object, ...] | None = None
        self._reads_only = False

    @property
    def is_known(self) -> bool:
        """Whether the file was seen."""
        return self._identity is not None

    def open_mode(self, *, read_only: bool) -> str:
        """Return how SQLite is to open the file, as its URI takes it.

        Parameters
        ----------
        read_only : bool
            Whether nothing is to be written.
        """
        self._reads_only = read_only
        if not read_only:
            return "rw" if self.is_known else "rwc"
        found = self._seen()
        if _can_write(self._file.absolute().parent) or found[-1]:
            return "ro"
        # read-only media: the lock file of WAL cannot be made there and is not needed
        self._frozen = found
        return "ro&immutable=1"

    def thaw(self) -> bool:
        """Return whether a file that was opened as one that nobody writes was written since."""
        with suppress(OSError):
            if self._frozen is not None and self._frozen != self._seen():
                self._frozen = None
                return True
        return False

    def adopt_index(self) -> None:
        """Watch the index, which SQLite has open now unless nobody writes the file.

        Of who only reads, the log, too: while one that was deleted is held, there can be no other.
        """
        if self._frozen is not None:
            return
        self.index.adopt()
        if self._reads_only and self._log_identity is None:
            self._log_identity = _identity(_status(self._log))

    def begin(self) -> None:
        """Watch the log, too, which is there from now on; one that was watched is let go."""
        if self.log_copy is not None:
            self.log_copy.close()
        self._log_identity = _identity(_status(self._log))
        self.log_copy = LogCopy(self._log)
        self.trouble()

    def close(self) -> None:
        """Let go of the log, before SQLite takes it in with whatever it lacks."""
        if self.log_copy is not None:
            with suppress(OSError):
                if (
                    self.log_is_own()
                    and self._index_trouble() is None
                    and not self.log_copy.is_whole()
                ):
                    self.log_copy.restore()
            self.log_copy.close()

    def trouble(self, *, grown: bool = False) -> Trouble | None:
        """Return what happened to the files: commits would be lost.

        Parameters
        ----------
        grown : bool
            Whether something was just written, so that the log must have grown.
        """
        status = _status(self._file)
        found = _identity(status)
        if self._identity is None:
            self._identity = found
        if status is None:
            return Trouble.DELETED
        if found != self._identity:
            return Trouble.REPLACED
        if self._log_identity is not None and not self.log_is_own():
            return Trouble.LOG_DELETED
        trouble = self._index_trouble()
        if trouble is not None or self.log_copy is None:
            return trouble
        if self._is_cut(status.st_size):
            return Trouble.CUT
        if not self.log_copy.is_whole(grown=grown):
            self._since_s = min(self._since_s, time.monotonic())
            return Trouble.LOG_CUT
        self._since_s = math.inf
        return None

    def index_trouble(self) -> Trouble | None:
        """Return what happened to the index of the log, while file and log are those opened."""
        with suppress(OSError):  # nobody can tell: what is open can still be read
            is_own = not self.is_known or _identity(_status(self._file)) == self._identity
            if is_own and (self._log_identity is None or self.log_is_own()):
                return self._index_trouble()
        return None

    def mend_index(self, where: str, let_go: Callable[[], None]) -> None:
        """Make the index usable again, before SQLite looks at it.

        Parameters
        ----------
        where : str
            The database, for messages.
        let_go : callable
            Gives back all connections to it.

        Raises
        ------
        StoreError
            If another part of this process uses the one that was deleted.
        OSError
            If others do not stop using it.
        """
        trouble = self.index_trouble()
        if trouble is None:
            return
        if trouble is Trouble.INDEX_CUT:
            self.index.restore()
        else:
            let_go()
            if self.index.is_used():
                gc.collect()  # what a thread gave back to a pool that is no more
            if self.index.is_used():
                msg = (
                    f"{where}: {trouble.value}, and another part of this process uses the old one"
                    " still: tried again"
                )
                raise StoreError(msg)
            self.index.forget()
        _LOGGER.warning("%s: %s: SQLite made it anew from the log", where, trouble.value)

    def _index_trouble(self) -> Trouble | None:
        return _OF_INDEX[self.index.state()]

    def troubled_s(self) -> float:
        """Return for how long the log has been cut [s]; long ago where it is not."""
        return time.monotonic() - self._since_s if self._since_s < math.inf else math.inf

    def log_is_own(self) -> bool:
        """Return whether the write-ahead log under its name is the one that was opened."""
        own = self._log_identity
        return own is not None and own == _identity(_status(self._log))

    def _seen(self) -> tuple[object, ...]:
        """Return what changes when the file is written; last whether it has a log."""
        status = _status(self._file)
        size = None if status is None else (status.st_size, status.st_mtime_ns)
        return _identity(status), size, _status(self._log) is not None

    def _is_cut(self, size_b: int) -> bool:
        """Return whether the file lost pages; a vacuumed one has those that it should."""
        if size_b >= self._size_b:
            self._size_b = size_b
            return False
        with suppress(sqlite3.Error):
            pages, page_b = (
                self._driver().execute(f"PRAGMA {what}").fetchone()[0]
                for what in ("page_count", "page_size")
            )
            if size_b >= pages * page_b > 0 or self._log_fills_up():
                self._size_b = size_b
        return size_b < self._size_b

    def _log_fills_up(self) -> bool:
        """Return whether what a vacuumed file lacks was written since, and is in the log yet."""
        assert self.log_copy is not None
        return self.log_copy.holds_pages(lambda: self._file.stat().st_size)


def _status(path: Path | str) -> os.stat_result | None:
    """Return what the kernel says of a file, None if there is none."""
    try:
        return os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _can_write(folder: Path) -> bool:
    return os.access(folder, os.W_OK, effective_ids=os.access in os.supports_effective_ids)


def _identity(status: os.stat_result | None) -> tuple[int, int] | None:
    """Return what tells a file from another one under the same name, None if there is none."""
    return None if status is None else (status.st_dev, status.st_ino)
