# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles of which each lies farther off than any cycle before, in one feature and one direction.

A few cycles do not tell how a valve scatters, and a variance of theirs must count much wider. That
none of them went nearly as far as each of some newer ones does needs no variance: the more of
these there are, the less far they must lie.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray

_FACTORS = np.array([8.0, 5.0, 3.5, 2.7, 2.2])
"""How many times as far as the farthest before each of 1 to 5 newest cycles lies at least, set on
strangers [1]."""

_TAIL = 1.0 / 3.0
"""Of one cycle: the chance that it lies farther beyond those before it, in any feature, than any
other did beyond those before that, falls with the third power, as assumed of one that raises an
alarm alone [1]."""

_LEAST = 7
_LEAST_ALONE = 12
"""Fewest cycles before some, and before one alone."""

_LINE = 20
"""Cycles from which on they are held against a line, not against their median."""

_ONE_OUT = 16
"""Cycles from which on the farthest one is left out: one outlier says nothing."""

_SUDDEN = 0.85
"""Share of a change by which the first of some cycles must lie off those just before them: what
wanders away is no sudden change, set on strangers [1]."""

_BESIDE = 3
"""How many cycles these are on both sides [1]."""

_WANDERS = 0.15
"""Mean correlation of a feature with that of the cycle before from which on a valve wanders, of
what does not by chance; set on made-up valves [1]."""

_WIDER = 4.0
"""By how much farther cycles must then lie, a unit of that correlation; set likewise [1]."""

_ROUNDING = 1e-9
"""Share of a feature's size below which it does not scatter: the line through what stays as it is
leaves the same rounding in every cycle [1]."""

_QUIET = 3.0
"""Least that counts as the farthest, in the least standard deviation of a feature [1]."""

_CLEAR = 1.5
"""How many times as far as the farthest before a change must lie to say whether it is over [1]."""

_KNOWN = 0.8
"""Share of the cycles before that must show a feature [1]."""


def first_beyond(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig, begin: int
) -> tuple[int, int] | None:
    """Return the first row that ends some that all lie beyond those before, and the first of them.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    table : SignatureTable
        Says what sampling and rounding alone do to a feature.
    config : DetectionConfig
        When to speak: `beyond` and `alone`.
    begin : int
        First row that is asked.
    """
    if not config.beyond:
        return None
    chance = max(config.alone, 1e-12)
    rule = (config.beyond * _FACTORS, config.window, chance)
    rows = np.ascontiguousarray(vectors)
    row, number = _first(rows, _QUIET * table.least(), max(begin, 0), *rule)
    return (row, row - number + 1) if row >= 0 else None


def nearer_before(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig, raised: tuple[int, int]
) -> BoolArray | None:
    """Return which rows are nearer to those before a change than to it, (N,); None = not known.

    Asked are the features in which each cycle of the change lay beyond those before: most of them
    must be back.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    table : SignatureTable
        Says what sampling and rounding alone do to a feature.
    config : DetectionConfig
        When to speak.
    raised : (int, int)
        Row of the alarm, and the first that showed the change.
    """
    alarm, first = raised
    since = max(first - config.window, 0)
    if not config.beyond or first - since < _LEAST:
        return None
    rows, changed, back = np.arange(len(vectors)), 0, np.zeros(len(vectors))
    columns = np.ascontiguousarray(vectors.T)
    for column, least in zip(columns, _QUIET * table.least(), strict=True):
        place = since + np.flatnonzero(np.isfinite(column[since:first]))
        if len(place) < max(_LEAST - 1, _KNOWN * (first - since)):
            continue
        own = place.astype(np.float64)
        far, before = _nearest(column[first : alarm + 1], first, own, column[place])
        if far > _CLEAR * max(before, least):
            changed += 1
            level, slope, centre = _line(own, column[place])
            off = column - level - slope * (rows - centre)
            half = 0.5 * abs(float(np.median(off[first : alarm + 1])))
            back += ~(np.abs(off) >= half)  # what is not shown says nothing
    return np.asarray(back > 0.5 * changed, dtype=np.bool_) if changed else None


@njit(cache=True)
def _first(
    vectors: FloatArray,
    least: FloatArray,
    begin: int,
    factors: FloatArray,
    window: int,
    chance: float,
) -> tuple[int, int]:
    """Return the first row from `begin` on and how many up to it lie beyond; -1 = none does."""
    room = (np.empty(window), np.empty(window))
    for end in range(max(begin, _LEAST), len(vectors)):
        best, number = 1.0, 0
        for m in range(1, min(len(factors), end - _LEAST + 1) + 1):
            if m == 1 and end < _LEAST_ALONE:
                continue
            far, factor = _farthest(vectors, least, end - m + 1, end, window, room), factors[m - 1]
            if m == 1 and far > factor:
                rare = (min(end, window) * chance) ** -_TAIL
                factor = max(factor, _usual(vectors, least, end, window, room) * rare)
            if far > best * factor:
                factor *= _wander(vectors, end - m + 1, window, room)
            if far > best * factor:
                best, number = far / factor, m
        if number:
            return end, number
    return -1, 0


@njit(cache=True)
def _usual(
    vectors: FloatArray,
    least: FloatArray,
    end: int,
    window: int,
    room: tuple[FloatArray, FloatArray],
) -> float:
    """Return how far any row before one lay by itself beyond those before it, at least 1."""
    most = 1.0
    for row in range(max(end - window, _LEAST), end):
        most = max(most, _farthest(vectors, least, row, row, window, room))
    return most


