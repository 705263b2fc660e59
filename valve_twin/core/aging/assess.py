# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Assess the aging of one valve from everything that is stored about it.

A pure function of the history: a monitor that was down, or one that starts anew, says exactly what one says that has
been running all the time. Times are the data's own; no clock is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from valve_twin.core.aging.config import AgingConfig, Axis, Threshold
from valve_twin.core.aging.life import NEVER, Remaining, axis_rate, date_after, remaining_life
from valve_twin.core.aging.series import (
    History,
    Pieces,
    Series,
    cut,
    first_after,
    order_history,
    series_of,
)
from valve_twin.core.aging.trend import (
    Line,
    ar1_product,
    fit_line,
    pooled_autocorrelation,
    quantile,
    ratio_interval,
    residuals,
)
from valve_twin.core.aging.verdict import Trend, TrendStatus, Verdict, decide, describe_remaining
from valve_twin.core.types import (
    BoolArray,
    Estimate,
    FloatArray,
    IntArray,
    Maintenance,
    Parameter,
)

_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class TrendDetail:
    """What a trend was computed from, for plots.

    Attributes
    ----------
    parameter : str
        Name.
    axis, values : (N,) arrays
        Accepted estimates over the axis [axis unit], [unit].
    cycle : (N,) int64 array
        Their cycle numbers.
    wild : (N,) bool array
        Estimates left out as outliers.
    starts : (K,) int64 array
        First index of each segment; N where the present one is still empty.
    lines : tuple of Line or None
        The fit of each segment, None where it has fewer than 4 values; the last is the published one.
    """

    parameter: str
    axis: FloatArray
    values: FloatArray
    cycle: IntArray
    wild: BoolArray
    starts: IntArray
    lines: tuple[Line | None, ...]


@dataclass(frozen=True, slots=True)
class Assessment:
    """Trends and verdict of one valve; `details` are in the order of `trends`."""

    trends: tuple[Trend, ...]
    verdict: Verdict
    details: tuple[TrendDetail, ...]


@dataclass(frozen=True, slots=True)
class _Reference:
    """Level when new, and its covariance with the present level and slope."""

    value: float
    source: str
    variance: float = 0.0
    cov_level: float = 0.0
    cov_slope: float = 0.0


@dataclass(frozen=True, slots=True)
class _Limit:
    """One threshold in the unit of the parameter, and what remains to it."""

    value: float
    beyond: bool
    remaining: Remaining


_NO_LIMIT = _Limit(_NAN, False, NEVER)


def assess(
    history: Sequence[Estimate],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    *,
    parameters: Sequence[Parameter],
    valve: str = "",
) -> Assessment:
    """Assess the aging of one valve.

    Parameters
    ----------
    history : sequence of Estimate
        The whole stored history, any order; only estimates with `used_by_trend` count.
    maintenance : sequence of Maintenance
        All maintenance events of the valve.
    config : AgingConfig
        What to follow and when to speak.
    parameters : sequence of Parameter
        What the valve's model publishes; `trend` marks those followed by default.
    valve : str
        Name of the valve, copied into the results.

    Returns
    -------
    Assessment
        One trend a followed parameter, and the verdict.
    """
    known = {p.name: p for p in parameters}
    names = config.parameters or tuple(p.name for p in parameters if p.trend)
    ordered = order_history(history, config.axis)
    results = [
        _assess_parameter(
            name, known[name].unit if name in known else "1", ordered, maintenance, config, valve
        )
        for name in names
    ]
    trends = tuple(trend for trend, _ in results)
    last = ordered.estimates[-1] if ordered.estimates else None
    verdict = decide(
        trends,
        config,
        valve=valve,
        stamp_ns=last.end_ns if last else 0,
        cycle=last.cycle if last else 0,
    )
    return Assessment(trends, verdict, tuple(detail for _, detail in results))


def _assess_parameter(
    name: str,
    unit: str,
    history: History,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    valve: str,
) -> tuple[Trend, TrendDetail]:
    series = series_of(history, name)
    pieces = cut(series, maintenance, config)
    lines = _fit_pieces(series, pieces)
    detail = TrendDetail(
        name, series.axis, series.values, series.cycle, pieces.wild, pieces.starts, lines
    )
    trend = _blank(name, unit, series, pieces, config, valve)
    if not len(series.values):
        return replace(trend, reason="no accepted estimate yet"), detail
    if len(history.axis) > 1:
        ends = np.array(
            [e.end_ns for e in history.estimates[-config.rate_cycles :]], dtype=np.int64
        )
        trend = replace(trend, cycle_rate=axis_rate(history.axis, ends, len(ends)))
    trend = _judge(trend, series, pieces, lines, maintenance, config)
    return replace(trend, reason=trend.reason + _caveats(series, pieces, config)), detail


