# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Drift of a parameter against its level when new, and the threshold it will reach first.

The reference is often the mean of values that the present line is fitted to as well; level, slope
and reference are linear in the values, so their joint covariance is exact under AR(1) scatter and
enters the limits of the drift and of the remaining life.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.config import AgingConfig, Threshold
from valve_twin.core.aging.life import NEVER, Remaining, remaining_life
from valve_twin.core.aging.series import Pieces, Series, first_after
from valve_twin.core.aging.trend import Line, ar1_product, quantile, ratio_interval

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import IntArray, Maintenance

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class Reference:
    """Level when new, and its covariance with the present level and slope.

    Attributes
    ----------
    value : float
        The level [unit]; NaN where it is not known yet.
    source : str
        first_cycles or commissioning.
    variance, cov_level, cov_slope : float
        Variance [unit^2], covariance with the present level [unit^2] and slope [unit^2/axis unit].
    """

    value: float
    source: str
    variance: float = 0.0
    cov_level: float = 0.0
    cov_slope: float = 0.0


@dataclass(frozen=True, slots=True)
class Limit:
    """One threshold in the unit of the parameter, and what remains to it."""

    value: float
    beyond: bool
    remaining: Remaining


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
    line = lines[-1]
    assert line is not None
    present = np.flatnonzero(~pieces.outlier)
    present = present[present >= pieces.starts[-1]]
    weight = np.isin(present, kept) / len(kept)
    d = series.axis[present] - line.center
    rho, variance = max(line.autocorrelation, 0.0), line.sigma**2
    w_slope = d / float(d @ d)
    w_level = 1.0 / len(present) + (series.axis[-1] - line.center) * w_slope
    outside = np.isin(kept, present, invert=True) / len(kept)
    return Reference(
        value=float(series.values[kept].mean()),
        source="first_cycles",
        variance=variance * ar1_product(weight, weight, rho)
        + _pooled_variance(lines) * ar1_product(outside, outside, rho),
        cov_level=variance * ar1_product(weight, w_level, rho),
        cov_slope=variance * ar1_product(weight, w_slope, rho),
    )


def _pooled_variance(lines: tuple[Line | None, ...]) -> float:
    fits = [f for f in lines if f is not None]
    weights = [max(f.samples - 2, 1) for f in fits]
    return sum(w * f.sigma**2 for w, f in zip(weights, fits, strict=True)) / sum(weights)


def with_drift(trend: Trend, line: Line, reference: Reference, resolution: float = 0.0) -> Trend:
    """Add the drift against the reference and against the start of the segment, in percent.

    Parameters
    ----------
    trend : Trend
        Trend without drift.
    line : Line
        Line of its present segment.
    reference : Reference
        What the drift is counted from.
    resolution : float
        Resolution of the parameter [unit of the parameter]: scatter between cycles does not show
        it.
    """
    t = quantile(line.freedom, 0.95)
    var_level = line.level_variance(trend.axis_value)
    since_new = _percent(
        trend.level,
        reference.value,
        ratio_interval(
            trend.level,
            reference.value,
            var_a=var_level,
            cov=reference.cov_level,
            var_b=reference.variance,
            t=t,
        ),
        resolution,
    )
    start, now = trend.segment_start, trend.axis_value
    cov = (
        line.var_mean
        + (start + now - 2.0 * line.center) * line.cov
        + (start - line.center) * (now - line.center) * line.var_slope
    )
    since_start = _percent(
        trend.level,
        line.level(start),
        ratio_interval(
            trend.level,
            line.level(start),
            var_a=var_level,
            cov=cov,
            var_b=line.level_variance(start),
            t=t,
        ),
        resolution,
    )
    return replace(
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
    line: Line,
    reference: Reference,
    config: AgingConfig,
    *,
    confidence: float = 0.95,
) -> Limit:
    """Return the threshold that is reached first: beyond already, else soonest, else nearest.

    Parameters
    ----------
    trend : Trend
        Trend with its drift.
    line : Line
        Line of its present segment.
    reference : Reference
        What relative thresholds refer to.
    config : AgingConfig
        Thresholds.
    confidence : float
        That of the limits of what remains [1].
    """
    wanted = [t for t in config.thresholds if t.parameter == trend.parameter]
    if not wanted and config.default_percent > 0.0:
        wanted = [
            Threshold(trend.parameter, -config.default_percent),
            Threshold(trend.parameter, config.default_percent),
        ]
    limits = [_life_to(t, trend, line, reference, confidence) for t in wanted]
    usable = [limit for limit in limits if np.isfinite(limit.value)]
    return min(
        usable,
        key=lambda m: (
            not m.beyond,
            m.remaining.median,
            m.remaining.low,
            abs(m.value - trend.level),
        ),
        default=NO_LIMIT,
    )


def _life_to(
    threshold: Threshold, trend: Trend, line: Line, reference: Reference, confidence: float
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
    new = reference.value if np.isfinite(reference.value) else line.level(trend.segment_start)
    toward = 1.0 if value >= new else -1.0
    gap = toward * (value - trend.level)
    offset = trend.axis_value - line.center
    life = remaining_life(
        gap,
        toward * line.slope,
        var_gap=max(
            scale**2 * reference.variance
            - 2.0 * scale * reference.cov_level
            + line.level_variance(trend.axis_value),
            0.0,
        ),
        cov=scale * reference.cov_slope - (line.cov + offset * line.var_slope),
        var_slope=line.var_slope,
        freedom=line.freedom,
        confidence=confidence,
    )
    return Limit(value, gap <= 0.0, life)
