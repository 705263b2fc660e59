# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rank the valves of a history: which one first, and how far to trust what is said of it.

Valves are not compared with each other but each with its own past (a unit's level says nothing
about another unit); what is ranked is how far each has gone from its own reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import Assessment, assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.ahead import look_ahead
from valve_twin.core.aging.verdict import (
    VerdictKind,
    concern,
    outlook,
    unjudged,
    way_to_threshold,
)
from valve_twin.core.faults.advice import advise
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.operation.stroke_due import stroke_due
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.registry import get_model
from valve_twin.io.history.aging.reading import (
    is_worth_keeping,
    keep_known,
    read_known,
    trend_model,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.core.past.columns import Rows
    from valve_twin.io.history.store import History

RECENT_CYCLES = 20
"""Newest cycles that residual and confidence are taken from, assumed."""


class FleetOrder(Enum):
    """What the valves are ranked by, worst first."""

    URGENCY = "urgency"
    DRIFT = "drift"
    RESIDUAL = "residual"
    CONFIDENCE = "confidence"
    NAME = "name"


@dataclass(frozen=True, slots=True)
class FleetRow:
    """What the history says of one valve.

    Attributes
    ----------
    valve, model : str
        Its name and the name of its model.
    verdict : VerdictKind
        The word of the aging monitor.
    evidence : str
        Why, in one line; or why nothing can be said.
    ne107, failure_mode, action : str
        State by NAMUR NE 107, failure mode by ISO 14224 and what is to be done; empty = none.
    unjudged : str
        Parameters of which "ok" says nothing, or not that they are within their limit.
    concern : int
        How grave its worst trend is: 0 (nothing) to 3 (beyond its threshold).
    parameter : str
        Parameter of the worst trend, empty where there is none.
    drift, drift_lower_95, drift_upper_95 : float
        Its change against the valve's own reference and the 95 % interval [%].
    way : float
        Share of the way to the threshold that is covered with 95 % confidence [1].
    limit_state : str
        Where it stands to its two limits: within, warning, alarm; empty = not known.
    remaining : float
        Remaining life, median [unit of the aging axis]; infinite = unbounded, NaN = not known.
    axis : str
        What aging is counted in.
    service_date_ns : int
        When the threshold is reached, data's clock [ns]; 0 = not known.
    residual : float
        Root mean square of the one-step residual as test data, median of the newest
        `RECENT_CYCLES` cycles [1].
    residual_ratio : float
        The same over that of the first cycles [1].
    confidence : float
        Share of the newest `RECENT_CYCLES` cycles whose estimate feeds the trend unrestricted [1].
    cycle : int
        Number of the last stored cycle.
    end_ns : int
        Its last stamp [ns].
    cycles, movements, reversals, starts : int
        What it has done since its counters began, see `core.operation.counters` [1].
    travel, strokes : float
        Way of its position [its unit] and by the stroke [1]; NaN = not counted, not known.
    hours, hours_open, hours_closed, hours_near_closed : float
        Time in cycles, open, closed, open by less than a tenth [h].
    stroke_test, stroke_test_ns : str, int
        Verdict of the last stroke test (pass, fail) and when it was; empty and 0 = none known.
    stroke_days_since, stroke_days_until : float
        Days since it and until the next one is due, below 0 = overdue; NaN = not known [d].
    open_events : int
        Entries of its event log that somebody has yet to acknowledge [1].
    """

    valve: str
    model: str = ""
    verdict: VerdictKind = VerdictKind.NOT_ENOUGH_DATA
    evidence: str = ""
    ne107: str = Ne107.CHECK_FUNCTION.value
    failure_mode: str = ""
    action: str = ""
    unjudged: str = ""
    concern: int = 0
    parameter: str = ""
    drift: float = math.nan
    drift_lower_95: float = math.nan
    drift_upper_95: float = math.nan
    way: float = math.nan
    limit_state: str = ""
    remaining: float = math.nan
    axis: str = ""
    service_date_ns: int = 0
    residual: float = math.nan
    residual_ratio: float = math.nan
    confidence: float = 0.0
    cycle: int = 0
    end_ns: int = 0
    cycles: int = 0
    movements: int = 0
    reversals: int = 0
    starts: int = 0
    travel: float = math.nan
    strokes: float = math.nan
    hours: float = math.nan
    hours_open: float = math.nan
    hours_closed: float = math.nan
    hours_near_closed: float = math.nan
    open_events: int = 0
    stroke_test: str = ""
    stroke_test_ns: int = 0
    stroke_days_since: float = math.nan
    stroke_days_until: float = math.nan

    @property
    def needs_attention(self) -> bool:
        """Whether somebody has to look."""
        return self.verdict.asks_for_help


@dataclass(frozen=True, slots=True)
class ValveState:
    """What the history says of one valve: row, trend of every followed parameter, verdict."""

    row: FleetRow
    trends: tuple[Trend, ...] = ()
    verdict: Verdict | None = None


def rank_fleet(
    history: History,
    *,
    aging: Mapping[str, AgingConfig] | None = None,
    order: FleetOrder = FleetOrder.URGENCY,
    on_valve: Callable[[], None] = lambda: None,
) -> list[FleetRow]:
    """Assess every valve of a history and rank them, worst first.

    Parameters
    ----------
    history : History
        Where the estimates are.
    aging : mapping, optional
        Rules of aging by name of the valve; the default rules where one is missing.
    order : FleetOrder
        What they are ranked by.
    on_valve : callable
        Called after each valve.

    Returns
    -------
    list of FleetRow
        One a valve; a valve that cannot be assessed says why and spoils no other.
    """
    rows = []
    for valve in history.valves():
        config = (aging or {}).get(valve, AgingConfig())
        rows.append(describe_valve(history, valve, config).row)
        on_valve()
    return ranked(rows, order)


def ranked(rows: Sequence[FleetRow], order: FleetOrder) -> list[FleetRow]:
    """Return the rows in an order, worst first; what is not known comes last."""
    return sorted(rows, key=lambda row: (*_rank(row, order), row.valve))


def _rank(row: FleetRow, order: FleetOrder) -> tuple[float, ...]:
    if order is FleetOrder.NAME:
        return ()
    if order is FleetOrder.DRIFT:
        return (_descending(abs(row.drift)),)
    if order is FleetOrder.RESIDUAL:
        return (_descending(row.residual_ratio), _descending(row.residual))
    if order is FleetOrder.CONFIDENCE:
        return (row.confidence, _descending(_width(row)))
    return (
        -float(Ne107(row.ne107).severity),
        -float(row.needs_attention),
        -float(row.concern),
        _descending(row.way),
        row.remaining if math.isfinite(row.remaining) else math.inf,
        _descending(row.residual_ratio),
        row.confidence,
    )


def _descending(value: float) -> float:
    """Sort key: greatest first, not known last."""
    return math.inf if math.isnan(value) else -value


def _width(row: FleetRow) -> float:
    return row.drift_upper_95 - row.drift_lower_95


def describe_valve(history: History, valve: str, config: AgingConfig) -> ValveState:
    """Assess one valve of a history.

    Parameters
    ----------
    history : History
        Where the estimates are.
    valve : str
        Its name.
    config : AgingConfig
        Rules of aging.
    """
    last = history.last_record(valve)
    if last is None:
        return ValveState(FleetRow(valve, evidence="no cycle is stored"))
    stored = _counted(FleetRow(valve, cycle=last.cycle, end_ns=last.end_ns), history)
    due = stroke_due(history.log.strokes(valve), last.end_ns, config.stroke_test_days)
    stored = replace(
        stored,
        stroke_test=due.verdict,
        stroke_test_ns=due.stamp_ns,
        stroke_days_since=due.since_days,
        stroke_days_until=due.until_days,
    )
    name = trend_model(history, valve)
    if not name:
        return ValveState(replace(stored, evidence="no stored estimate feeds a trend"))
    try:
        model = get_model(name)
    except ValueError as err:
        return ValveState(replace(stored, model=name, evidence=str(err)))
    known = read_known(history, valve, name, config)
    past, events = known.state.past(), known.state.maintenance
    named, memory = model.parameters, known.memory
    found = assess(past, events, config, parameters=named, valve=valve, memory=memory)
    if is_worth_keeping(history, valve, known):
        look_ahead(past, events, config, parameters=named, memory=memory)
        keep_known(history, valve, name, config, known)
    row = _assessed(replace(stored, model=name), found, past.trend, config)
    return ValveState(row, found.trends, found.verdict)


def _counted(row: FleetRow, history: History) -> FleetRow:
    """Add what the valve has done and what of its event log nobody has acknowledged."""
    row = replace(row, open_events=len(history.log.events(row.valve, open_only=True)))
    counters = history.log.counters(row.valve)
    if counters is None:
        return row
    hours, opened, closed, near = counters.hours
    return replace(
        row,
        cycles=counters.cycles,
        movements=counters.movements,
        reversals=counters.reversals,
        starts=counters.starts,
        travel=counters.travel,
        strokes=counters.strokes,
        hours=hours,
        hours_open=opened,
        hours_closed=closed,
        hours_near_closed=near,
    )


def _assessed(row: FleetRow, found: Assessment, estimates: Rows, config: AgingConfig) -> FleetRow:
    residual, ratio = recent_residual(estimates)
    row = replace(row, residual=residual, residual_ratio=ratio, confidence=confidence(estimates))
    return judged(row, found.verdict, found.trends, config)


def judged(
    row: FleetRow, verdict: Verdict, trends: Sequence[Trend], config: AgingConfig
) -> FleetRow:
    """Return a row with what a verdict and its trends say of the valve.

    Parameters
    ----------
    row : FleetRow
        What else is known of it.
    verdict : Verdict
        Of its newest cycle.
    trends : sequence of Trend
        What it was made from, one a followed parameter.
    config : AgingConfig
        Rules of aging.
    """
    advice = advise(verdict, trends)
    worst = max(trends, key=lambda t: _gravity(t, config), default=None)
    row = replace(
        row,
        verdict=verdict.kind,
        unjudged=", ".join(unjudged(verdict, trends)),
        evidence=verdict.evidence,
        ne107=advice.ne107.value,
        failure_mode=advice.failure_mode,
        action=advice.sentence,
    )
    return row if worst is None else _with_trend(row, worst, config)


def _gravity(trend: Trend, config: AgingConfig) -> tuple[float, ...]:
    way = way_to_threshold(trend)
    drift = abs(trend.drift_reference)
    return (
        concern(trend, config),
        way if math.isfinite(way) else -math.inf,
        drift if math.isfinite(drift) else -math.inf,
    )


def _with_trend(row: FleetRow, trend: Trend, config: AgingConfig) -> FleetRow:
    return replace(
        row,
        concern=concern(trend, config),
        parameter=trend.parameter,
        drift=trend.drift_reference,
        drift_lower_95=trend.drift_reference_lower_95,
        drift_upper_95=trend.drift_reference_upper_95,
        way=way_to_threshold(trend),
        limit_state=trend.limit_state.text,
        remaining=trend.remaining_median if outlook(trend).says_when else math.inf,
        axis=trend.axis,
        service_date_ns=trend.service_date_ns if trend.service_date_known else 0,
    )


def recent_residual(estimates: Rows) -> tuple[float, float]:
    """Return the one-step residual of the newest cycles [1] and its ratio to the first ones.

    NaN where there are no test errors, and the ratio where there are fewer than two
    `RECENT_CYCLES`.
    """
    errors = np.sqrt(estimates.error[np.isfinite(estimates.error)])
    if len(errors) == 0:
        return math.nan, math.nan
    recent = float(np.median(errors[-RECENT_CYCLES:]))
    first = float(np.median(errors[:RECENT_CYCLES]))
    known = len(errors) >= 2 * RECENT_CYCLES and first > 0.0
    return recent, recent / first if known else math.nan


def confidence(estimates: Rows) -> float:
    """Return the share of the newest cycles whose estimate was accepted without restriction."""
    newest = estimates.status[-RECENT_CYCLES:]
    return float(np.mean(newest == EstimateStatus.ACCEPTED)) if len(newest) else 0.0
