# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Condense old cycles of a history to hours and days, on demand and without stopping its writer.

Cycles are condensed by whole days (UTC), some thousand at a time. What they say is computed while
others read and write; it takes their place in one transaction, so that a death at any moment
leaves every cycle either as it was or condensed. Kept are the estimates that the trend and the
search for faults still hold, and beside them all that was concluded from the others
(`tiers.state`), so that a verdict is what it was, to the last bit. Maintenance, verdicts, events
and counters are never touched.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import sqlalchemy as sa

from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.past.condensate import DAY_S, HOUR_S, OF_CYCLES, REFUSED, Condensed, Condenser
from valve_twin.core.types import EstimateStatus
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.tables import (
    CONDENSATE,
    CONDENSED,
    CYCLE,
    ESTIMATE,
    CycleRecord,
    from_row,
    row_estimate,
    to_row,
)
from valve_twin.io.history.tiers.extent import condensed, condensed_until
from valve_twin.io.history.tiers.reading import LAST_PLACE, begun_state, counted
from valve_twin.io.history.tiers.state import state_text
from valve_twin.io.history.valves.names import of_valve

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from sqlalchemy.engine import Connection

    from valve_twin.core.past.state import AgingState
    from valve_twin.io.history.store import History
    from valve_twin.io.history.tiers.retention import Retention

LEAST = 1000
"""Newest cycles of a valve that are always kept [1]."""

A_TIME = 10_000
"""Cycles that are condensed in one transaction [1], about: it is made of whole days."""

_DAY_NS = DAY_S * 10**9
_PAGE = 5000
_NEWEST = 11  # cycles whose middle stamp ages count from
_MOST_OF_A_DAY = 10 * A_TIME  # cycles of one day beyond which it is taken in parts


def condense(
    history: History,
    valve: str,
    retention: Retention,
    on_part: Callable[[Condensed], object] = lambda _: None,
) -> Condensed | None:
    """Condense all cycles of a valve that need not be kept.

    Parameters
    ----------
    history : History
        Open for writing; its writer may go on.
    valve : str
        Its name.
    retention : Retention
        What is kept.
    on_part : callable
        Gets how far it is after each transaction.

    Returns
    -------
    Condensed or None
        How far the cycles are condensed now; None = none is.

    Raises
    ------
    StoreError
        If the rule says nothing, or the history cannot be read or written, or is condensed by
        another process at the same time: what was condensed stays so.
    """
    if wrong := retention.wrong():
        raise StoreError(wrong)
    done = condensed(history, valve)
    if done is None and condensed_until(history, valve):
        msg = (
            f"{history.where}: what is known of the condensed cycles of {valve} is damaged: put "
            "the last backup in its place"
        )
        raise StoreError(msg)
    newest_ns = _newest_ns(history, valve)
    if newest_ns is None:
        return done
    hours_from = newest_ns - round(retention.hours_for_days * _DAY_NS)
    state = begun_state(history, valve)
    if condensed_until(history, valve) != (done.cycle if done else 0):
        raise StoreError(_meanwhile(history, valve))
    state.maintenance = history.maintenance(valve)
    for last in _parts(history, valve, retention, newest_ns):
        done = _condense_to(history, valve, last, state, hours_from, done)
        on_part(done)
    _forget_hours(history, valve, hours_from)
    return done


