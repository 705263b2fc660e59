# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cut one undisturbed stretch of a history into pieces.

A long stretch is searched as a whole only after every 2nd, 4th, 8th ... value (`searched`). What
came since is judged by its newest straight piece, and asks for a search at once where it looks
like a change: by the score of the search itself, or since the newest values lie off.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.changepoint import (
    best_lines,
    far_from_neighbours,
    left_by,
    log_left,
    penalty,
)
from valve_twin.core.aging.joining import Joined, join
from valve_twin.core.aging.trend import RESOLUTION, TINY, Line, fit_line
from valve_twin.core.estimation.data.one_thread import dot
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_CLEANING_ROUNDS = 2
_FEWEST_JUDGES = 7
_FEWEST_IN_LINE = 4
_BEFORE = 64  # values before the last search in which a change may have begun unseen
_ALERT = 0.8  # share of the penalty of a piece from which a search is made at once
_OFF = 0.75  # share of the newest values that lie off, likewise


@dataclass(frozen=True, slots=True)
class Stretch:
    """Pieces of one stretch.

    Attributes
    ----------
    starts : (K,) int64 array
        First index of each piece.
    outlier : (N,) bool array
        Values left out of every fit.
    wave : (N,) array
        What repeats, see `Pieces`.
    period : float
        Mean period of the wave [axis unit]; NaN where there is none.
    """

    starts: IntArray
    outlier: BoolArray
    wave: FloatArray
    period: float


@dataclass(frozen=True, slots=True)
class Search:
    """What a search of the first values of a stretch found.

    Attributes
    ----------
    found : Stretch
        Its pieces.
    straight : int
        First index of the newest straight piece [1].
    pieces : int
        Straight pieces [1].
    line : Line or None
        The line through the newest; None where it has too few values to judge others.
    power, product : float
        Sums of the squares and of the lag-1 products of the residuals of all others [unit^2].
    """

    found: Stretch
    straight: int
    pieces: int
    line: Line | None
    power: float
    product: float


