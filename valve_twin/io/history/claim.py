# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who writes the cycles of a valve, and the last cycle that it told of.

Beside a SQLite history lies a small file `<history>-writers` with one slot a valve. Whoever writes
a valve's cycles holds the lock of its slot; the system takes it back when the process ends, by
whatever death. The slot also says which cycle was last told of, stored or not, so that its number
is not given to another cycle after a restart. It is written past the database: at once, also while
that is locked; what a killed process wrote there stays.

The library filelock would replace `lock_part` alone and want a file a valve: its lock is as safe,
but it says neither who holds it nor which cycle was told of, for which the slots are here.
"""

from __future__ import annotations

import os
import socket
import struct
import sys
import time
import zlib
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError

from valve_twin.core.state import Announced
from valve_twin.io.errors import StoreError
from valve_twin.io.locks import lock_part

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sqlalchemy.engine import Connection

    from valve_twin.io.history.database import Database

_SLOT = struct.Struct("<qqq64s400s")
"""Number and start of the last announced cycle [ns], process id, host, name of the valve."""

_SERVER_KEY = 0x56414C56
"""First half of the keys of claims on a PostgreSQL server ("VALV")."""

LEAVE_S = 0.5
"""How long a writer that ends is waited for [s]."""

_ALL = 1 << 40
"""Place of the lock that guards the file as a whole, beyond all slots."""


class Claim:
    """The right to write one valve's cycles, until it is released or the process ends."""

    announced = Announced()
    """The last cycle that others were told of."""

    def hold(self) -> None:
        """Claim again where the lock was lost; what was announced stays known."""

    def announce(self, cycle: Announced) -> None:
        """Note, before others are told of it, that the number of a cycle is taken."""
        self.announced = cycle

    def release(self) -> None:
        """Let others write the valve."""


class FileClaim(Claim):
    """A claim in the file beside a SQLite history.

    Parameters
    ----------
    path : Path
        The file of all writers of a history; made where it is missing.
    valve : str
        Name of the valve.

    Raises
    ------
    StoreError
        If another writer has it.
    OSError
        If the file cannot be used.
    """

    def __init__(self, path: Path, valve: str) -> None:
        self._path, self._valve = path, valve
        self._file = self._place = -1
        self.hold()

    def hold(self) -> None:
        """Claim in the file that is there now."""
        if self._file >= 0 and _is_open(self._file, self._path):
            return
        _require_locks(self._path)
        file = _open(self._path)
        try:
            place, found = _find(file, self._valve)
            _take(file, place, self._valve, self._path)
        except BaseException:
            os.close(file)
            raise
        self.release()
        self._file, self._place = file, place
        self.announce(max(self.announced, found, key=lambda a: a.start_ns))

    def announce(self, cycle: Announced) -> None:
        """Note, before others are told of it, that the number of a cycle is taken."""
        self.announced = cycle
        if self._file >= 0:
            with suppress(OSError):  # a disk in trouble must not hold up the data
                os.pwrite(self._file, _slot(cycle, self._valve), self._place)

    def release(self) -> None:
        """Let others write the valve."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


class ServerClaim(Claim):
    """A claim that a PostgreSQL server keeps as long as a connection lasts.

    What was announced is not kept over a restart: the numbers go on from the last stored cycle.

    Raises
    ------
    StoreError
        If another writer has it.
    """

    def __init__(self, database: Database, valve: str) -> None:
        self._database, self._valve = database, valve
        self._connection: Connection | None = None
        self.hold()

    def hold(self) -> None:
        """Claim over a connection that lasts; again where the server or the way to it did not.

        A server that was killed knows no claims any more: somebody else may have been faster.
        """
        if self._lasts():
            return
        connection = self._database.engine.connect()
        key = zlib.crc32(self._valve.encode())
        lock = sa.func.pg_try_advisory_lock(_SERVER_KEY, key - (1 << 31))
        if not connection.scalar(sa.select(lock)):
            connection.close()
            msg = (
                f"{self._database.where}: {self._valve} is already written by another twin: stop"
                " that one, or give this one another namespace or another history"
            )
            raise StoreError(msg)
        connection.commit()
        self._connection = connection

    def _lasts(self) -> bool:
        """Return whether the server still answers on the connection that holds the claim."""
        if self._connection is None:
            return False
        try:
            self._connection.execute(sa.select(1))
            self._connection.commit()
        except DBAPIError as err:
            if not err.connection_invalidated:
                raise
            self.release()
            return False
        return True

    def release(self) -> None:
        """Let others write the valve."""
        if self._connection is not None:
            self._connection.invalidate()  # the server gives the lock back with the connection
            self._connection.close()
            self._connection = None


def writers_file(database: Database) -> Path:
    """Return the file of the writers of a SQLite history."""
    assert database.file is not None
    return database.file.with_name(f"{database.file.name}-writers")


def make_claim(database: Database, valve: str) -> Claim:
    """Claim a valve in a history of any kind; see `History.claim`.

    A writer that is just ending is waited for.
    """
    end_s = time.monotonic() + LEAVE_S
    while True:
        try:
            if database.is_sqlite:
                return FileClaim(writers_file(database), valve)
            return ServerClaim(database, valve)
        except StoreError:
            if time.monotonic() > end_s:
                raise
            time.sleep(LEAVE_S / 20.0)


@contextmanager
def only_one(path: Path) -> Iterator[None]:
    """Keep all other writers of a history out of the same block, in any process."""
    _require_locks(path)
    file = _open(path)
    try:
        with _alone(file):
            yield
    finally:
        os.close(file)


def _is_open(file: int, path: Path) -> bool:
    """Return whether an open file is the one of that name."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _open(path: Path) -> int:
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)


