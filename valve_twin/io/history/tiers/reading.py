# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Read what was said by the cycles that a condensed history let go of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from valve_twin.core.past.condensate import DAY_S, OF_CYCLES, REFUSED, Condensate, Condensed
from valve_twin.core.past.state import AgingState
from valve_twin.io.history.tables import CONDENSATE, CONDENSED, ESTIMATE, from_row, row_estimate
from valve_twin.io.history.tiers.extent import condensed, condensed_until
from valve_twin.io.history.tiers.state import text_state
from valve_twin.io.history.valves.names import of_valve

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import Estimate
    from valve_twin.io.history.store import History
    from valve_twin.io.history.tables import CycleRecord

T = TypeVar("T")

LAST_PLACE = 2**31 - 1
"""Place behind the last estimate of a cycle [1]."""


def condensates(
    history: History,
    valve: str,
    *,
    parameter: str | None = None,
    estimator: str | None = None,
    span_s: int = DAY_S,
) -> list[Condensate]:
    """Return what hours or days of condensed cycles say, oldest first.

    Parameters
    ----------
    history : History
        Where they are.
    valve : str
        Its name.
    parameter, estimator : str or None
        Only of this parameter, of this estimator; `OF_CYCLES` = of the cycles themselves.
    span_s : int
        `HOUR_S` or `DAY_S` [s].
    """
    query = of_valve(CONDENSATE, valve).where(CONDENSATE.c.span_s == span_s)
    if parameter is not None:
        query = query.where(CONDENSATE.c.parameter == parameter)
    if estimator is not None:
        query = query.where(CONDENSATE.c.estimator == estimator)
    query = query.order_by(CONDENSATE.c.cycle, CONDENSATE.c.id)
    return [from_row(Condensate, row) for row in history.sound(CONDENSATE, query)]


class Refused(NamedTuple):
    """From how many condensed cycles nothing was learnt, and whether that is known of all [1]."""

    cycles: int
    of_all: bool


NONE_REFUSED = Refused(0, of_all=True)
"""What is said of a history that is not condensed."""


def condensed_refused(history: History, valve: str) -> Refused:
    """Return from how many condensed cycles of a valve nothing was learnt.

    Of days that an older version condensed only those count that were not accepted.

    Parameters
    ----------
    history : History
        Where they are.
    valve : str
        Its name.
    """
    days = condensates(history, valve, estimator=OF_CYCLES)
    told = {(d.cycle, d.last_cycle): d for d in days if d.parameter == REFUSED}
    number = sum(round(d.mean * d.count) for d in told.values())
    for day in days:
        if day.parameter == "accepted" and (day.cycle, day.last_cycle) not in told:
            number += day.count - round(day.mean * day.count)
    done = condensed(history, valve)
    return Refused(number, done is None or sum(d.count for d in told.values()) == done.cycles)


def counted(
    before: Condensed | None, records: Sequence[CycleRecord], estimates: int = 0
) -> Condensed:
    """Return how many cycles a valve has with some that are not condensed.

    Parameters
    ----------
    before : Condensed or None
        Its condensed cycles.
    records : sequence of CycleRecord
        The others, oldest first.
    estimates : int
        Their estimates [1].
    """
    if not records:
        return before or Condensed(0, 0, 0, 0)
    first, last = records[0], records[-1]
    before = before or Condensed(0, first.cycle, first.start_ns, 0)
    return replace(
        before,
        cycle=last.cycle,
        end_ns=last.end_ns,
        cycles=before.cycles + len(records),
        accepted=before.accepted + sum(r.accepted for r in records),
        reproducible=before.reproducible + sum(r.reproducible for r in records),
        samples=before.samples + sum(r.samples for r in records),
        lost=before.lost + sum(r.lost for r in records),
        missed=before.missed + sum(max(r.missed_cycles, 0) for r in records),
        gaps=before.gaps + sum(r.missed_cycles < 0 for r in records),
        estimates=before.estimates + estimates,
    )


def begun_state(history: History, valve: str) -> AgingState:
    """Return what the condensed cycles of a valve said of its aging; nothing where none are.

    Parameters
    ----------
    history : History
        Where they were.
    valve : str
        Its name.
    """
    rows = history.sound(CONDENSED, of_valve(CONDENSED, valve))
    state = text_state(rows[0]["state"]) if rows else None
    if state is None:
        state = AgingState()
        state.maintenance = history.maintenance(valve)
        for estimate in _kept(history, valve):
            state.add(estimate)
    return state


def whole_past(
    history: History, valve: str, estimates: Sequence[Estimate]
) -> Sequence[Estimate] | Past:
    """Return what all cycles of a valve said, condensed ones included.

    Parameters
    ----------
    history : History
        Where they are.
    valve : str
        Its name.
    estimates : sequence of Estimate
        All that are stored, oldest first; returned where no cycle is condensed.
    """
    until = condensed_until(history, valve)
    if not until:
        return estimates
    state = begun_state(history, valve)
    state.maintenance = history.maintenance(valve)
    for estimate in estimates:
        if estimate.cycle > until:
            state.add(estimate)
    return state.past()


def undisturbed(history: History, valve: str, read: Callable[[], T]) -> T:
    """Return what was read of a valve while none of its cycles were condensed.

    Parameters
    ----------
    history : History
        What is read.
    valve : str
        Its name.
    read : callable
        Reads in several transactions; called again where cycles were condensed meanwhile.
    """
    while True:
        before = condensed_until(history, valve)
        found = read()
        if condensed_until(history, valve) == before:
            return found


def _kept(history: History, valve: str) -> list[Estimate]:
    """Return the estimates of condensed cycles that were kept."""
    until = condensed_until(history, valve)
    query = of_valve(ESTIMATE, valve).where(ESTIMATE.c.cycle <= until)
    query = query.order_by(ESTIMATE.c.cycle, ESTIMATE.c.position)
    return [row_estimate(row) for row in history.sound(ESTIMATE, query)]
