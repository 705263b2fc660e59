# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Drift of a parameter against its level when new, and the threshold it will reach first.

The reference is often the mean of values that the present segment holds as well; level, change
and reference are linear in the values, so their joint covariance is exact under AR(1) scatter and
enters the limits of the drift and of the remaining life.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.aging.altered import altered
from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.aging.laws.ar1 import ar1_leading, ar1_product
from valve_twin.core.aging.laws.fit import fit_laws
from valve_twin.core.aging.laws.shapes import LawFit, condense
from valve_twin.core.aging.life import NEVER, Approach, Remaining
from valve_twin.core.aging.series import Part, Pieces, Series, first_after
from valve_twin.core.aging.trend import Line, base_of, line_weights, quantile, ratio_interval
from valve_twin.core.estimation.data.one_thread import dot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import FloatArray, IntArray, Maintenance

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Present:
    """The present segment.

    Attributes
    ----------
    line : Line
        Its level and slope now: the line through it, or where it bends the mean of its laws.
    fit : LawFit
        The laws that its values allow.
    now : (N,) array
        Weights of what was fitted to, good values or means of neighbours, that give the level now.
    start, cross, var_start : float
        Level at the start of the segment [unit], its covariance with that now and its variance
        [unit^2].
    """

    line: Line
    fit: LawFit
    now: FloatArray
    start: float
    cross: float
    var_start: float


def present_segment(
    series: Series, pieces: Pieces, part: Part, line: Line, laws: Sequence[str]
) -> Present:
    """Return what is known of the newest segment.

    Parameters
    ----------
    series : Series
        Values of one parameter.
    pieces : Pieces
        Its segments; the last has 4 good values or more.
    part : Part
        Those values.
    line : Line
        The line through them.
    laws : sequence of str
        Laws that are allowed; empty = all.
    """
    x, y, offsets, sums = part
    shared = line.autocorrelation if len(pieces.starts) > 1 else None
    blocks = None
    if offsets is not None:
        blocks = np.column_stack([condense(x, column)[1] for column in offsets.T])
    fit = fit_laws(*condense(x, y), laws, autocorrelation=shared, offsets=blocks)
    start, now = float(series.axis[pieces.starts[-1]]), float(series.axis[-1])
    if not fit.bends:
        if offsets is None:
            center, square, mean = sums.center, sums.square, 1.0 / len(x)
            weights = (now - center) / square * (x - center) + mean
        else:
            center, level, slope = line_weights(x, offsets)
            weights = level + (now - center) * slope
        a, b = now - line.center, start - line.center
        cross = line.var_mean + (a + b) * line.cov + a * b * line.var_slope
        return Present(line, fit, weights, line.level(start), cross, line.level_variance(start))
    rest = y - fit.curve(x, fit.best)
    if offsets is not None:
        rest = base_of(offsets).without(rest)
    sigma = (dot(rest, rest) / max(len(y) - 3, 1)) ** 0.5
    line = fit.tangent(now, samples=len(y), sigma=sigma)
    here, begin, rho = fit.average(now), fit.average(start), max(line.autocorrelation, 0.0)
    cross, own = (sigma**2 * ar1_product(w, begin, rho) for w in (here, begin))
    return Present(line, fit, here, dot(begin, fit.values), cross, own)


@dataclass(frozen=True, slots=True)
class Reference:
    """Level when new, and its covariance with the present segment.

    Attributes
    ----------
    value : float
        The level [unit]; NaN where it is not known yet.
    source : str
        first_cycles or commissioning.
    variance : float
        Of the level [unit^2].
    weights : (M,) array
        Its weights on the first good values of the present segment; empty where it shares none.
    count : int
        Good values of the present segment [1].
    scale : float
        Standard deviation of the scale of all changes against the level [1]: it moves a remaining
        life, and no drift from one side of it to the other.
    """

    value: float
    source: str
    variance: float = 0.0
    weights: FloatArray = field(default_factory=lambda: np.empty(0))
    count: int = 0
    scale: float = 0.0

    def covariance(self, weights: FloatArray, variance: float, rho: float) -> float:
        """Return the covariance with something else that is linear in the same values [unit^2].

        Parameters
        ----------
        weights : (M,) array
            Its weights on the values [1].
        variance : float
            Of a single value [unit^2].
        rho : float
            Lag-1 autocorrelation of the values [1].
        """
        if len(weights) != self.count or not len(self.weights):
            return 0.0
        return variance * float(ar1_leading(self.weights, weights[None], max(rho, 0.0))[0])

    def covariances(self, rows: FloatArray, variance: FloatArray, rho: float) -> FloatArray:
        """Return the covariance with K other values of which each has a variance, (K,) [unit^2].

        Parameters
        ----------
        rows : (K, M) array
            Their weights on the values [1].
        variance : (K,) array
            Of a single value [unit^2].
        rho : float
            Lag-1 autocorrelation of the values [1].
        """
        if rows.shape[1] != self.count or not len(self.weights):
            return np.zeros(len(rows))
        return variance * ar1_leading(self.weights, rows, max(rho, 0.0))


