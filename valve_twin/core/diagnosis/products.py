# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What changes the features of a cycle without a fault of the valve: products, clocks apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import CLOCK, Finding
from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.changes.slips import SLIP
from valve_twin.core.diagnosis.features import DELAYS, TIMED, USUAL_PERIODS_S
from valve_twin.core.estimation.data.robust import robust_sigma

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_ALIKE = 0.01
"""Relative gap between the durations of cycles of one product, assumed [1]."""

_NEAR, _CLEAR = 0.006, 1.4
"""Relative gap between two products that are nearer than that, which is so many times as wide as
each of them [1]: a sample more or less of a logger of 40 ms is 0.005 of 8 s."""

_FEWEST = 5
"""Fewest cycles of a product."""

_ODD = 0.3
"""Share of cycles of no product above which durations tell no products, assumed [1]."""

_PAUSED = 1.5
"""Times the median duration from which on a cycle has a pause, which tells no product [1]."""

MADE = 8
"""Newest cycles whose products count as made: recipes may alternate."""

_LEAST_CYCLES = 14
_NEWEST = 200
_LOOKS = (*range(14, 65, 2), 72, 80, 90, 100, 120, 150, 180, 200)
"""Numbers of first cycles that are looked at again in every longer history."""

_SURE = 5.0
_LEAST_SHIFT_S = 0.01
_LEAST_ALONE_S = 0.04
_BACK = 0.5
"""Share of the shift by which the newest delay may be off it: clocks do not come back [1]."""

_LATER = 8
"""Newest delays behind a look that tell whether they stay where they were, assumed."""

_FASTEST = 5e-3
_OF_RATE = 0.35
"""Share of the rate that each delay, and each half of the record, must show [1]."""

_ROUNDED = 1e-9


def products(duration_s: FloatArray, least_s: float = 0.0) -> IntArray:
    """Return which product each cycle makes, by the duration of the program; -1 = not known.

    Parameters
    ----------
    duration_s : (N,) array
        Durations of the cycles [s].
    least_s : float
        Gap that no two products are nearer than [s].

    Returns
    -------
    (N,) int64 array
        Number of the product, longest program last; all 0 where durations differ too much to say.
    """
    low, high = float(duration_s.min()), float(duration_s.max())
    if high - low <= max(_NEAR * max(low, 1e-9), least_s):
        return np.zeros(len(duration_s), dtype=np.int64)
    order = np.argsort(duration_s, kind="stable")
    ranked = duration_s[order]
    gap = np.diff(ranked)
    apart = gap > np.maximum(_ALIKE * np.maximum(ranked[1:], 1e-9), least_s)
    apart[apart] = gap[apart] > wider_beside(ranked, apart)
    group = np.empty(len(ranked), dtype=np.int64)
    group[order] = np.concatenate(([0], np.cumsum(apart)))
    sizes = np.bincount(group)
    paused = duration_s > _PAUSED * np.median(duration_s)
    begun = group == group[~paused][-1]  # which is not odd, if it is a product that just begins
    few = sizes[group] < _FEWEST
    group[few] = -1
    odd = few[~paused & ~(begun & few)]
    if not len(odd) or np.mean(odd) > _ODD:
        return np.zeros(len(group), dtype=np.int64)
    return _with_near(group, duration_s, least_s)


def with_returns(
    product: IntArray, returns_s: FloatArray, period_s: FloatArray | None = None
) -> IntArray:
    """Return products, those taken apart whose programs return at clearly different times.

    A program that is as long as another one may differ in its parts. When it returns is the
    controller's, whatever the valve or its sensor do.

    Parameters
    ----------
    product : (N,) int64 array
        What each cycle makes by its duration, -1 = not known [1].
    returns_s : (N,) array
        Time from the start of each to its return [s]. One that shows none (NaN) stays with its
        product; where that is taken apart, those before the first that shows it, of an older
        version or let go of, are a product of their own.
    period_s : (N,) array, optional
        Time between the samples of each [s], NaN where it does not tell it.

    Returns
    -------
    (N,) int64 array
        Number of the product, -1 = not known.
    """
    known = np.isfinite(returns_s)
    if not known.any():
        return product
    found, last = np.full_like(product, -1), -1
    for number in range(int(product.max(initial=-1)) + 1):
        own = product == number
        told = np.flatnonzero(own & known)
        parts = np.zeros(len(told), dtype=np.int64)
        if len(told) >= 2 * _FEWEST:
            known_s = np.full(1, np.nan) if period_s is None else period_s[told]
            longest_s = float(np.where(np.isfinite(known_s), known_s, USUAL_PERIODS_S[1]).max())
            parts = products(returns_s[told], SLIP[1] * longest_s)  # a sample is no gap
        found[told] = np.where(parts < 0, -1, last + 1 + parts)
        others = np.flatnonzero(own & ~known)
        if parts.max(initial=0) == 0:  # one program, odd cycles aside
            found[others] = last + 1
        elif np.count_nonzero(others < told[0]) >= _FEWEST:
            found[others[others < told[0]]] = int(found.max()) + 1
        last = max(last + int(own.any()), int(found.max()))
    return found


