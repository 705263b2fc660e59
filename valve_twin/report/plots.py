# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The two charts of the page: the last cycle, and a parameter over cycles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.verdict import Outlook, TrendStatus, outlook
from valve_twin.core.types import ParameterStatus, Validity
from valve_twin.report.svg import Panel, drawing, extremes, round_ticks, thin, tick_texts
from valve_twin.report.text import MINUS, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from markupsafe import Markup

    from valve_twin.core.aging.assess import TrendDetail
    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.past.condensate import Condensate
    from valve_twin.core.types import (
        BoolArray,
        Estimate,
        FloatArray,
        IntArray,
        Maintenance,
        Prediction,
    )

_BINS = 500
"""Bins of the curves of one cycle; more samples than 4 a bin are thinned."""

_MAX_POINTS = 3000
"""Estimates up to which a chart draws every one; of more, the first, lowest, highest and last of
each column of the picture, and every outlier, so that the picture stays the same."""

_LEAST_LAW = 0.05
"""Probability of a law of aging from which it is drawn [1]."""

_FAR = 0.6
"""How far laws are drawn ahead of the last cycle at most, as a share of the history [1]."""

_MOST_DAYS = 150
"""Parts that condensed days are drawn in at most."""

_VALUES = 5
"""About how many numbers stand at the axis of values [1]."""

_COUNTED = ("cycle", "cycles")
"""Axes on which nothing lies between two numbers."""

_MAX_BARS = 400
"""Estimates up to which every one's 95 % limits are drawn."""


def plot_cycle(prediction: Prediction, *, narrow: bool = False) -> Markup:
    """Draw measured, predicted and simulated position of a cycle, and the residual below.

    Parameters
    ----------
    prediction : Prediction
        All samples of the cycle, N >= 2.
    narrow : bool
        Whether it is for a column or a phone: fewer ticks and shorter words.

    Returns
    -------
    Markup
        SVG element.
    """
    t = (prediction.stamp_ns - prediction.stamp_ns[0]) / 1e9
    width, height, left = 560.0 if narrow else 960.0, 470.0, 64.0
    right, ticks = width - 16.0, 5 if narrow else 8
    x = (0.0, float(t[-1]))
    curves = (prediction.simulated, prediction.predicted, prediction.measured)
    upper = Panel(left, 34.0, right - left, 262.0, x, _range(curves, floor=0.02))
    sigma = prediction.residual_sigma
    shown = [np.array([-3.0 * sigma, 3.0 * sigma])] if math.isfinite(sigma) else []
    lower = Panel(
        left, 346.0, right - left, 84.0, x, _range([prediction.residual, *shown], floor=1e-4)
    )
    upper.axes(y_label="position, share of the stroke", x_texts=False, y_ticks=5, x_ticks=ticks)
    lower.axes(
        x_label="time since the start of the cycle [s]",
        y_label=_residual_label(narrow=narrow, band=bool(shown)),
        y_ticks=3,
        x_ticks=ticks,
    )
    unused = prediction.validity != Validity.VALID
    for panel in (upper, lower):
        panel.shade(t, unused, "unused")
    upper.line(*thin(t, prediction.measured, _BINS), "measured")
    upper.line(*thin(t, prediction.predicted, _BINS), "predicted")
    upper.line(*thin(t, prediction.simulated, _BINS), "freerun")
    if math.isfinite(sigma):
        ends = np.array(x)
        lower.band(ends, np.full(2, -2 * sigma), np.full(2, 2 * sigma), "expected")
    lower.level(0.0, "axis")
    lower.line(*thin(t, prediction.residual, _BINS), "residual")
    title = f"Position and residual over cycle {prediction.cycle}"
    return drawing(width, height, upper.parts + lower.parts, title, "narrow" if narrow else "wide")


def _residual_label(*, narrow: bool, band: bool) -> str:
    if narrow:
        return "residual; band: 2 expected standard deviations" if band else "residual"
    label = f"residual: measured {MINUS} predicted"
    return f"{label}; band: ± 2 expected standard deviations" if band else label


