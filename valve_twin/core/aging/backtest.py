# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Judge forecasts of the remaining useful life (RUL) by what the history did afterwards.

A life runs from one maintenance event to the next. Its end is where the lines through the whole
life, seen in hindsight, first reach the service limit. Where no limit was reached the level of the
last cycle stands for one, if the drift to it is beyond doubt. Every forecast is what the aging
monitor would have said that day: the same function of the history up to there. Each is asked for
the probability that the limit is reached before a next stop (`STOPS`); Brier's score of it is
compared with that of the base rate.

Coverage is the share of forecasts whose limits hold the end. Alpha-lambda is the accuracy of
Saxena et al. (2010), "Metrics for offline evaluation of prognostic performance": whether the
median lies within +-alpha of the true remaining life when a share lambda of the time from the
first forecast to the end has passed. Forecasts of one life share their data, so a share of them
is no count of independent trials; and the hindsight knows the same scatter, which makes the last
forecasts look better than they were.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import TrendDetail, assess
from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.aging.drift import wanted_limits
from valve_twin.core.aging.series import in_force, order_history, series_of
from valve_twin.core.aging.verdict import Trend, TrendStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.aging.laws.shapes import LawFit
    from valve_twin.core.types import Estimate, FloatArray, IntArray, Maintenance, Parameter

LAMBDAS = (0.25, 0.5, 0.75)
"""Shares of the time from the first forecast to the end at which accuracy is reported [1]."""

STOPS = (0.1, 0.25, 0.5, 1.0)
"""Next stops that the forecasts are asked about in turn, in lengths of the life [1]."""

_NAN = float("nan")
_PLACES = 2001  # along a bent trend, where its end is sought


@dataclass(frozen=True, slots=True)
class BacktestConfig:
    """How forecasts are judged.

    Attributes
    ----------
    confidence : float
        Of the limits of the remaining life [1].
    alpha : float
        Relative error of the median that counts as accurate [1].
    most : int
        Most forecasts of one life, evenly over its estimates.
    """

    confidence: float = 0.9
    alpha: float = 0.2
    most: int = 100


@dataclass(frozen=True, slots=True)
class Forecast:
    """What was forecast at one cycle, and what was true.

    Attributes
    ----------
    axis : float
        Where it was made [axis unit].
    low, median, high : float
        Forecast remaining life, infinite = none in sight [axis unit].
    truth : float
        Remaining life in hindsight [axis unit].
    stop : float
        The next stop it was asked about, ahead [axis unit].
    probability : float
        Forecast probability that the limit is reached before that stop [1].
    """

    axis: float
    low: float
    median: float
    high: float
    truth: float
    stop: float = _NAN
    probability: float = _NAN

    @property
    def covers(self) -> bool:
        """Whether the limits hold the truth; no upper limit holds everything above the lower."""
        return self.low <= self.truth <= self.high

    @property
    def unbounded(self) -> bool:
        """Whether there is no upper limit."""
        return self.high == float("inf")

    @property
    def came(self) -> bool:
        """Whether the limit was reached before the stop."""
        return self.truth <= self.stop

    @property
    def error(self) -> float:
        """Relative error of the median, (forecast - true)/true [1]; infinite = none in sight."""
        return (self.median - self.truth) / self.truth if self.truth > 0.0 else _NAN


@dataclass(frozen=True, slots=True)
class LifeTest:
    """The forecasts of one parameter over one life.

    Attributes
    ----------
    parameter : str
        Its name.
    start, end : float
        Where the life begins and where its limit was reached [axis unit]; `end` NaN = never.
    limit : Threshold or None
        The limit that the forecasts are made for; None where there is none.
    limit_value : float
        The same in the unit of the parameter.
    reached : bool
        Whether it is the service limit; False = the level of the last cycle stands for one.
    forecasts : tuple of Forecast
        In the order of time.
    silent : int
        Cycles at which no forecast was made yet.
    reason : str
        Why there is nothing to judge; empty where there is.
    """

    parameter: str
    start: float
    end: float = _NAN
    limit: Threshold | None = None
    limit_value: float = _NAN
    reached: bool = False
    forecasts: tuple[Forecast, ...] = ()
    silent: int = 0
    reason: str = ""

    @property
    def coverage(self) -> float:
        """Share of the forecasts whose limits hold the end [1]; NaN where there are none."""
        return _share([f.covers for f in self.forecasts])

    @property
    def unbounded(self) -> float:
        """Share of the forecasts without an upper limit [1]."""
        return _share([f.unbounded for f in self.forecasts])

    @property
    def brier(self) -> float:
        """Mean squared error of the probabilities to reach the limit before the stops [1]."""
        return _mean([(f.probability - f.came) ** 2 for f in self.forecasts])

    @property
    def brier_skill(self) -> float:
        """Brier skill score against the base rate, 1 = knows the future; NaN where all agree."""
        came = [float(f.came) for f in self.forecasts]
        base = _mean([(c - _mean(came)) ** 2 for c in came])
        return 1.0 - self.brier / base if base > 0.0 else _NAN

    def accurate(self, alpha: float) -> float:
        """Return the share of the forecasts whose median is within +-alpha of the truth [1]."""
        return _share([abs(f.error) <= alpha for f in self.forecasts])

    def at(self, share: float) -> Forecast | None:
        """Return the first forecast after a share of the time from the first to the end."""
        if not self.forecasts:
            return None
        first = self.forecasts[0].axis
        place = first + share * (self.end - first)
        return next((f for f in self.forecasts if f.axis >= place), None)