def _with_near(group: IntArray, duration_s: FloatArray, least_s: float) -> IntArray:
    """Return products, one that is two which are near each other taken apart.

    As long as one of the two has too few cycles, these are of no product. No gap below `least_s`
    takes apart.
    """
    found, last = np.full_like(group, -1), -1
    for number in range(int(group.max()) + 1):
        own = np.flatnonzero(group == number)
        if not len(own):
            continue
        ranked = np.sort(duration_s[own])
        at = int(np.argmax(np.diff(ranked)))
        gap = ranked[at + 1] - ranked[at]
        wider = max(ranked[at] - ranked[0], ranked[-1] - ranked[at + 1])
        whole = np.ones(len(own), dtype=np.bool_)
        shorter = duration_s[own] <= ranked[at]
        apart = gap > max(_NEAR * ranked[at], _CLEAR * wider, least_s)
        for side in (shorter, ~shorter) if apart else (whole,):
            if np.count_nonzero(side) >= _FEWEST:
                last += 1
                found[own[side]] = last
    return found


def wider_beside(ranked: FloatArray, apart: BoolArray) -> FloatArray:
    """Return by how much the cycles on the wider side of each gap differ among themselves.

    Durations that scatter leave gaps by chance, which are no wider than the scatter.
    """
    edges = np.flatnonzero(apart)
    first, last = np.append(0, edges + 1), np.append(edges, len(ranked) - 1)
    width = ranked[last] - ranked[first]
    return np.asarray(np.maximum(width[:-1], width[1:]), dtype=np.float64)


def behind_a_pause(product: IntArray, own: BoolArray | slice) -> BoolArray:
    """Return which cycles of a product come behind one of no known product, as with a pause.

    Parameters
    ----------
    product : (N,) int64 array
        What each cycle makes, -1 = not known [1].
    own : (N,) bool array or slice
        Those of the product.

    Returns
    -------
    (M,) bool array
        Of each of these, whether one of no known product came since the one before of them.
    """
    odd = np.cumsum(product < 0)[own]
    return np.asarray(np.diff(odd, prepend=odd[:1]) > 0)


def last_left(cycles: IntArray, product: IntArray, number: int) -> int:
    """Return the newest cycle of a product behind which others were made for long, -1 = none.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    product : (N,) int64 array
        What each makes, -1 = not known [1].
    number : int
        Number of the product.
    """
    known = product >= 0
    own = np.flatnonzero(product[known] == number)
    others = np.diff(np.append(own, np.count_nonzero(known))) - 1
    left = own[others >= MADE]
    return int(cycles[known][left[-1]]) if len(left) else -1


def without_timed(vectors: FloatArray, table: SignatureTable) -> FloatArray:
    """Take out what slides and jumps by itself between two clocks that run apart.

    Parameters
    ----------
    vectors : (N, F) array
        Features [unit by feature].
    table : SignatureTable
        Names of the features.

    Returns
    -------
    (N, F) array
        Features, those that are `TIMED` not shown.
    """
    kept = [name not in TIMED for name in table.features]
    return np.where(kept, vectors, np.nan)


@dataclass(frozen=True, slots=True)
class _Slope:
    """A robust line: slope and its standard error."""

    value: float
    error: float


def clocks_of(
    shown: Rows,
    vectors: FloatArray,
    table: SignatureTable,
    before: Sequence[Finding],
    since: int,
    *,
    begins: bool,
) -> Finding | None:
    """Return that clocks run apart, known before or found, see `clocks_apart`.

    Parameters
    ----------
    shown : Rows
        Features, a cycle a row.
    vectors : (N, F) array
        The same as they are followed [unit by feature].
    table : SignatureTable
        Names of the features.
    before : sequence of Finding
        Faults of old.
    since : int
        First row since start or maintenance.
    begins : bool
        Whether none came before it.
    """
    known = (f for f in before if f.fault == CLOCK and f.end < 0)
    start_s = np.asarray((shown.start_ns - shown.start_ns[0]) * 1e-9, np.float64)
    own = slice(since, None)
    return next(known, None) or clocks_apart(
        shown.cycle[own], start_s[own], vectors[own], table, begins=begins
    )