@dataclass(frozen=True, slots=True)
class Marks:
    """What a parameter's chart shows beside its accepted estimates.

    Attributes
    ----------
    trend : Trend or None
        The published trend; None where the cycles are no record of aging.
    detail : TrendDetail or None
        What the trend was computed from.
    maintenance : sequence of Maintenance
        Events to mark.
    condensates : sequence of Condensate
        Days of condensed cycles, oldest first.
    """

    trend: Trend | None = None
    detail: TrendDetail | None = None
    maintenance: Sequence[Maintenance] = ()
    condensates: Sequence[Condensate] = ()


def plot_parameter(name: str, estimates: Sequence[Estimate], marks: Marks, axis: str) -> Markup:
    """Draw a parameter over cycles with its trend, its intervals and what happened.

    Parameters
    ----------
    name : str
        Parameter.
    estimates : sequence of Estimate
        Estimates of one estimator, oldest first.
    marks : Marks
        Trend and events.
    axis : str
        What the horizontal axis counts.

    Returns
    -------
    Markup
        SVG element.
    """
    found = [(e.cycle, p) for e in estimates for p in e.parameters if p.name == name]
    cycle = np.array([c for c, _ in found], float)
    x = _axis_of(cycle, marks.detail)
    value = np.array([p.value for _, p in found])
    low, high = (np.array([getattr(p, k) for _, p in found]) for k in ("lower_95", "upper_95"))
    usable = np.array([p.usable for _, p in found], bool) & np.isfinite(value)
    bound = np.array([p.status is ParameterStatus.AT_BOUND for _, p in found], bool)
    trend = marks.trend
    panel = _parameter_panel(x, value, low, high, usable | bound, marks)
    panel.axes(x_label=axis, x_ticks=6, y_ticks=_VALUES, x_whole=axis in _COUNTED)
    if trend is not None and math.isfinite(trend.reference) and trend.reference:
        _percent_axis(panel, trend.reference)
    _days(panel, marks)
    drawn = _bands(panel, marks) if has_line(trend) else []
    named: list[float] = []
    for event in marks.maintenance:
        at = float(_axis_of(np.array([float(event.cycle)]), marks.detail)[0])
        if panel.x[0] <= at <= panel.x[1]:
            panel.mark(at, "service")
            named.append(float(panel.place(at, 0.0)[0]) + 4)
    outlier = _outliers(cycle, marks.detail)
    good, at_bound = (_seen(panel, x, value, m) for m in (usable & ~outlier, bound))
    crossed = np.flatnonzero(usable & outlier)
    if np.count_nonzero(usable) <= _MAX_BARS:
        panel.bars(x[usable], low[usable], high[usable], "limits")
    panel.dots(x[good], value[good], "estimate")
    panel.crosses(x[crossed], value[crossed], "outlier")
    panel.dots(x[at_bound], value[at_bound], "estimate")
    panel.dots(x[at_bound], value[at_bound], "atbound")
    refused = _seen(panel, x, np.zeros(len(x)), ~usable & ~bound)
    floor = np.full(len(refused), panel.y[0])
    panel.bars(x[refused], floor, floor + 0.035 * (panel.y[1] - panel.y[0]), "refused")
    if not (usable | bound).any():
        middle = (panel.left + 0.5 * panel.width, panel.top + 0.5 * panel.height)
        panel.text(*middle, "no cycle says anything about it", "label mid")
    _laws(panel, marks)
    for line_x, line_y in drawn:
        panel.line(line_x, line_y, "trend")
    if trend is not None and math.isfinite(trend.threshold):
        _threshold(panel, trend.threshold)
        if panel.y[0] <= trend.warning <= panel.y[1]:
            panel.level(trend.warning, "warning")
    for at in named:  # over the curves
        panel.text(at, panel.top + 11, "▼ service", "note")
    return drawing(480, 286, panel.parts, f"{name} over {axis}", "small")


