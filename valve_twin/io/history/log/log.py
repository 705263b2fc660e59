# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters and event log of the valves of one history, in transactions of that history."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import sqlalchemy as sa

from valve_twin.core.aging.verdict import LimitState
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.operation.events import Event, limit_code, limit_event, one_line
from valve_twin.core.operation.stroke_due import STROKE_CODES
from valve_twin.io.history.log.counters import row_counters
from valve_twin.io.history.log.events import (
    KEPT,
    Acknowledgement,
    acknowledge,
    add_events,
    events_query,
    row_event,
)
from valve_twin.io.history.tables import COUNTERS, CYCLE, EVENT
from valve_twin.io.history.valves.names import of_valve

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from sqlalchemy.engine import Connection

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.operation.counters import Counters
    from valve_twin.io.history.check_sums import Rows


class Store(Protocol):
    """What of a history the log needs."""

    @property
    def where(self) -> str:
        """File or URL of the database."""

    def writing(self, valve: str) -> AbstractContextManager[tuple[Connection, int]]:
        """Run one transaction with the key of a valve."""

    def sound(self, table: sa.Table, query: sa.Select[Any], most: int | None = None) -> Rows:
        """Return rows whose check sums are right.

        Parameters
        ----------
        table, query, most : Table, Select, int or None
            Whose rows, which of them, and how many at most [1].
        """


class OperationLog:
    """What a history keeps of the operation of its valves.

    Parameters
    ----------
    history : Store
        Where it is kept.
    kept : int
        Entries of a valve's event log that are kept [1], see `add_events`.
    """

    def __init__(self, history: Store, kept: int = KEPT) -> None:
        self._history, self.kept = history, kept

    def counters(self, valve: str) -> Counters | None:
        """Return the counters with the last stored cycle; None where nothing was counted yet."""
        rows = self._history.sound(COUNTERS, of_valve(COUNTERS, valve))
        return row_counters(rows[0]) if rows else None

    def add(self, valve: str, event: Event) -> None:
        """Store an entry; on the disk on return."""
        with self._history.writing(valve) as (connection, valve_id):
            add_events(connection, valve_id, [event], self.kept)

    def add_stroke(self, valve: str, event: Event) -> bool:
        """Store a stroke test, on the disk on return; False if exactly it was stored before."""
        same = (EVENT.c.stamp_ns == event.stamp_ns, EVENT.c.code == event.code)
        with self._history.writing(valve) as (connection, valve_id):
            known = sa.select(EVENT.c.id).where(EVENT.c.valve_id == valve_id, *same)
            new = connection.scalar(known.limit(1)) is None
            if new:
                add_events(connection, valve_id, [event], self.kept)
        return new

    def strokes(self, valve: str) -> list[Event]:
        """Return the entries of stroke tests, oldest first."""
        query = of_valve(EVENT, valve).where(EVENT.c.code.in_(STROKE_CODES)).order_by(EVENT.c.id)
        return [row_event(valve, row) for row in self._history.sound(EVENT, query)]

    def add_limit(self, valve: str, trend: Trend) -> bool:
        """Store where a trend stands to its limits if that is new; return whether it is.

        Parameters
        ----------
        valve : str
            Name of the valve.
        trend : Trend
            The newest of a parameter; one that is older than the last entry on it says nothing.
        """
        codes = {limit_code(s, trend.parameter): s for s in LimitState if s}
        query = sa.select(EVENT.c.code, EVENT.c.stamp_ns).where(EVENT.c.code.in_(codes))
        with self._history.writing(valve) as (connection, valve_id):
            own = query.where(EVENT.c.valve_id == valve_id).order_by(EVENT.c.id.desc()).limit(1)
            last = connection.execute(own).first()
            if last is not None and trend.stamp_ns <= last.stamp_ns:
                return False
            before = codes[last.code] if last else LimitState.NONE
            event = limit_event(trend, before, _cycle_at(connection, valve_id, trend.stamp_ns))
            if event is not None:
                add_events(connection, valve_id, [event], self.kept)
        return event is not None

    def events(
        self, valve: str, first_id: int = 0, limit: int | None = None, *, open_only: bool = False
    ) -> list[Event]:
        """Return entries, oldest first.

        Parameters
        ----------
        valve : str
            Name of the valve.
        first_id : int
            Number of the first entry wanted [1].
        limit : int or None
            At most this many [1], the oldest of them; None = all.
        open_only : bool
            Only those that somebody has yet to acknowledge; what is good asks nobody.
        """
        query = events_query(of_valve(EVENT, valve), first_id, open_only=open_only).limit(limit)
        return [row_event(valve, row) for row in self._history.sound(EVENT, query, limit)]

    def acknowledge(self, valve: str, number: int, by: Acknowledgement) -> int:
        """Note that somebody has seen an entry, or all that are open, in an entry of its own, too.

        Parameters
        ----------
        valve : str
            Name of the valve.
        number : int
            The entry's; 0 = all that are open.
        by : Acknowledgement
            Who, what and when.

        Returns
        -------
        int
            How many were open until now [1].

        Raises
        ------
        StoreError
            If the entry is not there, or who and what are empty or too long.
        """
        with self._history.writing(valve) as (connection, valve_id):
            seen = acknowledge(connection, valve_id, number, by, self._history.where)
            if seen:
                which = f"entry {number}" if number else f"{seen} entries"
                text = f"{by.who} has seen {which}" + (f": {by.note}" if by.note else "")
                code, status = "event.acknowledged", Ne107.GOOD.value
                entry = Event(by.stamp_ns, 0, code, status, one_line(text))
                add_events(connection, valve_id, [entry], self.kept)
        return seen


def _cycle_at(connection: Connection, valve_id: int, end_ns: int) -> int:
    """Return the cycle that ends at a stamp [ns], 0 = none; the newest are looked at first."""
    query = sa.select(CYCLE.c.cycle, CYCLE.c.end_ns).where(CYCLE.c.valve_id == valve_id)
    query = query.where(CYCLE.c.end_ns <= end_ns).order_by(CYCLE.c.cycle.desc()).limit(1)
    found = connection.execute(query).first()
    return int(found.cycle) if found is not None and found.end_ns == end_ns else 0
