# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Assess the aging of one valve from everything that is stored about it.

A pure function of the history: a monitor that was down, or one that starts anew, says exactly
what one says that has been running all the time. Times are the data's own; no clock is read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.aging.altered import altered
from valve_twin.core.aging.config import AgingConfig, Axis
from valve_twin.core.aging.covariates import describe_effects, without_conditions
from valve_twin.core.aging.cutting.falls import at_one_command
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.aging.drift import find_reference, nearest_limit, present_segment, with_drift
from valve_twin.core.aging.life import axis_rate
from valve_twin.core.aging.limits.beside import Beside, mute_direction
from valve_twin.core.aging.limits.forecast import (
    CERTAIN,
    SCALE,
    is_sure,
    past_limit,
    stop_probability,
    with_life,
    without_forecast,
)
from valve_twin.core.aging.limits.hidden import with_hidden
from valve_twin.core.aging.limits.states import (
    held_limits,
    limit_state,
    lost_shares,
    with_warnings,
)
from valve_twin.core.aging.products import product_numbers, same_product
from valve_twin.core.aging.series import (
    History,
    Part,
    Pieces,
    Series,
    cut,
    fit_parts,
    good_parts,
    in_force,
    order_history,
    series_of,
)
from valve_twin.core.aging.verdict import (
    SOON,
    Trend,
    TrendStatus,
    Verdict,
    concern,
    decide,
    describe_remaining,
    held_back,
)
from valve_twin.core.diagnosis.changes.finding import (
    CLOCK,
    NOTHING,
    Diagnosis,
    clocks_beside,
    lately_over,
)
from valve_twin.core.diagnosis.checks import begun_anew, failed_checks
from valve_twin.core.diagnosis.history import diagnose
from valve_twin.core.diagnosis.refused import featureless, refused_lately
from valve_twin.core.past.state import state_of
from valve_twin.core.types import Parameter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.aging.laws.shapes import LawFit
    from valve_twin.core.aging.trend import Line
    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import BoolArray, Estimate, FloatArray, IntArray, Maintenance

WAVE_DOUBT = 0.1
"""Standard deviation that a wave leaves in a drift, as a share of its height [1], assumed."""