def _blank(
    name: str, unit: str, series: Series, pieces: Pieces, config: AgingConfig, valve: str
) -> Trend:
    """Return a trend that knows where it stands but not yet what it says."""
    n = len(series.values)
    start = int(pieces.starts[-1]) if n else 0
    return Trend(
        stamp_ns=int(series.end_ns[-1]) if n else 0,
        valve=valve,
        parameter=name,
        unit=unit,
        axis=config.axis.value,
        status=TrendStatus.NOT_ENOUGH_DATA,
        reason="",
        samples=int(np.count_nonzero(~pieces.wild[start:])),
        segments=len(pieces.starts) if n else 0,
        segment_start=float(series.axis[start]) if start < n else _NAN,
        axis_value=float(series.axis[-1]) if n else _NAN,
    )


def _fit_pieces(series: Series, pieces: Pieces) -> tuple[Line | None, ...]:
    """Fit every piece; all share one autocorrelation, since the scatter is the same process in all of them."""
    parts = []
    edges = [*pieces.starts, len(series.values)]
    for first, last in zip(edges, edges[1:], strict=False):
        kept = np.arange(first, last)[~pieces.wild[first:last]]
        parts.append((series.axis[kept], series.values[kept]))
    rho = pooled_autocorrelation([residuals(x, y) for x, y in parts if len(x) >= 4])
    return tuple(fit_line(x, y, rho) if len(x) >= 4 else None for x, y in parts)


def _judge(
    trend: Trend,
    series: Series,
    pieces: Pieces,
    lines: tuple[Line | None, ...],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
) -> Trend:
    line = lines[-1]
    if line is None or line.samples < config.min_samples:
        since = "maintenance" if len(pieces.forced) and pieces.forced[-1] else "the segment began"
        return replace(
            trend,
            level=_NAN if line is None else line.level(trend.axis_value),
            reason=f"{trend.samples} of {config.min_samples} estimates since {since}",
        )
    reference = _find_reference(trend.parameter, series, pieces, lines, maintenance, config)
    trend = _with_line(trend, line)
    trend = _with_drift(trend, line, reference)
    limit = _nearest_limit(trend, line, reference, config)
    trend = _with_life(trend, limit)
    if limit.beyond:
        status = TrendStatus.BEYOND_THRESHOLD
    else:
        status = TrendStatus.DRIFTING if line.p_value < config.significance else TrendStatus.STEADY
    trend = replace(trend, status=status)
    return replace(trend, reason=_reason(trend))


def _with_line(trend: Trend, line: Line) -> Trend:
    slope, mean, single = (
        line.slope_interval(),
        line.mean_interval(trend.axis_value),
        line.prediction_interval(trend.axis_value),
    )
    return replace(
        trend,
        level=line.level(trend.axis_value),
        slope=line.slope,
        slope_lower_95=slope[0],
        slope_upper_95=slope[1],
        p_value=line.p_value,
        autocorrelation=line.autocorrelation,
        mean_lower_95=mean[0],
        mean_upper_95=mean[1],
        prediction_lower_95=single[0],
        prediction_upper_95=single[1],
    )


def _find_reference(
    name: str,
    series: Series,
    pieces: Pieces,
    lines: tuple[Line | None, ...],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
) -> _Reference:
    """Return the commissioning record, or the mean of the first accepted cycles (since the last new reference)."""
    restarts = [first_after(series, m) for m in maintenance if m.new_reference]
    record = next((c for c in config.commissioning if c.parameter == name), None)
    if record is not None and not restarts:
        return _Reference(record.value, "commissioning", record.standard_error**2)
    first = max(restarts, default=0)
    kept = first + np.flatnonzero(~pieces.wild[first:])[: config.reference_cycles]
    if len(kept) < config.reference_cycles:
        return _Reference(_NAN, "first_cycles")
    return _mean_reference(kept, series, pieces, lines)


