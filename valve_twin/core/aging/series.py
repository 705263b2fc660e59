# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From the stored history to one parameter over the axis, cut where it was maintained."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.aging.changepoint import find_outliers
from valve_twin.core.aging.config import AgingConfig, Axis
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.aging.trend import (
    Line,
    LineSums,
    autocorrelation_of,
    fit_line,
    line_sums,
    residuals,
)
from valve_twin.core.estimation.data.one_thread import dot
from valve_twin.core.past.columns import Rows, past_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import BoolArray, Estimate, FloatArray, IntArray, Maintenance

_UNKNOWN = -1
_NAN = float("nan")
_FEWEST_OF_PRODUCT = 2
_FEWEST_IN_LINE = 4
_APART_NS = 1000  # of cycles that end at the same time: no two places are the same
_LARGEST = 1e50  # fourth powers of what is used must not overflow; no parameter is as large


@dataclass(frozen=True, slots=True)
class History:
    """Every estimate of the trend's estimator, in the order of time.

    Attributes
    ----------
    rows : Rows
        N estimates, refused ones included: they count on the axis.
    axis : (N,) array
        Position on the axis, strictly increasing [axis unit].
    unknown : (N,) bool array
        An unknown number of cycles was missed before this one; the axis counts none.
    place : (N,) int64 array
        Which of the rows that were given each is.
    """

    rows: Rows
    axis: FloatArray
    unknown: BoolArray
    place: IntArray


@dataclass(frozen=True, slots=True)
class Series:
    """Accepted values of one parameter.

    Attributes
    ----------
    axis, values : (N,) arrays
        Position [axis unit] and value [unit].
    cycle, start_ns, end_ns : (N,) int64 arrays
        Cycle number, first and last stamp of the cycle [ns].
    unknown : (N,) bool array
        An unknown number of cycles was missed since the value before.
    offsets : (N, Z) array or None
        Columns of which an unknown share is left in the values, such as 1 where another product
        was made [1].
    systematic : float
        Standard deviation of what is wrong in all values alike [unit].
    row : (N,) int64 array or None
        Which row of its history each value stands in.
    """

    axis: FloatArray
    values: FloatArray
    cycle: IntArray
    start_ns: IntArray
    end_ns: IntArray
    unknown: BoolArray
    offsets: FloatArray | None = None
    systematic: float = 0.0
    row: IntArray | None = None

    def rows_in(self, rows: Rows) -> IntArray:
        """Return which of some rows each value stands in, (N,), -1 = in none."""
        return rows.at(self.cycle, self.end_ns) if self.row is None else self.row

    def offsets_at(self, index: IntArray) -> FloatArray | None:
        """Return the columns at some values that are not told by the others there, else None."""
        if self.offsets is None:
            return None
        chosen = np.ones((len(index), 1))
        for column in self.offsets[index].T:
            wider = np.column_stack([chosen, column])
            if (
                np.linalg.matrix_rank(wider) == wider.shape[1]
                and min(np.count_nonzero(column), np.count_nonzero(column == 0.0))
                >= _FEWEST_OF_PRODUCT
            ):
                chosen = wider
        return chosen[:, 1:] if chosen.shape[1] > 1 else None


@dataclass(frozen=True, slots=True)
class Pieces:
    """Straight pieces of one series.

    Attributes
    ----------
    starts : (K,) int64 array
        First index of each piece; N where the last maintenance has no accepted value after it.
    forced : (K,) bool array
        Whether the piece begins with a maintenance event.
    outlier : (N,) bool array
        Values left out of every fit.
    wave : (N,) array
        What repeats over a piece without being a change or wear, zero elsewhere [unit].
    period : float
        Mean period of the newest wave [axis unit]; NaN where there is none.
    """

    starts: IntArray
    forced: BoolArray
    outlier: BoolArray
    wave: FloatArray
    period: float = float("nan")


class Part(NamedTuple):
    """Good values of one piece.

    Attributes
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit].
    offsets : (N, Z) array or None
        See `Series.offsets_at`.
    sums : LineSums
        Of the line through them, offsets not counted.
    """

    x: FloatArray
    y: FloatArray
    offsets: FloatArray | None
    sums: LineSums