@dataclass(frozen=True, slots=True)
class Limit:
    """One threshold and its warning in the unit of the parameter, and what remains to it."""

    value: float
    beyond: bool
    remaining: Remaining
    approach: Approach | None = None
    warning: float = _NAN


NO_LIMIT = Limit(_NAN, False, NEVER)


def find_reference(
    name: str,
    series: Series,
    pieces: Pieces,
    lines: tuple[Line | None, ...],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
) -> Reference:
    """Return the commissioning record, or the mean of the first cycles (of the last new start).

    Parameters
    ----------
    name : str
        Parameter.
    series : Series
        Its accepted estimates.
    pieces : Pieces
        Where its trend is broken, and its outliers.
    lines : tuple of Line or None
        The line of each piece.
    maintenance : sequence of Maintenance
        Events of the valve.
    config : AgingConfig
        Commissioning records, number of reference cycles.
    """
    restarts = [first_after(series, m) for m in maintenance if m.new_reference]
    record = next((c for c in config.commissioning if c.parameter == name), None)
    if record is not None and not restarts:
        return Reference(record.value, "commissioning", record.standard_error**2)
    first = max(restarts, default=0)
    kept = first + np.flatnonzero(~pieces.outlier[first:])[: config.reference_cycles]
    if len(kept) < config.reference_cycles:
        return Reference(_NAN, "first_cycles")
    return _mean_reference(kept, series, pieces, lines)


def _mean_reference(
    kept: IntArray, series: Series, pieces: Pieces, lines: tuple[Line | None, ...]
) -> Reference:
    """Return the mean of the values `kept`; other pieces scatter independently of the present."""
    begin, used = int(pieces.starts[-1]), _used(lines)
    own = lines[-1].sigma ** 2 if lines[-1] is not None else 0.0
    inside = kept >= begin
    outside = ~inside / len(kept)
    weight = np.empty(0)
    if inside.any():
        place = np.cumsum(~pieces.outlier[begin : kept[-1] + 1])[kept[inside] - begin] - 1
        weight = np.zeros(place[-1] + 1)
        weight[place] = 1.0 / len(kept)
    return Reference(
        value=float(series.values[kept].mean()),
        source="first_cycles",
        variance=own * ar1_product(weight, weight, used)
        + _pooled_variance(lines) * ar1_product(outside, outside, used),
        weights=weight,
        count=int(np.count_nonzero(~pieces.outlier[begin:])),
    )


def _used(lines: tuple[Line | None, ...]) -> float:
    """Return the autocorrelation of some lines that counts [1]."""
    return max(max((f.autocorrelation for f in lines if f is not None), default=0.0), 0.0)


def _pooled_variance(lines: tuple[Line | None, ...]) -> float:
    fits = [f for f in lines if f is not None]
    weights = [max(f.samples - 2, 1) for f in fits]
    return sum(w * f.sigma**2 for w, f in zip(weights, fits, strict=True)) / sum(weights)


def with_drift(
    trend: Trend, present: Present, reference: Reference, resolution: float = 0.0
) -> Trend:
    """Add the drift against the reference and against the start of the segment, in percent.

    Parameters
    ----------
    trend : Trend
        Trend without drift.
    present : Present
        Its present segment.
    reference : Reference
        What the drift is counted from.
    resolution : float
        Resolution of the parameter [unit of the parameter]: scatter between cycles does not show
        it.
    """
    line = present.line
    rho, variance = line.autocorrelation, line.sigma**2
    t = quantile(line.freedom, 0.95)
    var_level = line.level_variance(trend.axis_value)
    since_new = _percent(
        trend.level,
        reference.value,
        ratio_interval(
            trend.level,
            reference.value,
            var_a=var_level,
            cov=reference.covariance(present.now, variance, rho),
            var_b=reference.variance,
            t=t,
        ),
        resolution,
    )
    start = present.start
    since_start = _percent(
        trend.level,
        start,
        ratio_interval(
            trend.level, start, var_a=var_level, cov=present.cross, var_b=present.var_start, t=t
        ),
        resolution,
    )
    return altered(
        trend,
        reference=reference.value,
        reference_source=reference.source,
        drift_reference=since_new[0],
        drift_reference_lower_95=since_new[1],
        drift_reference_upper_95=since_new[2],
        drift_segment=since_start[0],
        drift_segment_lower_95=since_start[1],
        drift_segment_upper_95=since_start[2],
    )