@njit(cache=True)
def _gather(
    vectors: FloatArray, j: int, since: int, first: int, room: tuple[FloatArray, FloatArray]
) -> int:
    """Gather rows and values of a feature before row `first`; how many, 0 = too few are known."""
    known = 0
    for row in range(since, first):
        if np.isfinite(vectors[row, j]):
            room[0][known], room[1][known] = row, vectors[row, j]
            known += 1
    return known if known >= max(_LEAST - 1, _KNOWN * (first - since)) else 0


@njit(cache=True)
def _farthest(
    vectors: FloatArray,
    least: FloatArray,
    first: int,
    end: int,
    window: int,
    room: tuple[FloatArray, FloatArray],
) -> float:
    """Return how many times as far as those before rows `first` to `end` lie, in any feature."""
    since, most = max(first - window, 0), 0.0
    for j in range(vectors.shape[1]):
        known = _gather(vectors, j, since, first, room)
        if known == 0:
            continue
        place, value, new = room[0][:known], room[1][:known], vectors[first : end + 1, j]
        near = _nearest(new, first, place, value)
        far = near[0] / max(near[1], least[j])
        if far > most and (end == first or _is_sudden(new, first, place, value)):
            most = far
    return most


def wandered(vectors: FloatArray, first: int, config: DetectionConfig) -> float:
    """Return how many times as far a change must lie of a valve whose cycles are like the last.

    Parameters
    ----------
    vectors : (N, F) array
        Features [any unit]; NaN where a cycle does not show one.
    first : int
        Row of the first cycle of the change: those before it count.
    config : DetectionConfig
        When to speak.
    """
    if not config.beyond:
        return 1.0
    rows = np.ascontiguousarray(vectors[max(first - config.window, 0) : first])
    room = (np.empty(len(rows)), np.empty(len(rows)))
    return float(_wander(rows, len(rows), len(rows), room))


@njit(cache=True)
def _wander(
    vectors: FloatArray, first: int, window: int, room: tuple[FloatArray, FloatArray]
) -> float:
    """Return how many times as far a change must lie of a valve whose cycles are like the last.

    A few of them, close together, do not tell how far it goes.
    """
    since, alike, features = max(first - window, 0), 0.0, 0
    for j in range(vectors.shape[1]):
        known = _gather(vectors, j, since, first, room)
        if known == 0:
            continue
        level, slope, centre = _line(room[0][:known], room[1][:known])
        squares, products, last, largest = 0.0, 0.0, 0.0, 0.0
        for k in range(known):
            off = room[1][k] - level - slope * (room[0][k] - centre)
            squares += off * off
            products += off * last
            last, largest = off, max(largest, abs(room[1][k]))
        if squares > known * (_ROUNDING * largest) ** 2:  # else it stays as it is
            alike += products / squares
            features += 1
    return 1.0 + _WIDER * max(alike / max(features, 1) - _WANDERS, 0.0)


@njit(cache=True)
def _is_sudden(new: FloatArray, first: int, place: FloatArray, value: FloatArray) -> bool:
    """Return whether the first of some new cycles lie off those just before them, too."""
    level, slope, centre = _line(place, value)
    after, before = min(_BESIDE, len(new)), min(_BESIDE, len(value))
    now, then = 0.0, 0.0
    for k in range(after):
        now += (new[k] - level - slope * (first + k - centre)) / after
    for k in range(len(value) - before, len(value)):
        then += (value[k] - level - slope * (place[k] - centre)) / before
    return bool(abs(now - then) >= _SUDDEN * abs(now))


@njit(cache=True)
def _nearest(
    new: FloatArray, first: int, place: FloatArray, value: FloatArray
) -> tuple[float, float]:
    """Return how far the nearest of some new cycles lies off, and how far those before did."""
    level, slope, centre = _line(place, value)
    up, down = np.inf, np.inf
    for k in range(len(new)):
        off = new[k] - level - slope * (first + k - centre)
        if not np.isfinite(off):
            return 0.0, 1.0
        up, down = min(up, off), min(down, -off)
    farthest, next_to_it = 0.0, 0.0
    for k in range(len(value)):
        far = abs(value[k] - level - slope * (place[k] - centre))
        if far > farthest:
            farthest, next_to_it = far, farthest
        else:
            next_to_it = max(next_to_it, far)
    return max(up, down), next_to_it if len(value) >= _ONE_OUT else farthest


@njit(cache=True)
def _line(place: FloatArray, value: FloatArray) -> tuple[float, float, float]:
    """Return level, slope and centre of the line through some cycles; of few the median."""
    count = len(value)
    if count < _LINE:
        return float(np.median(value)), 0.0, 0.0
    centre, level, across, spread = place.mean(), value.mean(), 0.0, 0.0
    for k in range(count):
        off = place[k] - centre
        across += off * value[k]
        spread += off * off
    return level, across / spread, centre


def warm_up() -> None:
    """Compile what is called here."""
    one = np.zeros(1)
    _first(np.zeros((2, 1)), one, 0, _FACTORS, 1, 1.0)
    _nearest(one, 0, one, one)
    _line(one, one)
    _wander(np.zeros((1, 1)), 1, 1, (one, one))