def _newest_ns(history: History, valve: str) -> int | None:
    """Return the time that ages count from [ns]: the middle one of the newest cycles, not ahead.

    A clock that was wrong for some cycles, or is ahead of this machine's, makes nothing older.
    """
    ends = of_valve(CYCLE, valve).with_only_columns(CYCLE.c.end_ns)
    found = history.select(ends.order_by(CYCLE.c.cycle.desc()).limit(_NEWEST))
    if not found:
        return None
    return min(sorted(int(row["end_ns"]) for row in found)[len(found) // 2], time.time_ns())


def _parts(history: History, valve: str, retention: Retention, newest_ns: int) -> Iterator[int]:
    """Yield the last cycle of each part that is condensed, oldest first; each a whole day."""
    own = of_valve(CYCLE, valve)
    last = history.last_cycle(valve) - max(retention.cycles, LEAST)
    if retention.days:
        young = own.where(CYCLE.c.end_ns >= newest_ns - round(retention.days * _DAY_NS))
        last = min(last, _number(history, young, sa.func.min(CYCLE.c.cycle)) - 1)
    kept = own.where(CYCLE.c.cycle > last).order_by(CYCLE.c.cycle).limit(1)
    for row in history.select(kept):  # the day of the first one that is kept stays whole
        early = own.where(CYCLE.c.cycle <= last, CYCLE.c.start_ns < _midnight(row["start_ns"]))
        last = _number(history, early, sa.func.max(CYCLE.c.cycle))
    while True:
        query = own.with_only_columns(CYCLE.c.cycle, CYCLE.c.start_ns).where(
            CYCLE.c.cycle > condensed_until(history, valve), CYCLE.c.cycle <= last
        )
        rows = history.select(query.order_by(CYCLE.c.cycle).limit(_MOST_OF_A_DAY))
        if not rows:
            return
        yield _end_of_part([(int(r["cycle"]), int(r["start_ns"])) for r in rows])


def _end_of_part(rows: list[tuple[int, int]]) -> int:
    """Return the cycle that ends the last whole day of about `A_TIME` cycles (number, start)."""
    days = [_midnight(start_ns) for _, start_ns in rows]
    ends = [k for k in range(len(rows) - 1) if days[k] != days[k + 1]]
    within = [k for k in ends if k < A_TIME]
    if len(rows) <= A_TIME:
        return rows[-1][0]
    return rows[within[-1] if within else ends[0] if ends else len(rows) - 1][0]


def _midnight(stamp_ns: int) -> int:
    """Return the begin of the day of a stamp [ns]."""
    return stamp_ns // _DAY_NS * _DAY_NS


def _number(history: History, query: sa.Select[Any], value: sa.ColumnElement[Any]) -> int:
    rows = history.select(query.with_only_columns(value.label("n")))
    return int(rows[0]["n"] or 0)


def _condense_to(
    history: History,
    valve: str,
    last: int,
    state: AgingState,
    hours_from: int,
    before: Condensed | None,
) -> Condensed:
    """Condense what is behind `before`, up to a cycle; `state` takes what their estimates say."""
    first = before.cycle if before else 0
    new = sa.and_(CYCLE.c.cycle > first, CYCLE.c.cycle <= last)
    there = _number(history, of_valve(CYCLE, valve).where(new), sa.func.count())
    by_hour, by_day = Condenser((HOUR_S,)), Condenser((DAY_S,))
    records, estimates = [], []
    silent: set[int] = set()
    held_before = state.cycles()
    for row in _pages(history, valve, ESTIMATE, first, last):
        estimate = row_estimate(row)
        state.add(estimate)
        estimates.append(_Row(row["id"], row["cycle"], row["estimator"], row["used_by_trend"]))
        if estimate.used_by_trend and estimate.status is EstimateStatus.REFUSED:
            silent.add(estimate.cycle)
        for condenser in (by_hour, by_day) if estimate.end_ns >= hours_from else (by_day,):
            condenser.add_estimate(estimate)
    for row in _pages(history, valve, CYCLE, first, last):
        record = from_row(CycleRecord, row)
        records.append(record)
        for condenser in (by_hour, by_day) if record.end_ns >= hours_from else (by_day,):
            own = record.cycle, record.start_ns, record.end_ns
            condenser.add(*own, OF_CYCLES, _values(record, silent=record.cycle in silent))
    done = replace(counted(before, records, len(estimates)), cycle=last)
    found = [*by_hour.result(), *by_day.result()]
    text, held = state_text(state), state.cycles()
    with history.writing(valve) as (connection, valve_id):
        own_rows = CONDENSED.c.valve_id == valve_id
        at = connection.scalar(sa.select(CONDENSED.c.cycle).where(own_rows)) or 0
        of_part = sa.and_(CYCLE.c.valve_id == valve_id, new)
        now = connection.scalar(sa.select(sa.func.count()).select_from(CYCLE).where(of_part))
        if at != first or now != there:
            raise StoreError(_meanwhile(history, valve))
        if found:
            rows = [sealed(CONDENSATE, to_row(c, valve_id)) for c in found]
            connection.execute(CONDENSATE.insert(), rows)
        connection.execute(sa.delete(CONDENSED).where(own_rows))
        row = {**to_row(done, valve_id), "state": text}
        connection.execute(CONDENSED.insert(), sealed(CONDENSED, row))
        gone = [e.id for e in estimates if not e.is_in(held)]
        kept = _kept_before(connection, valve_id, first)
        gone += [e.id for e in kept if e.is_in(held_before) and not e.is_in(held)]
        _delete(connection, ESTIMATE.c.id, gone)
        numbers = [record.cycle for record in records]
        _delete(connection, CYCLE.c.cycle, numbers, CYCLE.c.valve_id == valve_id)
    return done


def _meanwhile(history: History, valve: str) -> str:
    return f"{history.where}: cycles of {valve} were condensed or stored meanwhile: try again"


class _Row(NamedTuple):
    """What tells whether a row of table `estimate` is kept."""

    id: int
    cycle: int
    estimator: str
    used_by_trend: bool

    def is_in(self, held: tuple[set[int], set[int]]) -> bool:
        """Return whether it is among the cycles held of the trend, or of the features."""
        trend, features = held
        if self.used_by_trend and self.cycle in trend:
            return True
        return self.estimator == ESTIMATOR and self.cycle in features


def _pages(
    history: History, valve: str, table: sa.Table, first: int, last: int
) -> Iterator[Mapping[str, Any]]:
    """Yield the sound rows behind a cycle and up to another one; a damaged one stays as it is."""
    places = [table.c[name] for name in ("cycle", "position") if name in table.c]
    at = [first, *([LAST_PLACE] if len(places) > 1 else [])]
    while True:
        behind = sa.tuple_(*places) > sa.tuple_(*at)
        query = of_valve(table, valve).where(behind, table.c.cycle > at[0] - 1)
        query = query.where(table.c.cycle <= last).order_by(*places).limit(_PAGE)
        rows = history.sound(table, query, _PAGE)
        yield from rows
        if len(rows) < _PAGE:
            return
        at = [rows[-1][place.name] for place in places]


def _values(record: CycleRecord, *, silent: bool) -> dict[str, float]:
    """Return what is condensed of a cycle itself, by name; a silent one gave no estimate."""
    return {
        "accepted": float(record.accepted),
        REFUSED: float(silent or not record.accepted),
        "samples": float(record.samples),
        "lost": float(record.lost),
        "length_s": (record.end_ns - record.start_ns) * 1e-9,
    }


def _kept_before(connection: Connection, valve_id: int, cycle: int) -> list[_Row]:
    """Return the estimates that stayed when cycles up to one were condensed."""
    names = [ESTIMATE.c[name] for name in _Row._fields]
    query = sa.select(*names).where(ESTIMATE.c.valve_id == valve_id, ESTIMATE.c.cycle <= cycle)
    return [_Row(*row) for row in connection.execute(query)]


def _delete(
    connection: Connection, column: sa.Column[Any], numbers: list[int], *of: sa.ColumnElement[bool]
) -> None:
    """Delete the rows with these numbers."""
    if numbers:
        gone = sa.delete(column.table).where(column == sa.bindparam("number"), *of)
        connection.execute(gone, [{"number": n} for n in numbers])


def _forget_hours(history: History, valve: str, hours_from: int) -> None:
    """Let go of hours that are too old; their days stay."""
    with history.writing(valve) as (connection, valve_id):
        hours = sa.and_(CONDENSATE.c.valve_id == valve_id, CONDENSATE.c.span_s == HOUR_S)
        connection.execute(sa.delete(CONDENSATE).where(hours, CONDENSATE.c.end_ns < hours_from))