def order_history(history: Iterable[Estimate] | Past, axis: Axis) -> History:
    """Sort the trend's estimates, one a cycle, and place them on the axis.

    The number of a cycle says what came after what: it goes on where a clock is set back. Numbers
    that repeat do not; then, and for hours, the end of the cycle does.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Stored estimates of all estimators, in any order.
    axis : Axis
        Cycles and counter advance by the cycle number, or by the missed cycles where those are
        known to be more; a number that goes back (counter reset) advances by one and is marked
        unknown. Hours count from the end of the first cycle.

    Returns
    -------
    History
        The estimates with `used_by_trend`.
    """
    given = past_of(history).trend
    index = _in_order(given, axis)
    rows = given.take(index)
    number, missed = rows.cycle, rows.missed
    step = np.diff(number, prepend=number[:1] - 1)
    unknown = (missed == _UNKNOWN) | (step < 1)
    if len(unknown):
        unknown[0] = False
    if axis is Axis.HOURS:
        apart_ns = _APART_NS * np.arange(len(rows))
        end_ns = np.maximum.accumulate(rows.end_ns - apart_ns) + apart_ns
        place = (end_ns - end_ns[:1]) / 3.6e12
    else:
        place = (number[:1] - 1 + np.cumsum(np.maximum(step, 1 + np.maximum(missed, 0)))).astype(
            np.float64
        )
        if len(missed) and missed[0] > 0:
            place -= float(missed[0])
    return History(rows, place, unknown, index)


def _in_order(rows: Rows, axis: Axis) -> IntArray:
    """Return the rows in the order of time; of a cycle that came twice the last, at its place."""
    cycle, end_ns = rows.cycle, rows.end_ns
    if np.all(cycle[1:] > cycle[:-1]):
        rising = axis is not Axis.HOURS or bool(np.all(end_ns[1:] >= end_ns[:-1]))
        index = np.arange(len(rows), dtype=np.int64)
        return index if rising else np.argsort(end_ns, kind="stable")
    pairs = zip(cycle.tolist(), end_ns.tolist(), strict=True)
    latest = {pair: row for row, pair in enumerate(pairs)}
    repeated = len({number for number, _ in latest}) < len(latest)
    sort_key = 1 if repeated or axis is Axis.HOURS else 0
    chosen = [latest[key] for key in sorted(latest, key=lambda k: k[sort_key])]
    return np.array(chosen, dtype=np.int64)


def series_of(history: History, parameter: str) -> Series:
    """Return the accepted values of one parameter; unknown breaks pass over refused cycles."""
    rows = history.rows
    values = rows.usable(parameter)
    used = rows.given & (np.abs(values) < _LARGEST)
    index = np.flatnonzero(used)
    whole = len(index) == len(rows)
    unknown = history.unknown
    if not whole:
        breaks = np.concatenate([[0], np.cumsum(unknown)])
        passed = np.concatenate([[0], index[:-1] + 1]) if len(index) else index
        unknown = breaks[index + 1] > breaks[passed]
    part = slice(None) if whole else index
    return Series(
        axis=history.axis[part],
        values=values[part],
        cycle=rows.cycle[part],
        start_ns=rows.start_ns[part],
        end_ns=rows.end_ns[part],
        unknown=unknown,
        systematic=systematic_of(rows, parameter, part),
        row=index,
    )