def _percent(
    a: float, b: float, limits: tuple[float, float], resolution: float
) -> tuple[float, float, float]:
    """Return a/b - 1 and its limits in percent; NaN where b does not differ from zero."""
    low, high = limits
    if not np.isfinite(low):
        return _NAN, _NAN, _NAN
    wider = resolution / abs(b)
    return 100.0 * (a / b - 1.0), 100.0 * (low - wider - 1.0), 100.0 * (high + wider - 1.0)


def nearest_limit(
    trend: Trend,
    present: Present,
    reference: Reference,
    config: AgingConfig,
    *,
    confidence: float = 0.95,
    held: Sequence[Threshold] = (),
    warned: Sequence[Threshold] = (),
    now: float,
) -> Limit:
    """Return the threshold that counts: passed, else warned of, else soonest, else nearest.

    Parameters
    ----------
    trend : Trend
        Trend with its drift.
    present : Present
        Its present segment.
    reference : Reference
        What relative thresholds refer to.
    config : AgingConfig
        Thresholds.
    confidence : float
        That of the limits of what remains [1].
    held, warned : sequence of Threshold
        Those that count as passed, and those whose warning limit does (`core.aging.limits`).
    now : float
        Position of the newest cycle, with a value or without, from which that counts [axis unit].
    """
    wanted = wanted_limits(config, trend.parameter)
    known = _known_of(present.fit, reference) if wanted else None
    given = (trend, present, reference, confidence)
    limits = [(t, _life_to(t, *given, known, now)) for t in wanted if known]
    usable = [
        (
            t in warned,
            altered(
                _passed(m) if t in held else m,
                warning=reference.value + config.warning_share(t) * (m.value - reference.value),
            ),
        )
        for t, m in limits
        if np.isfinite(m.value)
    ]
    _, limit = min(
        usable,
        key=lambda found: (
            not found[1].beyond,
            not found[0],
            found[1].remaining.median,
            found[1].remaining.low,
            abs(found[1].value - trend.level),
        ),
        default=(False, NO_LIMIT),
    )
    return limit


def _passed(limit: Limit) -> Limit:
    """Return a limit as one that is passed: nothing remains to it."""
    low, high = limit.remaining.low, limit.remaining.high
    return altered(limit, beyond=True, remaining=Remaining(low, 0.0, high))


def wanted_limits(config: AgingConfig, parameter: str) -> list[Threshold]:
    """Return the limits of a parameter; those of `default_percent` where it has none."""
    own = [side for t in config.thresholds if t.parameter == parameter for side in t.sides()]
    if own or not config.default_percent > 0.0:
        return own
    return [Threshold(parameter, sign * config.default_percent) for sign in (-1.0, 1.0)]


class _Known(NamedTuple):
    """Variances of level and change of every shape, and covariances with the reference, (K,)."""

    level: FloatArray
    both: FloatArray
    change: FloatArray
    level_reference: FloatArray
    change_reference: FloatArray


def _known_of(fit: LawFit, reference: Reference) -> _Known:
    rho, squares = fit.autocorrelation, fit.sigma**2
    weights = (fit.level_weights, fit.change_weights)
    shared = (reference.covariances(rows, squares, rho) for rows in weights)
    return _Known(*fit.covariances(), *shared)


def _life_to(
    threshold: Threshold,
    trend: Trend,
    present: Present,
    reference: Reference,
    confidence: float,
    known: _Known,
    now: float,
) -> Limit:
    """Return one threshold and what remains to it; a relative one shares the reference's doubt."""
    if threshold.relative:
        if not np.isfinite(trend.drift_reference):
            return NO_LIMIT
        scale = 1.0 + threshold.value / 100.0
        value = scale * reference.value
    else:
        scale, value = 0.0, threshold.value
    if not np.isfinite(value):
        return NO_LIMIT
    new = reference.value if np.isfinite(reference.value) else present.start
    toward = 1.0 if value >= new else -1.0
    fit = present.fit
    moved, change = reference.scale * (fit.level - new), reference.scale * fit.change
    shared = known.level - 2.0 * scale * known.level_reference
    approach = Approach(
        fit=fit,
        now=now,
        gap=toward * (fit.level - value),
        change=toward * fit.change,
        var_gap=shared + scale**2 * reference.variance + moved**2,
        cov=known.both - scale * known.change_reference + moved * change,
        var_change=known.change + change**2,
    )
    life = approach.remaining(confidence)
    limit = Limit(value, False, life, approach)
    return _passed(limit) if toward * (value - trend.level) <= 0.0 else limit