MOVES = 0.8
"""Standard deviation by which the systematic error of the estimates moves between reference and
present, as a share of that error's standard deviation [1], set on strangers
(seeds 8000-8023 and 8100-8159, docs/aging.md)."""

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
    outlier : (N,) bool array
        Estimates left out as outliers.
    starts : (K,) int64 array
        First index of each segment; N where the present one is still empty.
    lines : tuple of Line or None
        The line through each segment, None where it has fewer than 4 values.
    laws : LawFit or None
        What the present segment's values allow; None where it is not judged.
    short : str
        Reason of the trend without what else is to be known of it.
    """

    parameter: str
    axis: FloatArray
    values: FloatArray
    cycle: IntArray
    outlier: BoolArray
    starts: IntArray
    lines: tuple[Line | None, ...]
    laws: LawFit | None = None
    short: str = ""


class _Now(NamedTuple):
    """Position [axis unit] and stamp [ns] of the newest cycle, whether it gave a value or not."""

    axis: float
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Assessment:
    """Trends, verdict and faults of one valve; `details` are in the order of `trends`."""

    trends: tuple[Trend, ...]
    verdict: Verdict
    details: tuple[TrendDetail, ...]
    diagnosis: Diagnosis = NOTHING

    @property
    def named(self) -> Finding | None:
        """The sudden fault whose part the verdict names, None = it names none by a fault."""
        present, verdict = self.diagnosis.present, self.verdict
        told = present is not None and verdict.kind.names_part and verdict.fault == present.fault
        return present if told else None


def assess(
    history: Sequence[Estimate] | Past,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    *,
    parameters: Sequence[Parameter],
    valve: str = "",
    confidence: float = 0.95,
    memory: Memory | None = None,
) -> Assessment:
    """Assess the aging of one valve.

    Parameters
    ----------
    history : sequence of Estimate, or Past
        The whole stored history, any order; estimates with `used_by_trend` give the trends, those
        of the estimator `features` the faults.
    maintenance : sequence of Maintenance
        All maintenance events of the valve; those withdrawn begin nothing.
    config : AgingConfig
        What to follow and when to speak.
    parameters : sequence of Parameter
        What the valve's model publishes; `trend` marks those followed by default.
    valve : str
        Name of the valve, copied into the results.
    confidence : float
        Of the limits of the remaining life; what is published has 95 % [1].
    memory : Memory, optional
        What was found before: saves time and changes nothing.

    Returns
    -------
    Assessment
        One trend a followed parameter, and the verdict.
    """
    maintenance = in_force(maintenance)
    of_model = {p.name: p for p in parameters}
    names = config.parameters or tuple(p.name for p in parameters if p.trend)
    past = state_of(history, maintenance)
    ordered = order_history(past, config.axis)
    rows = ordered.rows
    followed = [of_model.get(name, Parameter(name, "1", "")) for name in names]
    numbers = product_numbers(rows, past.features)
    known = memory or Memory()
    results = [
        _assess_parameter(p, ordered, numbers, maintenance, config, valve, confidence, known)
        for p in followed
    ]
    trends = tuple(trend for trend, _ in results)
    given = (known.faults, config.reference, valve)
    diagnosis = NOTHING if config.label else diagnose(past, maintenance, *given)
    if any(f.fault == CLOCK for f in diagnosis.findings):
        trends = tuple(
            altered(without_forecast(t), reason=f"{t.reason}; no forecast: the clocks run apart")
            for t in trends
        )
    newest = int(rows.cycle[-1]) if len(rows) else 0
    begun = begun_anew(maintenance)
    failed = failed_checks(past, begun)
    over = lately_over(diagnosis, newest, begun)
    doubts = (clocks_beside(diagnosis), over, diagnosis.against, failed)
    verdict = decide(
        trends,
        config,
        valve=valve,
        stamp_ns=int(rows.end_ns[-1]) if len(rows) else 0,
        cycle=newest,
        fault=diagnosis.present,
        stale=refused_lately(past),
        doubt=diagnosis.doubt or featureless(rows, past.features),
        failed="; ".join(filter(None, doubts)),
        beside=Beside(
            _first_compared(ordered, maintenance),
            mute_direction(zip(followed, (t.segments > 0 for t in trends), strict=True)),
            {detail.parameter: detail.short for _, detail in results},
        ),
    )
    verdict = held_back(verdict, diagnosis.departs, cycle=diagnosis.newest, odd=diagnosis.odd)
    verdict = with_hidden(verdict, past)
    return Assessment(trends, verdict, tuple(detail for _, detail in results), diagnosis)


def _first_compared(history: History, maintenance: Sequence[Maintenance]) -> int:
    """Return the first cycle of the reference that gave an estimate, 1 = none yet."""
    given = history.rows.cycle[history.rows.given]
    given = given[given >= begun_anew(maintenance)]
    return int(given.min()) if len(given) else 1


def _assess_parameter(
    parameter: Parameter,
    history: History,
    numbers: IntArray,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    valve: str,
    confidence: float,
    memory: Memory,
) -> tuple[Trend, TrendDetail]:
    name = parameter.name
    rows = history.rows
    series = at_one_command(
        series_of(history, name),
        rows,
        parameter,
        numbers,
        first=config.reference_cycles,
        memory=memory,
    )
    series, effects = without_conditions(series, rows, maintenance, config, memory)
    series, changed = same_product(
        series, rows, maintenance, config, parameter=name, numbers=numbers, memory=memory
    )
    pieces = cut(series, maintenance, config, memory)
    series = altered(series, values=series.values - pieces.wave)
    parts = good_parts(series, pieces)
    lines = fit_parts(parts)
    detail = TrendDetail(
        name, series.axis, series.values, series.cycle, pieces.outlier, pieces.starts, lines
    )
    trend = _blank(name, parameter.unit, series, pieces, config, valve)
    if not len(series.values):
        none = "no accepted estimate yet"
        return altered(trend, reason=none), altered(detail, short=none)
    if len(history.axis) > 1:
        ends = rows.end_ns[-config.rate_cycles :]
        trend = altered(trend, cycle_rate=axis_rate(history.axis, ends, len(ends)))
    now = _Now(float(history.axis[-1]), int(rows.end_ns[-1]))
    trend, laws = _judge(
        trend,
        series,
        pieces,
        parts,
        lines,
        maintenance,
        config,
        confidence,
        parameter.resolution,
        now,
    )
    caveats = _caveats(series, pieces, config) + describe_effects(effects) + changed
    caveats += f" ({config.label})" if config.label else ""
    detail = altered(detail, laws=laws, short=trend.reason)
    return altered(trend, reason=trend.reason + caveats), detail


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
        samples=int(np.count_nonzero(~pieces.outlier[start:])),
        segments=len(pieces.starts) if n else 0,
        segment_start=float(series.axis[start]) if start < n else _NAN,
        axis_value=float(series.axis[-1]) if n else _NAN,
    )


def _judge(
    trend: Trend,
    series: Series,
    pieces: Pieces,
    parts: Sequence[Part],
    lines: tuple[Line | None, ...],
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    confidence: float,
    resolution: float,
    now: _Now,
) -> tuple[Trend, LawFit | None]:
    line = lines[-1]
    begun = len(pieces.starts) == 1 or bool(pieces.forced[-1])
    if line is None or (begun and line.samples < config.min_samples):
        since = "maintenance" if len(pieces.forced) and pieces.forced[-1] else "the segment began"
        level = _NAN if line is None else line.level(trend.axis_value)
        reason = f"{trend.samples} of {config.min_samples} estimates since {since}"
        return altered(trend, level=level, reason=reason), None
    present = present_segment(series, pieces, parts[-1], line, config.laws)
    straight, line = line, present.line
    lines = (*lines[:-1], line)
    reference = find_reference(trend.parameter, series, pieces, lines, maintenance, config)
    doubt = np.hypot(WAVE_DOUBT * float(np.ptp(pieces.wave)), MOVES * series.systematic)
    reference = altered(
        reference,
        variance=reference.variance + float(doubt) ** 2,
        scale=SCALE if series.systematic > 0.0 else 0.0,
    )
    trend = _with_line(trend, line, present.fit)
    trend = with_drift(trend, present, reference, resolution)
    held = held_limits(reference, pieces, parts, lines, config, trend.parameter)
    lost = lost_shares(trend, pieces, series, lines, config)
    held = with_warnings(held, lost, config)
    limit = nearest_limit(
        trend,
        present,
        reference,
        config,
        confidence=confidence,
        held=held.alarm,
        warned=held.warning,
        now=now.axis,
    )
    drifting = line.p_value < config.significance
    trend = altered(
        with_life(trend, limit, now.stamp_ns),
        share_lost=max((x.share for x in lost), default=_NAN),
        status=TrendStatus.DRIFTING if drifting else TrendStatus.STEADY,
    )
    if not is_sure(trend, limit, begun=begun):
        trend = without_forecast(trend)
    if limit.beyond:
        trend = past_limit(trend, held=bool(held.alarm))
    trend = altered(trend, limit_state=limit_state(trend, lost, held, config))
    within_doubt = limit.beyond or (trend.remaining_low < SOON and not trend.p_value < CERTAIN)
    if within_doubt and not concern(trend, config):
        trend = without_forecast(trend)  # it may be reached now, and is not beyond doubt
    own = len(reference.weights) > 0
    stop = stop_probability(trend, limit, straight, config, own=own, stamp_ns=now.stamp_ns)
    trend = altered(trend, next_stop_probability=stop)
    return altered(trend, reason=_reason(trend)), present.fit


def _with_line(trend: Trend, line: Line, fit: LawFit) -> Trend:
    law, probability = fit.probable()
    slope, mean, single = (
        line.slope_interval(),
        line.mean_interval(trend.axis_value),
        line.prediction_interval(trend.axis_value),
    )
    return altered(
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
        law=law.value,
        law_probability=probability,
        bends=fit.bends,
    )


def _reason(trend: Trend) -> str:
    """Return the status in one line."""
    unit = "hour" if trend.axis == Axis.HOURS.value else "cycle"
    if trend.status is TrendStatus.STEADY:
        return f"no significant slope in {trend.samples} estimates (p = {trend.p_value:.2g})"
    what = "" if trend.unit == "1" else f" {trend.unit}"
    slope = f"slope {trend.slope:.3g}{what} per {unit} (p = {trend.p_value:.2g})"
    if trend.status is TrendStatus.DRIFTING:
        return f"{slope} in {trend.samples} estimates, {describe_remaining(trend)}"
    inside = trend.mean_lower_95 <= trend.threshold <= trend.mean_upper_95
    doubt = ", but its 95 % interval contains it" if inside else ""
    beyond = f"level {trend.level:.4g} is beyond the threshold {trend.threshold:.4g}{doubt}"
    if (trend.level - trend.threshold) * (trend.reference - trend.threshold) > 0.0:
        beyond = f"level {trend.level:.4g}, not clearly back from beyond {trend.threshold:.4g}"
    return f"{beyond}, {slope}"


def _caveats(series: Series, pieces: Pieces, config: AgingConfig) -> str:
    """Return what else a reader of the trend has to know."""
    start = int(pieces.starts[-1])
    notes = []
    if np.isfinite(pieces.period):
        size = float(np.ptp(pieces.wave))
        notes.append(f"a wave of {size:.2g} that repeats every {pieces.period:.3g} taken out")
    breaks = int(np.count_nonzero(series.unknown[start + 1 :]))
    if breaks and config.axis is not Axis.HOURS:
        notes.append(f"{breaks} breaks with unknown missed cycles, only cycles seen are counted")
    left_out = pieces.outlier[start:]
    trailing = int(np.argmin(left_out[::-1])) if not left_out.all() else len(left_out)
    others = int(np.count_nonzero(left_out)) - trailing
    if others:
        notes.append(f"{others} outliers left out")
    if trailing:
        notes.append(f"the newest {trailing} estimates lie off the trend")
    return "".join(f"; {note}" for note in notes)
