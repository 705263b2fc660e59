# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is said of the remaining life: when there is an upper limit, and what is so by a stop.

That a limit is reached before a stop is as probable as the laws say (`core.aging.life`) where the
parameter drifts at all. Without a drift the level stays, and by the reference of the same segment
it never was another. How probable that is follows from the slope's t by the Bayes factor of the
Bayesian information criterion, sqrt(n) (1 + t^2/nu)^(-n/2) for n values that count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.altered import altered
from valve_twin.core.aging.config import parse_stop
from valve_twin.core.aging.life import date_after
from valve_twin.core.aging.verdict import LimitState, TrendStatus

if TYPE_CHECKING:
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.aging.drift import Limit
    from valve_twin.core.aging.trend import Line
    from valve_twin.core.aging.verdict import Trend

SIGNIFICANCE = 0.002
"""Error probability of a drift that gives the remaining life an upper limit [1], assumed;
stricter than `AgingConfig.significance`, since every cycle tests anew."""

CERTAIN = 1e-6
"""Error probability of a drift that is told though, the reference being in doubt, the limit may
be reached already [1], assumed."""

STEADY = 0.5
"""Probability that a parameter does not drift, before any value is seen [1], assumed."""

FOUND_SAMPLES = 25
"""Estimates from which on a segment that was found (a jump before it, no maintenance) gives the
remaining life an upper limit [1], assumed: what jumped may jump again, and a short piece of a
wave or of a bend is a line (set on strangers of seeds 95000-95149)."""


SCALE = 0.08
"""Standard deviation of the scale of a drift [1], set on strangers (seeds 95000-95149,
docs/aging.md): a gain is estimated where the controller works, which moves as the valve ages."""


def is_sure(trend: Trend, limit: Limit, *, begun: bool) -> bool:
    """Return whether there is a drift to the limit at all.

    What lies past its limit beyond doubt needs no slope. A segment that was found (not `begun` by
    a start or maintenance) does not go to a limit while it is short, or while the level lies
    beyond doubt on the other side of the reference.

    Parameters
    ----------
    trend : Trend
        Trend with its drift and what of the way to its limits is lost.
    limit : Limit
        The limit.
    begun : bool
        Whether the segment began with the record or with maintenance.
    """
    if limit.beyond and not trend.share_lost < 1.0:
        return True
    if trend.p_value >= SIGNIFICANCE:
        return False
    low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
    farthest = high if limit.value > trend.reference else -low
    return begun or (trend.samples >= FOUND_SAMPLES and not farthest < 0.0)


def past_limit(trend: Trend, *, held: bool) -> Trend:
    """Say of a level past its threshold that it is beyond it, unless it may not have moved.

    Where the reference itself, within its doubt, is past the threshold, that tells nothing.

    Parameters
    ----------
    trend : Trend
        Trend with its drift and its remaining life.
    held : bool
        Whether the limit was passed before and is not left.
    """
    low, high = trend.drift_reference_lower_95, trend.drift_reference_upper_95
    if low <= 0.0 <= high and not (held or trend.share_lost > 0.0):
        return altered(without_forecast(trend), remaining_low=0.0, remaining_median=float("inf"))
    return altered(trend, status=TrendStatus.BEYOND_THRESHOLD)


def with_life(trend: Trend, limit: Limit, stamp_ns: int) -> Trend:
    """Add the remaining life and the service date; a date only where the life is bounded.

    Parameters
    ----------
    trend : Trend
        Trend without.
    limit : Limit
        What remains to it.
    stamp_ns : int
        Stamp of the newest cycle, from which that counts [ns].
    """
    life = limit.remaining
    rate = trend.cycle_rate
    date = date_after(stamp_ns, life.median, rate)
    return altered(
        trend,
        threshold=limit.value,
        warning=limit.warning,
        unbounded=life.unbounded,
        remaining_low=life.low,
        remaining_median=life.median,
        remaining_high=life.high,
        service_date_known=date > 0 and not life.unbounded,
        service_date_ns=date if not life.unbounded else 0,
        service_date_early_ns=0 if life.unbounded else date_after(stamp_ns, life.low, rate),
    )


def stop_probability(
    trend: Trend, limit: Limit, line: Line, config: AgingConfig, *, own: bool, stamp_ns: int
) -> float:
    """Return how probable it is that a limit is reached before `next_stop` [1]; NaN = not asked.

    Parameters
    ----------
    trend : Trend
        Trend with its limit state.
    limit : Limit
        The limit.
    line : Line
        The line through the segment.
    config : AgingConfig
        When the next stop is.
    own : bool
        Whether the reference is of values of the same segment.
    stamp_ns : int
        Stamp of the newest cycle [ns].
    """
    ahead, date_ns = parse_stop(config.next_stop)
    if date_ns:
        ahead = 1e-9 * (date_ns - stamp_ns) * trend.cycle_rate
    if limit.approach is None or not np.isfinite(ahead):
        return trend.next_stop_probability
    drifting = limit.approach.before(ahead)
    if trend.limit_state is LimitState.ALARM:
        return drifting
    steady = _steady(line)
    return (1.0 - steady) * drifting + steady * (0.0 if own else limit.approach.before(0.0))


def _steady(line: Line) -> float:
    """Return the probability that a line does not drift [1]."""
    if not line.var_slope > 0.0:
        return float(line.slope == 0.0)
    count = line.freedom + 2.0
    against = 1.0 + line.slope**2 / line.var_slope / line.freedom
    factor = STEADY * count**0.5 * against ** (-0.5 * count)
    return float(factor / (factor + 1.0 - STEADY))


def without_forecast(trend: Trend) -> Trend:
    """Take the upper limit of the remaining life away, and the dates that rest on it.

    Parameters
    ----------
    trend : Trend
        Trend with its remaining life.
    """
    return altered(
        trend,
        unbounded=True,
        remaining_high=float("inf") if np.isfinite(trend.threshold) else trend.remaining_high,
        service_date_known=False,
        service_date_ns=0,
        service_date_early_ns=0,
    )