def _mean_reference(
    kept: IntArray, series: Series, pieces: Pieces, lines: tuple[Line | None, ...]
) -> _Reference:
    """Return the mean of the values `kept` with its covariance; scatter of other pieces is independent of the present."""
    line = lines[-1]
    assert line is not None
    present = np.flatnonzero(~pieces.wild)
    present = present[present >= pieces.starts[-1]]
    weight = np.isin(present, kept) / len(kept)
    d = series.axis[present] - line.center
    rho, variance = max(line.autocorrelation, 0.0), line.sigma**2
    w_slope = d / float(d @ d)
    w_level = 1.0 / len(present) + (series.axis[-1] - line.center) * w_slope
    outside = np.isin(kept, present, invert=True) / len(kept)
    return _Reference(
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


def _with_drift(trend: Trend, line: Line, reference: _Reference) -> Trend:
    """Add the drift against the reference and against the start of the segment, in percent."""
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


def _percent(a: float, b: float, limits: tuple[float, float]) -> tuple[float, float, float]:
    """Return a/b - 1 and its limits in percent; NaN where b cannot be told from zero."""
    low, high = limits
    if not np.isfinite(low):
        return _NAN, _NAN, _NAN
    return 100.0 * (a / b - 1.0), 100.0 * (low - 1.0), 100.0 * (high - 1.0)


def _nearest_limit(trend: Trend, line: Line, reference: _Reference, config: AgingConfig) -> _Limit:
    """Return the threshold that is reached first: beyond already, else soonest, else the nearest one."""
    wanted = [t for t in config.thresholds if t.parameter == trend.parameter]
    if not wanted and config.default_percent > 0.0:
        wanted = [
            Threshold(trend.parameter, -config.default_percent),
            Threshold(trend.parameter, config.default_percent),
        ]
    limits = [_life_to(t, trend, line, reference) for t in wanted]
    usable = [limit for limit in limits if np.isfinite(limit.value)]
    return min(
        usable,
        key=lambda m: (
            not m.beyond,
            m.remaining.median,
            m.remaining.low,
            abs(m.value - trend.level),
        ),
        default=_NO_LIMIT,
    )


def _life_to(threshold: Threshold, trend: Trend, line: Line, reference: _Reference) -> _Limit:
    """Return one threshold and what remains to it; a relative threshold shares the doubt of the reference."""
    if threshold.relative:
        if not np.isfinite(trend.drift_reference):
            return _NO_LIMIT
        scale = 1.0 + threshold.value / 100.0
        value = scale * reference.value
    else:
        scale, value = 0.0, threshold.value
    if not np.isfinite(value):
        return _NO_LIMIT
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
    )
    return _Limit(value, gap <= 0.0, life)


def _with_life(trend: Trend, limit: _Limit) -> Trend:
    """Add the remaining life and the service date; a date is given only where the life is bounded."""
    life = limit.remaining
    rate = trend.cycle_rate
    date = date_after(trend.stamp_ns, life.median, rate)
    return replace(
        trend,
        threshold=limit.value,
        unbounded=life.unbounded,
        remaining_low=life.low,
        remaining_median=life.median,
        remaining_high=life.high,
        service_date_known=date > 0 and not life.unbounded,
        service_date_ns=date if not life.unbounded else 0,
        service_date_early_ns=date_after(trend.stamp_ns, life.low, rate)
        if not life.unbounded
        else 0,
    )


def _reason(trend: Trend) -> str:
    """Return the status in one line."""
    unit = "hour" if trend.axis == Axis.HOURS.value else "cycle"
    if trend.status is TrendStatus.STEADY:
        return f"no significant slope in {trend.samples} estimates (p = {trend.p_value:.2g})"
    slope = f"slope {trend.slope:.3g} {trend.unit} per {unit} (p = {trend.p_value:.2g})"
    if trend.status is TrendStatus.DRIFTING:
        return f"{slope} in {trend.samples} estimates, {describe_remaining(trend)}"
    inside = trend.mean_lower_95 <= trend.threshold <= trend.mean_upper_95
    doubt = ", but its 95 % interval contains it" if inside else ""
    return f"level {trend.level:.4g} is beyond the threshold {trend.threshold:.4g}{doubt}, {slope}"


def _caveats(series: Series, pieces: Pieces, config: AgingConfig) -> str:
    """Return what else a reader of the trend has to know."""
    start = int(pieces.starts[-1])
    notes = []
    breaks = int(np.count_nonzero(series.unknown[start + 1 :]))
    if breaks and config.axis is not Axis.HOURS:
        notes.append(
            f"{breaks} breaks with an unknown number of missed cycles, only cycles seen are counted"
        )
    left_out = pieces.wild[start:]
    trailing = int(np.argmin(left_out[::-1])) if not left_out.all() else len(left_out)
    others = int(np.count_nonzero(left_out)) - trailing
    if others:
        notes.append(f"{others} outliers left out")
    if trailing:
        notes.append(f"the newest {trailing} estimates lie off the trend")
    return "".join(f"; {note}" for note in notes)