def _slot(cycle: Announced, valve: str) -> bytes:
    host, name = socket.gethostname().encode()[:64], valve.encode()
    return _SLOT.pack(cycle.number, cycle.start_ns, os.getpid(), host, name)


def _find(file: int, valve: str) -> tuple[int, Announced]:
    """Return the place of a valve's slot, a new one if it has none, and what stands there."""
    with _alone(file):
        size = os.fstat(file).st_size
        for place in range(0, size - size % _SLOT.size, _SLOT.size):
            number, start_ns, _, _, name = _read(file, place)
            if name == valve:
                return place, Announced(number, start_ns)
        place = size - size % _SLOT.size
        os.pwrite(file, _slot(Announced(), valve), place)
        os.fsync(file)
        return place, Announced()


def _read(file: int, place: int) -> tuple[int, int, int, str, str]:
    number, start_ns, pid, *texts = _SLOT.unpack(os.pread(file, _SLOT.size, place))
    host, name = (text.rstrip(b"\0").decode(errors="replace") for text in texts)
    return number, start_ns, pid, host, name


def _take(file: int, place: int, valve: str, path: Path) -> None:
    try:
        lock_part(file, place, _SLOT.size)
    except (BlockingIOError, PermissionError) as err:
        _, _, pid, host, _ = _read(file, place)
        msg = (
            f"{path}: {valve} is already written by process {pid} on {host}: stop that twin, or"
            " give this one another namespace or another history"
        )
        raise StoreError(msg) from err


@contextmanager
def _alone(file: int) -> Iterator[None]:
    lock_part(file, _ALL, 1, wait=True)
    try:
        yield
    finally:
        lock_part(file, _ALL, 1, free=True)


def _require_locks(path: Path) -> None:
    """Refuse to write where the system has no locks of an open file."""
    if sys.platform != "linux":
        msg = (
            f"{path}: a history in a file is written on Linux only, whose locks tell two writers "
            "apart; it is read anywhere: give the URL of a PostgreSQL database, or write on Linux"
        )
        raise StoreError(msg)