def _days(panel: Panel, marks: Marks) -> None:
    """Draw from the least to the greatest value of every so many days of condensed cycles."""
    found = marks.condensates
    step = -(-len(found) // _MOST_DAYS) or 1
    parts = [found[k : k + step] for k in range(0, len(found), step)]
    middle = np.array([0.5 * (days[0].cycle + days[-1].last_cycle) for days in parts], float)
    low = np.array([min(day.minimum for day in days) for days in parts], float)
    high = np.array([max(day.maximum for day in days) for days in parts], float)
    panel.bars(_axis_of(middle, marks.detail), low, high, "condensed")


def _seen(panel: Panel, x: FloatArray, y: FloatArray, shown: BoolArray) -> IntArray:
    """Return which of the shown points have to be drawn, see `_MAX_POINTS`."""
    index = np.flatnonzero(shown)
    if len(index) <= _MAX_POINTS:
        return index
    column = np.floor(panel.place(x[index], 0.0)[0]).astype(np.int64)
    return index[extremes(column, y[index])]


def _parameter_panel(
    x: FloatArray,
    value: FloatArray,
    low: FloatArray,
    high: FloatArray,
    shown: FloatArray | np.ndarray[tuple[int], np.dtype[np.bool_]],
    marks: Marks,
) -> Panel:
    trend = marks.trend
    days = [(day.minimum, day.maximum) for day in marks.condensates]
    parts = [value[shown], low[shown], high[shown]] if len(x) <= _MAX_BARS else [value[shown]]
    parts.append(np.array(days, float).ravel())
    if trend is not None and has_line(trend):
        parts.append(np.array([trend.reference, trend.prediction_lower_95]))
        parts.append(np.array([trend.prediction_upper_95]))
        if _threshold_in_view(trend, value[shown]):
            parts.append(np.array([trend.threshold]))
    ends = (float(x.min()), float(x.max())) if len(x) else (0.0, 1.0)
    ends = (ends[0], ends[1] + _look_ahead(marks, ends[1] - ends[0]))
    pad = 0.02 * (ends[1] - ends[0]) or 0.5
    y = _range(parts, floor=1e-3 if not np.any(value[shown]) else 0.0)
    longest = max(map(len, tick_texts(round_ticks(*y, _VALUES))), default=0)
    left = max(58.0, 7.4 * longest + 6.0)  # no number is cut
    return Panel(left, 14.0, 410.0 - left, 226.0, (ends[0] - pad, ends[1] + pad), y)


def _look_ahead(marks: Marks, length: float) -> float:
    """Return how far beyond the last cycle is shown: to the limit, where that is in sight."""
    trend, detail = marks.trend, marks.detail
    if trend is None or detail is None or detail.laws is None or not has_line(trend):
        return 0.0
    if trend.status is not TrendStatus.DRIFTING or outlook(trend) is not Outlook.FORECAST:
        return 0.0
    return min(1.1 * trend.remaining_median, _FAR * length)


def draws_laws(trend: Trend | None, detail: TrendDetail | None) -> bool:
    """Tell whether a chart shows the laws of aging: a limit is in sight or the trend bends."""
    if detail is None or detail.laws is None:
        return False
    return detail.laws.bends or _look_ahead(Marks(trend, detail), 1.0) > 0.0


def _laws(panel: Panel, marks: Marks) -> None:
    """Draw the laws that the present segment allows, from its start to the end of the view."""
    detail = marks.detail
    if detail is None or detail.laws is None or not draws_laws(marks.trend, detail):
        return
    x = np.linspace(float(detail.axis[detail.starts[-1]]), panel.x[1], 60)
    low, high = panel.y
    for row, (law, probability, shape) in enumerate(detail.laws.alternatives(_LEAST_LAW)):
        y = detail.laws.curve(x, shape)
        inside = (y >= low) & (y <= high)
        if np.count_nonzero(inside) > 1:
            panel.line(x[inside], y[inside], f"way {law.value}")
        at = panel.left + panel.width - 6, panel.top + 13 + 14 * row
        panel.text(*at, f"{law.value} {100.0 * probability:.0f} %", f"end law {law.value}")


def _threshold_in_view(trend: Trend, values: FloatArray) -> bool:
    """Show the limit where that does not squeeze the estimates into a line."""
    if not math.isfinite(trend.threshold) or not len(values):
        return False
    spread = float(np.ptp(values))
    away = abs(trend.threshold - float(np.median(values)))
    return away <= 0.5 * abs(trend.reference) or away <= 8.0 * spread


def _threshold(panel: Panel, threshold: float) -> None:
    if panel.y[0] <= threshold <= panel.y[1]:
        panel.level(threshold, "threshold")
        at = float(panel.place(0.0, threshold)[1])
        below = at < panel.top + 16
        panel.text(panel.left + 6, at + 13 if below else at - 5, "service limit", "limit")
    else:
        above = threshold > panel.y[1]
        text = f"service limit {_plain(threshold)}, beyond this view {'▲' if above else '▼'}"
        y = panel.top + 11 if above else panel.top + panel.height - 7
        panel.text(panel.left + 6, y, text, "limit")


def _percent_axis(panel: Panel, reference: float) -> None:
    ends = sorted(100.0 * (y / reference - 1.0) for y in panel.y)
    ticks = round_ticks(ends[0], ends[1], 5)
    right = panel.left + panel.width
    for tick in ticks:
        at = float(panel.place(0.0, reference * (1.0 + tick / 100.0))[1])
        places = 0 if abs(tick - round(tick)) < 1e-6 else 1
        text = f"{tick:+.{places}f} %".replace("-", MINUS) if abs(tick) > 1e-9 else "new"
        panel.parts.append(f'<path class="axis" d="M{right:.1f} {at:.1f}h4"/>')
        panel.text(right + 6, at + 4, text, "tick")


def _bands(panel: Panel, marks: Marks) -> list[tuple[FloatArray, FloatArray]]:
    """Fill both intervals of every segment; return its line for drawing on top."""
    detail, lines = marks.detail, []
    if detail is None or marks.trend is None:
        return []
    ends = [*detail.starts.tolist(), len(detail.axis)]
    for fit, (start, stop) in zip(detail.lines, pairwise(ends), strict=True):
        if 0 < start < len(detail.axis) and not _forced(detail, start, marks.maintenance):
            gap = 0.5 * float(detail.axis[start - 1] + detail.axis[start])
            panel.mark(gap, "segment")
        if fit is None or stop - start < 2:
            continue
        x = np.linspace(float(detail.axis[start]), float(detail.axis[stop - 1]), 24)
        fits = [fit] * len(x)
        if stop == len(detail.axis) and detail.laws is not None and detail.laws.bends:
            laws, sigma = detail.laws, detail.laws.variance**0.5
            fits = [laws.tangent(v, samples=stop - start, sigma=sigma) for v in x.tolist()]
        places = list(zip(fits, x.tolist(), strict=True))
        single = np.array([f.prediction_interval(v) for f, v in places])
        mean = np.array([f.mean_interval(v) for f, v in places])
        panel.band(x, single[:, 0], single[:, 1], "prediction")
        panel.band(x, mean[:, 0], mean[:, 1], "mean")
        lines.append((x, np.array([f.level(v) for f, v in places])))
    return lines


def has_line(trend: Trend | None) -> bool:
    """Tell whether a trend has enough data for its line and intervals to be shown."""
    return trend is not None and trend.status is not TrendStatus.NOT_ENOUGH_DATA


def _forced(detail: TrendDetail, start: int, events: Sequence[Maintenance]) -> bool:
    """Tell whether a segment starts because of a maintenance event, which has its own mark."""
    before, first = int(detail.cycle[start - 1]), int(detail.cycle[start])
    return any(before < event.cycle <= first for event in events)


def _axis_of(cycle: FloatArray, detail: TrendDetail | None) -> FloatArray:
    """Return where cycles stand on the trend's axis; between accepted ones by interpolation."""
    if detail is None or len(detail.axis) < 2:
        return cycle
    known, axis = detail.cycle.astype(float), detail.axis
    rate = (axis[-1] - axis[0]) / max(known[-1] - known[0], 1.0)
    at = np.interp(cycle, known, axis)
    at += rate * (np.minimum(cycle - known[0], 0.0) + np.maximum(cycle - known[-1], 0.0))
    result: FloatArray = at
    return result


def _outliers(
    cycle: FloatArray, detail: TrendDetail | None
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    if detail is None:
        return np.zeros(len(cycle), bool)
    return np.isin(cycle, detail.cycle[detail.outlier].astype(float))


def _range(curves: Sequence[FloatArray], *, floor: float) -> tuple[float, float]:
    """Return the ends of an axis: all finite values with a margin, never narrower than `floor`."""
    values = np.concatenate([np.ravel(c) for c in curves]) if curves else np.empty(0)
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    lower, upper = float(values.min()), float(values.max())
    middle = 0.5 * (lower + upper)
    half = max(0.5 * (upper - lower), 0.5 * floor, 0.01 * abs(middle))
    return middle - 1.08 * half, middle + 1.08 * half


def _plain(x: float) -> str:
    text = number(x, 3)
    return f"{x:.2e}".replace("-", MINUS) if "<" in text else text