def backtest(
    history: Sequence[Estimate],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    *,
    parameters: Sequence[Parameter],
    how: BacktestConfig | None = None,
    on_forecast: Callable[[], object] = lambda: None,
) -> tuple[LifeTest, ...]:
    """Judge the remaining lives that the aging monitor would have forecast for one valve.

    Parameters
    ----------
    history : sequence of Estimate
        The whole stored history, any order.
    maintenance : sequence of Maintenance
        All maintenance events of the valve; those withdrawn begin nothing.
    config : AgingConfig
        What is followed, and its service limits.
    parameters : sequence of Parameter
        What the valve's model publishes.
    how : BacktestConfig, optional
        How it is judged; defaults where omitted.
    on_forecast : callable
        Called after each forecast.

    Returns
    -------
    tuple of LifeTest
        One a followed parameter and life; those without a forecast say why.
    """
    maintenance = in_force(maintenance)
    names = config.parameters or tuple(p.name for p in parameters if p.trend)
    place = order_history(history, config.axis).place
    trend = [e for e in history if e.used_by_trend]
    ordered = tuple(trend[i] for i in place.tolist())
    places = _places(ordered, maintenance)
    starts = sorted({0, *(at for at in places if at < len(ordered))}) if ordered else []
    tests = []
    for name in names:
        one = replace(config, parameters=(name,))
        for first, last in itertools.pairwise([*starts, len(ordered)]):
            past = tuple(m for m, at in zip(maintenance, places, strict=True) if at <= first)
            life = _Life(name, ordered, first, last, past, one, tuple(parameters))
            tests.append(_judge(life, how or BacktestConfig(), on_forecast))
    return tuple(tests)


@dataclass(frozen=True, slots=True)
class _Life:
    """One stretch of a history: indexes `first` to `last` (without) of the ordered estimates.

    `events` are the maintenance events before its end, the one that began it included.
    """

    parameter: str
    ordered: tuple[Estimate, ...]
    first: int
    last: int
    events: tuple[Maintenance, ...]
    config: AgingConfig
    parameters: tuple[Parameter, ...]

    def seen(self, end: int, config: AgingConfig, confidence: float) -> tuple[Trend, TrendDetail]:
        """Return what was known when `end` estimates were there."""
        found = assess(
            self.ordered[:end],
            self.events,
            config,
            parameters=self.parameters,
            confidence=confidence,
        )
        return found.trends[0], found.details[0]


def _places(ordered: Sequence[Estimate], maintenance: Sequence[Maintenance]) -> list[int]:
    """Return the index of the first estimate after each event."""
    cycle = np.array([e.cycle for e in ordered], dtype=np.int64)
    start = np.array([e.start_ns for e in ordered], dtype=np.int64)
    monotone = bool(np.all(np.diff(cycle) > 0))
    return [
        int(np.searchsorted(cycle, m.cycle))
        if m.cycle > 0 and monotone
        else int(np.searchsorted(start, m.stamp_ns))
        for m in maintenance
    ]