def clocks_apart(
    cycles: IntArray,
    start_s: FloatArray,
    vectors: FloatArray,
    table: SignatureTable,
    *,
    begins: bool = True,
) -> Finding | None:
    """Find clocks of position and commands that run apart: delays grow steadily and alike.

    It grows as fast in both halves of the record. A single delay, where a cycle shows no other,
    must grow by more than a pilot becomes slower. What the first cycles showed stays found, when
    later ones are refused since their delay is longer than is searched, not where it settles.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers.
    start_s : (N,) array
        When each began [s].
    vectors : (N, F) array
        Features [unit by feature].
    table : SignatureTable
        Names of the features.
    begins : bool
        Whether these are the first cycles since start or maintenance.

    Returns
    -------
    Finding or None
        Its severity is the rate of one clock over the other, less 1.
    """
    count = len(cycles)
    shown = [table.features.index(name) for name in DELAYS if name in table.features]
    if not shown:
        return None
    looks = [slice(0, end) for end in _LOOKS if begins and end <= count]
    if not begins or count > _NEWEST:
        looks.insert(0, slice(max(count - _NEWEST, 0), count))
    delays = vectors[:, shown]
    rates = ((_early_rate if k.start == 0 else _rate)(start_s[k], delays[k]) for k in looks)
    for seen, rate in zip(looks, rates, strict=True):
        if rate is not None and not _settles(start_s, delays, seen, rate):
            first, last = int(cycles[seen.start]), int(cycles[-1])
            return Finding(CLOCK, (), "sensor", rate.value, rate.sure, first, last)
    return None


def _settles(t: FloatArray, delays: FloatArray, seen: slice, rate: _Rate) -> bool:
    """Return whether a delay stays behind a look where it was, as one does that warms up.

    One that is longer than is searched jumps instead, and tells nothing.
    """
    for delay in delays.T:
        known = np.flatnonzero(np.isfinite(delay))
        first, later = known[known < seen.stop], known[known >= seen.stop][-_LATER:]
        if len(first) < _LEAST_CYCLES or len(later) < _LATER:
            continue
        ahead = rate.value * float(np.median(t[later]) - np.median(t[first]))
        moved = float(np.median(delay[later]) - np.median(delay[first]))
        since = float(np.median(delay[later]) - np.median(delay[first[-_LATER // 2 :]]))
        shift = abs(rate.value) * float(np.ptp(t[first]))
        if abs(moved - ahead) > _BACK * abs(ahead) and abs(since) < _BACK * shift:
            return True
    return False


@dataclass(frozen=True, slots=True)
class _Rate:
    """Rate of one clock over the other, less 1 [1], and how many standard errors that is."""

    value: float
    sure: float


def _rate(t: FloatArray, delays: FloatArray) -> _Rate | None:
    shown: list[tuple[FloatArray, FloatArray]] = []
    for delay in delays.T:
        known = np.isfinite(delay)
        if np.count_nonzero(known) >= _LEAST_CYCLES and np.ptp(t[known]) > 0.0:
            shown.append((t[known], delay[known]))
    if not shown:
        return None
    least = _LEAST_SHIFT_S if len(shown) > 1 else _LEAST_ALONE_S
    parts: list[float] = []
    enough = _OF_RATE * least / max(float(np.ptp(t)), 1e-300) * (1.0 - _ROUNDED)
    for x, y in shown:
        half = len(x) // 2
        for part in (slice(half, None), slice(half)):
            parts.append(_slope(x[part], y[part]).value)
            if not abs(parts[-1]) > enough:  # as in nearly all: the shift then is less as well
                return None
    whole = [_slope(x, y) for x, y in shown]
    newest = 0.0
    for slope, (x, y) in zip(whole, shown, strict=True):
        off = y - slope.value * x
        newest = max(newest, abs(float(off[-1] - np.median(off))))
    rate = sum(s.value for s in whole) / len(whole)
    values = [s.value for s in whole] + parts
    alike = all(_OF_RATE < v / rate < 1.0 / _OF_RATE for v in values) if rate else False
    sure = min(abs(s.value) / s.error for s in whole)
    shift = abs(rate) * float(np.ptp(t))
    alike &= newest < _BACK * shift  # a sample slipped: the cycles and the logger beat
    if not (alike and sure > _SURE and least < shift and abs(rate) < _FASTEST):
        return None
    return _Rate(rate, sure)


_early_rate = kept(_rate)


@lru_cache(maxsize=_NEWEST)
def _pairs(count: int) -> tuple[IntArray, IntArray]:
    """Return the numbers of both of all pairs of some values."""
    return np.triu_indices(count, 1)


def _slope(t: FloatArray, y: FloatArray) -> _Slope:
    """Return the line through all but the outliers about the median slope."""
    i, j = _pairs(len(t))
    middle = float(np.median((y[j] - y[i]) / (t[j] - t[i])))
    off = y - middle * t
    off -= np.median(off)
    kept = np.abs(off) <= 4.0 * robust_sigma(off)
    x = t[kept] - t[kept].mean()
    square = max(float(x @ x), 1e-300)
    slope = float(x @ y[kept]) / square
    left = y[kept] - y[kept].mean() - slope * x
    sigma = np.sqrt(float(left @ left) / max(len(x) - 2, 1))
    return _Slope(slope, max(float(sigma / np.sqrt(square)), 1e-12))