def searched(count: int, places: int) -> int:
    """Return of how many first values of a stretch the search is in force; it never falls.

    Parameters
    ----------
    count : int
        Values of the stretch [1].
    places : int
        Values up to which it is always searched as a whole [1].
    """
    if count <= places:
        return count
    step = step_of(count, places)
    before = places if step == 2 else (places - 1) * (step // 2)
    return max(count // step * step - step, before)


def step_of(count: int, places: int) -> int:
    """Return after how many more values a stretch is searched again, a power of 2 [1]."""
    return 1 << max(-(-count // places) - 1, 0).bit_length()


def search(x: FloatArray, y: FloatArray, off: FloatArray, config: AgingConfig) -> Search:
    """Find the pieces of a stretch.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit].
    off : (N,) array
        How far each value lies off its neighbours [unit].
    config : AgingConfig
        Sizes and penalties.
    """
    starts, outlier = _pieces(x, y, off, config)
    kept = np.flatnonzero(~outlier)
    joined = _join(x[kept], y[kept], kept, starts, config)
    wave = np.zeros(len(x))
    wave[kept] = joined.wave
    inner = starts[: joined.kept + 1]
    if len(inner) > 1 and np.count_nonzero(kept >= inner[-1]) < _FEWEST_IN_LINE:
        inner = inner[:-1]
    newest = int(starts[-1])
    power = product = 0.0
    for first, last in itertools.pairwise(starts.tolist()):
        line = _line_of(x[first:last], y[first:last], outlier[first:last])
        good = slice(first, last)
        if line is not None:
            rest = (y[good] - line.mean - line.slope * (x[good] - line.center))[~outlier[good]]
            power += dot(rest, rest)
            product += dot(rest[1:], rest[:-1])
    return Search(
        Stretch(inner, outlier, wave, joined.period),
        newest,
        len(starts),
        _line_of(x[newest:], y[newest:], outlier[newest:]),
        power,
        product,
    )


def extend(known: Search, x: FloatArray, y: FloatArray, config: AgingConfig) -> Stretch | None:
    """Return the pieces of a stretch of which the first values were searched.

    Parameters
    ----------
    known : Search
        What they showed.
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit], more than were searched.
    config : AgingConfig
        Sizes and penalties.

    Returns
    -------
    Stretch or None
        None where it has to be searched as a whole.
    """
    found, line = known.found, known.line
    if line is None or np.isfinite(found.period):
        return None
    done = len(found.outlier)
    new = _off(line, x[done:], y[done:]) > config.outlier_sigma
    if np.count_nonzero(new[-config.min_segment :]) >= _OFF * config.min_segment:
        return None
    outlier = np.concatenate([found.outlier, new])
    if known.pieces < config.max_segments:
        newest = outlier[known.straight :]
        good: IntArray | slice = slice(known.straight, None)
        if newest.any():
            good = known.straight + np.flatnonzero(~newest)
        u, v = x[good], y[good]
        count = len(x) - int(np.count_nonzero(outlier))
        floor = count * (RESOLUTION * float(np.abs(y[-1]))) ** 2 + TINY
        first = int(np.count_nonzero(~newest[: max(done - _BEFORE - known.straight, 0)]))
        place = _split(u, v, first, config.min_segment)
        if place:
            one, two = (_score(known, u, v, cut, floor) for cut in ((), (place,)))
            if count * (one - two) > _ALERT * config.penalty_scale * penalty(count):
                return None
    wave = np.zeros(len(x))
    return Stretch(found.starts, outlier, wave, found.period)


def _score(
    known: Search, x: FloatArray, y: FloatArray, cuts: tuple[int, ...], floor: float
) -> float:
    """Return the score of the search for a value, with its newest piece cut at some places."""
    power, product = left_by(x, y, np.array([0, *cuts, len(x)]))
    return log_left(known.power + power, known.product + product, floor)


@njit(cache=True)
def _split(x: FloatArray, y: FloatArray, first: int, least: int) -> int:
    """Return where the second of the best two lines begins, of those that begin late; 0 = nowhere.

    That is at `first` or later, `least` values before the end or earlier.
    """
    n = len(x)
    x0, y0 = x[n - 1], y[n - 1]
    whole, late = np.zeros(6), np.zeros(6)
    for i in range(n):
        _count(whole, x[i] - x0, y[i] - y0, 1.0)
    low, place = _left(whole), 0
    for i in range(n - 1, max(first, least) - 1, -1):
        _count(late, x[i] - x0, y[i] - y0, 1.0)
        _count(whole, x[i] - x0, y[i] - y0, -1.0)
        if n - i >= least:
            left = _left(whole) + _left(late)
            if left < low:
                low, place = left, i
    return place


@njit(cache=True, inline="always")
def _count(sums: FloatArray, u: float, v: float, sign: float) -> None:
    sums[0] += sign
    sums[1] += sign * u
    sums[2] += sign * v
    sums[3] += sign * u * u
    sums[4] += sign * u * v
    sums[5] += sign * v * v


@njit(cache=True, inline="always")
def _left(sums: FloatArray) -> float:
    n, sx, sy = sums[0], sums[1], sums[2]
    sxx = sums[3] - sx * sx / n
    sxy = sums[4] - sx * sy / n
    left: float = max(sums[5] - sy * sy / n - (sxy * sxy / sxx if sxx > 0.0 else 0.0), 0.0)
    return left


def _join(
    x: FloatArray, y: FloatArray, kept: IntArray, starts: IntArray, config: AgingConfig
) -> Joined:
    """Join the last pieces of the good values `kept` of a stretch where one law explains them."""
    bounds = np.append(np.searchsorted(kept, starts), len(kept))
    bounds[0] = 0
    return join(x, y, bounds, laws=config.laws, penalty_scale=config.penalty_scale)


def _pieces(
    x: FloatArray, y: FloatArray, off: FloatArray, config: AgingConfig
) -> tuple[IntArray, BoolArray]:
    """Return the starts of the straight pieces of one stretch and its outliers."""
    outlier = far_from_neighbours(y, off, config.outlier_sigma)
    starts = _starts(x, y, outlier, config)
    for _ in range(_CLEANING_ROUNDS):
        again = _off_pieces(x, y, starts, outlier, config.outlier_sigma)
        if np.array_equal(again, outlier):
            break
        outlier = again
        starts = _starts(x, y, outlier, config)
    return _reclaim(x, y, starts, outlier, config.outlier_sigma)


def _reclaim(
    x: FloatArray, y: FloatArray, starts: IntArray, outlier: BoolArray, limit: float
) -> tuple[IntArray, BoolArray]:
    """Give a piece the values just before it that seem outliers only since the change is large."""
    starts, outlier = starts.copy(), outlier.copy()
    for k in range(len(starts) - 1, 0, -1):
        piece = slice(starts[k], starts[k + 1] if k + 1 < len(starts) else len(x))
        line = _line_of(x[piece], y[piece], outlier[piece])
        if line is None:
            continue
        good = _off(line, x, y) <= limit
        while outlier[starts[k] - 1] and good[starts[k] - 1]:
            starts[k] -= 1
            outlier[starts[k]] = False
    return starts, outlier


def _starts(x: FloatArray, y: FloatArray, outlier: BoolArray, config: AgingConfig) -> IntArray:
    kept = np.flatnonzero(~outlier)
    if len(kept) < 2 * config.min_segment:
        return np.zeros(1, dtype=np.int64)
    bounds = best_lines(
        x[kept],
        y[kept],
        least=config.min_segment,
        most=config.max_segments,
        max_candidates=config.max_candidates,
        penalty_scale=config.penalty_scale,
    )
    return np.concatenate([np.zeros(1, dtype=np.int64), kept[bounds[1:-1]]])


def _off_pieces(
    x: FloatArray, y: FloatArray, starts: IntArray, outlier: BoolArray, limit: float
) -> BoolArray:
    """Judge every value by the line of its piece."""
    out = outlier.copy()
    for first, last in itertools.pairwise([*starts, len(x)]):
        line = _line_of(x[first:last], y[first:last], outlier[first:last])
        if line:
            out[first:last] = _off(line, x[first:last], y[first:last]) > limit
    return out


def _line_of(x: FloatArray, y: FloatArray, outlier: BoolArray) -> Line | None:
    """Return the line through the good values; None where they are too few to judge others."""
    kept = ~outlier
    if np.count_nonzero(kept) < _FEWEST_JUDGES:
        return None
    return fit_line(x[kept], y[kept], autocorrelation=0.0)


def _off(line: Line, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return how far (N,) values lie off a line, in its standard deviations."""
    distance = np.abs(y - line.mean - line.slope * (x - line.center))
    return np.asarray(distance / max(line.sigma, TINY))