def _judge(life: _Life, how: BacktestConfig, on_forecast: Callable[[], object]) -> LifeTest:
    trend, detail = life.seen(life.last, replace(life.config, window=0), 0.95)
    begin = life.ordered[life.first]
    inside = np.flatnonzero(_indexes(life, len(detail.axis)) >= life.first)
    if not len(inside):
        return LifeTest(life.parameter, _NAN, reason="no accepted estimate in this life")
    test = LifeTest(life.parameter, float(detail.axis[inside[0]]))
    if trend.status is TrendStatus.NOT_ENOUGH_DATA:
        return replace(test, reason=f"cycle {begin.cycle} on: {trend.reason}")
    crossing = _service_limit(trend, detail, life.config, int(inside[0]))
    found = crossing or _last_level(trend)
    if found is None:
        return replace(test, reason=f"no limit reached and no drift to foresee: {trend.reason}")
    limit, value, end = found
    test = replace(test, end=end, limit=limit, limit_value=value, reached=crossing is not None)
    config = replace(life.config, thresholds=(limit,), default_percent=0.0)
    forecasts, silent = [], 0
    for number, at in enumerate(_chosen(life, detail, end, how.most)):
        stop = (end - test.start) * STOPS[number % len(STOPS)]
        stopping = replace(config, next_stop=repr(stop))
        now, _ = life.seen(int(at) + 1, stopping, how.confidence)
        on_forecast()
        if now.status is TrendStatus.NOT_ENOUGH_DATA or not np.isfinite(now.threshold):
            silent += 1
            continue
        forecasts.append(_forecast(now, end, stop))
    reason = "" if forecasts else f"nothing was forecast before the end at {end:.6g}"
    return replace(test, forecasts=tuple(forecasts), silent=silent, reason=reason)


def _forecast(trend: Trend, end: float, stop: float) -> Forecast:
    return Forecast(
        axis=trend.axis_value,
        low=trend.remaining_low,
        median=trend.remaining_median,
        high=trend.remaining_high,
        truth=end - trend.axis_value,
        stop=stop,
        probability=trend.next_stop_probability,
    )


def _indexes(life: _Life, samples: int) -> IntArray:
    """Return the (N,) index among the ordered estimates of every accepted value."""
    part = order_history(life.ordered[: life.last], life.config.axis)
    series = series_of(part, life.parameter)
    assert len(series.axis) == samples
    return np.searchsorted(part.axis, series.axis).astype(np.int64)


def _chosen(life: _Life, detail: TrendDetail, end: float, most: int) -> IntArray:
    """Return at most `most` indexes of the ordered estimates at which forecasts are made."""
    index = _indexes(life, len(detail.axis))
    good = index[(index >= life.first) & (detail.axis < end)]
    if len(good) <= most:
        return good
    return good[np.unique(np.linspace(0, len(good) - 1, most).round().astype(np.int64))]


def _service_limit(
    trend: Trend, detail: TrendDetail, config: AgingConfig, first: int
) -> tuple[Threshold, float, float] | None:
    """Return the service limit that was reached first, its value and where; None = none was."""
    found = []
    for limit in wanted_limits(config, trend.parameter):
        value = limit.value
        if limit.relative:
            value = (1.0 + limit.value / 100.0) * trend.reference
        end = _crossing(trend, detail, value, first)
        if end is not None:
            found.append((limit, value, end))
    return min(found, key=lambda f: f[2], default=None)


def _crossing(trend: Trend, detail: TrendDetail, value: float, first: int) -> float | None:
    """Return where the lines of a life first reach a value, None where they never do."""
    new = trend.reference if np.isfinite(trend.reference) else trend.level
    if not np.isfinite(value) or (value == new):
        return None
    toward = 1.0 if value > new else -1.0
    edges = [*detail.starts.tolist(), len(detail.axis)]
    for line, (begin, after) in zip(detail.lines, itertools.pairwise(edges), strict=True):
        if line is None or after <= first:
            continue
        if after == len(detail.axis) and detail.laws is not None and detail.laws.bends:
            return _bent_crossing(detail.laws, detail.axis[max(begin, first) :], value, toward)
        low, high = float(detail.axis[max(begin, first)]), float(detail.axis[after - 1])
        if toward * (line.level(low) - value) >= 0.0:
            return low
        if toward * (line.level(high) - value) >= 0.0:
            return line.center + (value - line.mean) / line.slope
    return None


def _bent_crossing(laws: LawFit, axis: FloatArray, value: float, toward: float) -> float | None:
    """Return where the most probable law first reaches a value along (N,) axis positions."""
    places = np.linspace(float(axis[0]), float(axis[-1]), _PLACES)
    beyond = np.flatnonzero(toward * (laws.curve(places, laws.best) - value) >= 0.0)
    return float(places[beyond[0]]) if len(beyond) else None


def _last_level(trend: Trend) -> tuple[Threshold, float, float] | None:
    """Return the level of the last cycle as a limit where the drift to it is beyond doubt."""
    change = trend.drift_reference
    sure = trend.drift_reference_lower_95 * trend.drift_reference_upper_95 > 0.0
    if trend.status is TrendStatus.STEADY or not (np.isfinite(change) and sure):
        return None
    return Threshold(trend.parameter, change), trend.level, trend.axis_value


def _share(marks: Sequence[bool]) -> float:
    return _mean([float(mark) for mark in marks])


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else _NAN
