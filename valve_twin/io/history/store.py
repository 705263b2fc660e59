# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The history of valves: cycles, estimates and maintenance events, durable once acknowledged.

A stored cycle is a record: it is never changed. Storing the same cycle again does nothing; storing
other content under a number that is taken is refused, because something that was published as
stored would silently become untrue.
"""

from __future__ import annotations

import threading
from collections import deque
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.types import Cycle, Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import Rows, Verification, sound_page, verify
from valve_twin.io.history.claim import make_claim, writers_file
from valve_twin.io.history.database import Database
from valve_twin.io.history.export import (
    BackupRules,
    back_up_sqlite,
    copy_to_sqlite,
    default_backup_path,
    export_files,
    requested_backup_path,
)
from valve_twin.io.history.insert import Insert, check_estimates, is_condensed, is_stored
from valve_twin.io.history.log.counters import put_counters
from valve_twin.io.history.log.events import KEPT
from valve_twin.io.history.log.log import OperationLog
from valve_twin.io.history.remarks import add_event, add_verdict, row_verdict, withdraw_event
from valve_twin.io.history.tables import (
    CYCLE,
    ESTIMATE,
    MAINTENANCE,
    VERDICT,
    CycleRecord,
    cycle_record,
    estimate_row,
    from_row,
    row_estimate,
    to_row,
)
from valve_twin.io.history.valves.marks import Marks, read_marks
from valve_twin.io.history.valves.names import key_of, of_valve, own_key, sound_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sqlalchemy.engine import Connection

    from valve_twin.core.aging.verdict import Verdict
    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.types import Estimate
    from valve_twin.io.history.claim import Claim

__all__ = ["CycleRecord", "CycleTakenError", "DamagedValueError", "History", "cycle_record"]


class CycleTakenError(StoreError):
    """Another cycle is stored under the number; trying again is of no use."""


class DamagedValueError(StoreError):
    """A value is none of its column; what does not need it can still be read."""


class History:
    """Cycles, estimates and maintenance events of any number of valves in one database.

    Several processes may use one database; one at a time may claim a valve to write its cycles.
    Methods may be called from any thread. A SQLite file that is deleted or replaced while in use
    is repaired with the next write (`history_rescue`); `notices` says so.

    Parameters
    ----------
    url : str
        Path of a SQLite file (made where it is missing), sqlite:///file.db, or
        postgresql://user@host/name.
    read_only : bool
        Never write the database; it must exist.
    busy_timeout_s : float
        How long to wait for another program's lock [s].
    software : str
        Version that is recorded with every cycle.
    events_kept : int
        Entries of a valve's event log that are kept [1], see `log.events.add_events`.

    Raises
    ------
    StoreError
        If the database cannot be used: locked, damaged, no database, of another application, of a
        newer version.
    """

    def __init__(
        self,
        url: str | Path,
        *,
        read_only: bool = False,
        busy_timeout_s: float = 5.0,
        software: str = "",
        events_kept: int = KEPT,
    ) -> None:
        self._database = Database(str(url), read_only=read_only, busy_timeout_s=busy_timeout_s)
        self._software = software
        self._valve_ids: dict[str, int] = {}
        self._claims: dict[str, Claim] = {}
        self._repairing = threading.Lock()
        self.notices: deque[str] = deque(maxlen=100)
        self.log = OperationLog(self, events_kept)
        self._insert_cycle = Insert(self._database, CYCLE, skip_taken=True)
        self._insert_estimates = Insert(self._database, ESTIMATE)

    def __enter__(self) -> History:
        """Return the history itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    @property
    def where(self) -> str:
        """File or URL of the database, without a password."""
        return self._database.where

    @property
    def is_remote(self) -> bool:
        """Whether it is kept by a server."""
        return not self._database.is_sqlite

    def close(self) -> None:
        """Give the connections and the claims back; what was stored is stored."""
        for claim in self._claims.values():
            claim.release()
        self._claims.clear()
        self._database.close()

    def snapshot_path(self, valve: str, what: str = "twin") -> Path | None:
        """Return where the state of a valve's twin is kept; None beside no SQLite file."""
        file, name = self._database.file, f"{what}{valve.replace('/', '.')}"
        return None if file is None else file.with_name(f"{file.name}-{name}")

    def claim(self, valve: str) -> Claim:
        """Claim the right to write a valve's cycles, until the history is closed.

        Returns
        -------
        Claim
            Knows the last cycle that was announced; to be told of each before others are.

        Raises
        ------
        StoreError
            If another process, or another history of this one, writes the valve.
        """
        with self._database.errors("claimed"):
            self._claims[valve] = claim = make_claim(self._database, valve)
        return claim

    @property
    def moved(self) -> bool:
        """Whether the file was deleted or replaced since: it is to be opened anew."""
        return self._database.trouble() is not None

    def repair(self) -> None:
        """Make a SQLite file that was deleted or replaced while in use usable again.

        Raises
        ------
        StoreError
            If that cannot be done now.
        """
        if self._database.trouble() is None or self._database.read_only:
            return
        from valve_twin.io.history.rescue import repair

        with self._repairing:
            self._database, note = repair(self._database, writers_file(self._database))
            self._valve_ids.clear()
        if note:
            self.notices.append(note)

    def store(
        self,
        valve: str,
        cycle: CycleRecord | Cycle,
        estimates: Sequence[Estimate] = (),
        counters: Counters | None = None,
    ) -> bool:
        """Store one cycle with all its estimates in one transaction; on the disk on return.

        Parameters
        ----------
        valve : str
            Name of the valve, its namespace.
        cycle : CycleRecord or Cycle
            The cycle, also a refused one.
        estimates : sequence of Estimate
            One for each estimator; empty for a refused cycle.
        counters : Counters, optional
            The valve's, with this cycle: stored where it is.

        Returns
        -------
        bool
            True if it was stored now, False if exactly this was stored before.

        Raises
        ------
        StoreError
            If it is not stored: not written, or the number is taken by other content.
        ValueError
            If an estimate belongs to another cycle or an estimator occurs twice.
        """
        record = cycle_record(cycle, self._software) if isinstance(cycle, Cycle) else cycle
        check_estimates(record, estimates)
        self.repair()
        if valve in self._claims:
            with self._database.errors("claimed"):
                self._claims[valve].hold()
        if self._insert(valve, record, estimates, counters):
            return True
        if is_stored(self.select, self._valve_ids[valve], record, estimates):
            return False
        msg = (
            f"{self.where}: cycle {record.cycle} of {valve} is already stored with other"
            " content, or condensed, and a stored"
            " cycle is never changed: number the cycles on, or write to another history"
        )
        raise CycleTakenError(msg)

    @contextmanager
    def writing(self, valve: str) -> Iterator[tuple[Connection, int]]:
        """Run one transaction with the key of a valve, on the disk when the block ends."""
        self.repair()
        with self._database.write() as connection:
            yield connection, self._valve_id(connection, valve)

    def add_maintenance(self, valve: str, event: Maintenance) -> bool:
        """Store an event, on the disk on return; False if exactly it was stored before."""
        with self.writing(valve) as (connection, valve_id):
            return add_event(connection, valve_id, event, self.log.kept)

    def withdraw_maintenance(self, valve: str, cycle: int, note: str) -> Maintenance:
        """Keep the newest event in force at a cycle as withdrawn; StoreError says why not.

        Parameters
        ----------
        valve, cycle, note : str, int, str
            Of which valve, first cycle of the segment that the event began [1], and why.
        """
        self.repair()
        with self._database.write() as connection:
            valve_id = connection.scalar(sa.select(own_key(valve)))
            return withdraw_event(connection, valve_id, cycle, note, self.where, self.log.kept)

    def add_verdict(self, valve: str, verdict: Verdict) -> bool:
        """Store a verdict, on the disk on return; False if it says nothing new."""
        with self.writing(valve) as (connection, valve_id):
            return add_verdict(connection, valve_id, verdict, self.log.kept)

    def verdicts(self, valve: str, first_cycle: int = 0) -> list[Verdict]:
        """Return the stored verdicts from `first_cycle` on, oldest first."""
        query = of_valve(VERDICT, valve).where(VERDICT.c.cycle >= first_cycle)
        return [row_verdict(valve, r) for r in self.sound(VERDICT, query.order_by(VERDICT.c.id))]

    def valves(self) -> list[str]:
        """Return the names of all valves, sorted."""
        with self._database.read() as connection:
            return list(sound_names(connection, self.where).values())

    def marks(self) -> Marks:
        """Return by valve what changes whenever something of it was stored, without reading it."""
        with self._database.read() as connection:
            return read_marks(connection, self.where)

    def last_cycle(self, valve: str) -> int:
        """Return the highest number that is taken, also by a damaged row; 0 if there is none."""
        query = of_valve(CYCLE, valve).with_only_columns(sa.func.max(CYCLE.c.cycle).label("last"))
        return int(self.select(query)[0]["last"] or 0)

    def last_record(self, valve: str) -> CycleRecord | None:
        """Return the stored cycle with the highest number, None if there is none."""
        query = of_valve(CYCLE, valve).order_by(CYCLE.c.cycle.desc()).limit(1)
        found = [from_row(CycleRecord, row) for row in self.sound(CYCLE, query)]
        if not found and self.select(query):  # the newest row is damaged: the last that is not
            found = self.cycles(valve)[-1:]
        return found[0] if found else None

    def cycles(
        self, valve: str, first_cycle: int = 0, limit: int | None = None
    ) -> list[CycleRecord]:
        """Return stored cycles, refused ones too, oldest first.

        Parameters
        ----------
        valve : str
            Name of the valve.
        first_cycle : int
            Number of the first cycle wanted [1].
        limit : int or None
            At most this many cycles [1], the oldest of them; None = all.
        """
        query = (
            of_valve(CYCLE, valve)
            .where(CYCLE.c.cycle >= first_cycle)
            .order_by(CYCLE.c.cycle)
            .limit(limit)
        )
        return [from_row(CycleRecord, row) for row in self.sound(CYCLE, query, limit)]

    def estimates(
        self,
        valve: str,
        estimator: str | None = None,
        first_cycle: int = 0,
        limit: int | None = None,
        *,
        used_by_trend: bool | None = None,
    ) -> list[Estimate]:
        """Return stored estimates, equal to what was stored, by cycle and in stored order.

        Parameters
        ----------
        valve : str
            Name of the valve.
        estimator : str or None
            Only of this estimator.
        first_cycle : int
            First cycle wanted.
        limit, used_by_trend : int or None, bool or None
            At most this many estimates; only those that feed the trend, or do not.
        """
        query = of_valve(ESTIMATE, valve).where(ESTIMATE.c.cycle >= first_cycle)
        if estimator is not None:
            query = query.where(ESTIMATE.c.estimator == estimator)
        if used_by_trend is not None:
            query = query.where(ESTIMATE.c.used_by_trend == used_by_trend)
        query = query.order_by(ESTIMATE.c.cycle, ESTIMATE.c.position).limit(limit)
        return [row_estimate(row) for row in self.sound(ESTIMATE, query, limit)]

    def recent_estimates(self, valve: str, cycles: int = 50) -> list[Estimate]:
        """Return all estimates of the last `cycles` cycles that have any, oldest first."""
        numbers = of_valve(ESTIMATE, valve).with_only_columns(ESTIMATE.c.cycle).distinct()
        numbers = numbers.order_by(ESTIMATE.c.cycle.desc()).limit(cycles)
        with self._database.read() as connection:
            found = connection.scalars(numbers).all()
        return self.estimates(valve, first_cycle=min(found)) if found else []

    def maintenance(self, valve: str, first_cycle: int = 0) -> list[Maintenance]:
        """Return the events from `first_cycle` on, withdrawn ones too, by cycle, as stored."""
        query = of_valve(MAINTENANCE, valve).where(MAINTENANCE.c.cycle >= first_cycle)
        query = query.order_by(MAINTENANCE.c.cycle, MAINTENANCE.c.id)
        return [from_row(Maintenance, row) for row in self.sound(MAINTENANCE, query)]

    def backup_for(self, rules: BackupRules, name: str) -> Path:
        """Write a copy that was asked for from outside; see `requested_backup_path`."""
        return self.backup(requested_backup_path(self._database, rules, name))

    def backup(self, path: str | Path = "") -> Path:
        """Write a consistent copy into a new SQLite file while the history stays in use.

        Parameters
        ----------
        path : str or Path
            File; empty = beside the database (PostgreSQL: in the working directory), dated.

        Returns
        -------
        Path
            The file, complete and checked; StoreError if it is there or cannot be written.
        """
        database = self._database
        target = Path(path) if str(path) else default_backup_path(database)
        if database.is_sqlite:
            back_up_sqlite(database, target)
        else:
            copy_to_sqlite(database, target)
        return target

    def export(self, folder: str | Path) -> list[Path]:
        """Write cycles, estimates, maintenance, condensates and history; return the files."""
        return export_files(self._database, Path(folder))

    def verify(self) -> Verification:
        """Read all rows and compare their check sums; StoreError where nothing can be read."""
        return verify(self._database.read, self.where)

    def sound(self, table: sa.Table, query: sa.Select[Any], most: int | None = None) -> Rows:
        """Return the rows of a query whose check sums are right; others are named.

        Parameters
        ----------
        table : Table
            Whose rows they are.
        query : Select
            Which of them.
        most : int or None
            At most so many [1]: so many where the table has them.
        """
        return sound_page(table, lambda at: self.select(query.offset(at)), most, self.where)

    def select(self, query: sa.Select[Any]) -> Sequence[Mapping[str, Any]]:
        """Return the rows of a query as they are, without a look at their check sums."""
        try:
            with self._database.read() as connection:
                result = connection.execute(query)
                names = tuple(result.keys())
                return [dict(zip(names, row, strict=True)) for row in result]
        except (TypeError, ValueError, OverflowError) as err:
            msg = (
                f"{self.where}: cannot be read: a value is none of its column ({err}): put the "
                "last backup in its place"
            )
            raise DamagedValueError(msg) from err

    def _insert(
        self,
        valve: str,
        record: CycleRecord,
        estimates: Sequence[Estimate],
        counters: Counters | None,
    ) -> bool:
        """Insert a cycle where its number is free; return if it was."""
        with self._database.write() as connection:
            valve_id = self._valve_id(connection, valve)
            free = not is_condensed(connection, valve_id, record.cycle)
            new = free and self._insert_cycle(connection, [to_row(record, valve_id)]) == 1
            if new and estimates:
                rows = [estimate_row(valve_id, i, e) for i, e in enumerate(estimates)]
                self._insert_estimates(connection, rows)
            if new and counters is not None:
                put_counters(connection, valve_id, counters)
        self._valve_ids[valve] = valve_id
        return new

    def _valve_id(self, connection: Connection, valve: str) -> int:
        known = self._valve_ids.get(valve)
        return key_of(connection, valve, self.where) if known is None else known