def systematic_of(
    rows: Rows, parameter: str, part: IntArray | slice, scale: FloatArray | float = 1.0
) -> float:
    """Return what the limits of some values hold beyond their repeatability [unit].

    Parameters
    ----------
    rows : Rows
        The estimates.
    parameter : str
        Whose values count.
    part : (M,) int64 array or slice
        Which of the estimates do.
    scale : (M,) array or float
        What each value is multiplied with [1].
    """
    if parameter not in rows.parameters:
        return 0.0
    found = rows.parameters[parameter].spread[part] * scale**2
    known = np.isfinite(found)
    found = found if known.all() else found[known]
    if not len(found):
        return 0.0
    middle = [(len(found) - 1) // 2, len(found) // 2]
    half: float = np.partition(found, sorted(set(middle)))[middle].mean()
    return math.sqrt(half)


def part_of(series: Series, kept: IntArray) -> Series:
    """Return some of the values of a series."""
    if len(kept) == len(series.values):
        return series
    return Series(
        axis=series.axis[kept],
        values=series.values[kept],
        cycle=series.cycle[kept],
        start_ns=series.start_ns[kept],
        end_ns=series.end_ns[kept],
        unknown=series.unknown[kept],
        offsets=None if series.offsets is None else series.offsets[kept],
        systematic=series.systematic,
        row=None if series.row is None else series.row[kept],
    )


def in_force(events: Iterable[Maintenance]) -> tuple[Maintenance, ...]:
    """Return the maintenance events that were not withdrawn as marked by mistake."""
    return tuple(event for event in events if not event.withdrawn)


def first_after(series: Series, event: Maintenance) -> int:
    """Return the index of the first value after a maintenance event, N where there is none yet.

    The event's cycle decides; its stamp does where the event names no cycle or the numbers went
    back (counter reset).
    """
    monotone = bool(np.all(np.diff(series.cycle) > 0))
    if event.cycle > 0 and monotone:
        return int(np.searchsorted(series.cycle, event.cycle))
    return int(np.searchsorted(series.start_ns, event.stamp_ns))


def events_at(series: Series, maintenance: Sequence[Maintenance]) -> FloatArray:
    """Return before which values of a series the events lie, (M,) [1]."""
    return np.array([float(first_after(series, m)) for m in maintenance])


def cut(
    series: Series,
    maintenance: Sequence[Maintenance],
    config: AgingConfig,
    memory: Memory | None = None,
) -> Pieces:
    """Cut a series at every maintenance event, and find the further changes in between.

    Parameters
    ----------
    series : Series
        Values of one parameter.
    maintenance : sequence of Maintenance
        Events of the valve, in any order.
    config : AgingConfig
        Sizes and penalties.
    memory : Memory, optional
        What was found before: saves time and changes nothing.

    Returns
    -------
    Pieces
        At least one piece if there is a value.
    """
    n = len(series.values)
    oldest = max(n - config.window, 0) if config.window else 0
    events = {max(first_after(series, m), oldest) for m in maintenance} - {oldest}
    edges = [oldest, *sorted(events)]
    starts: list[int] = []
    outlier, wave = np.zeros(n, dtype=np.bool_), np.zeros(n)
    period = _NAN
    known = memory or Memory()
    for first, last in zip(edges, [*edges[1:], n], strict=True):
        part = slice(first, last)
        found = known.pieces(series.axis[part], series.values[part], config)
        outlier[part], wave[part] = found.outlier, found.wave
        period = found.period
        starts.extend(first + found.starts)
    if oldest:
        old = slice(oldest)
        outlier[old] = find_outliers(series.axis[old], series.values[old], config.outlier_sigma)
    where = np.array(starts, dtype=np.int64)
    return Pieces(where, np.isin(where, sorted(events)), outlier, wave, period)


def lines_of(axis: FloatArray, pieces: Pieces) -> FloatArray:
    """Return level and slope of every piece as columns, (N, C); one of few values has no slope.

    What begins with maintenance after the newest value holds none yet and has no column.
    """
    found = []
    for first, last in itertools.pairwise([*pieces.starts.tolist(), len(axis)]):
        if last <= first:
            continue
        inside = np.zeros(len(axis))
        inside[first:last] = 1.0
        found.append(inside)
        if last - first > 2:
            found.append(inside * (axis - axis[first:last].mean()))
    return np.column_stack(found)


def good_parts(series: Series, pieces: Pieces) -> tuple[Part, ...]:
    """Return the good values of every piece of a series.

    Parameters
    ----------
    series : Series
        Values of one parameter.
    pieces : Pieces
        Its pieces.
    """
    parts = []
    for first, last in itertools.pairwise([*pieces.starts.tolist(), len(series.values)]):
        kept = first + np.flatnonzero(~pieces.outlier[first:last])
        part = slice(first, last) if len(kept) == last - first else kept
        x, y = series.axis[part], series.values[part]
        parts.append(Part(x, y, series.offsets_at(kept), line_sums(x, y)))
    return tuple(parts)


def fit_parts(parts: Sequence[Part]) -> tuple[Line | None, ...]:
    """Fit every part; they share one autocorrelation, the scatter being the same process.

    Parameters
    ----------
    parts : sequence of Part
        Good values; one of fewer than 4 has no line.
    """
    fitted = [part for part in parts if len(part.x) >= _FEWEST_IN_LINE]
    power = product = 0.0
    for part in fitted:
        left = part.sums.power, part.sums.product
        if part.offsets is not None:
            rest = residuals(part.x, part.y, part.offsets)
            left = dot(rest, rest), dot(rest[1:], rest[:-1])
        power, product = power + left[0], product + left[1]
    count = sum(len(part.x) for part in fitted)
    rho = autocorrelation_of(count, len(fitted), power, product)
    return tuple(
        fit_line(part.x, part.y, rho, offsets=part.offsets, sums=part.sums)
        if len(part.x) >= _FEWEST_IN_LINE
        else None
        for part in parts
    )
