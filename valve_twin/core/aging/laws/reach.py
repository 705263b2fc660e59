# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When the shapes of a fit reach a threshold, compiled.

The probability rises with the place, so that each share is found by halving what is left of the
places. Student's distribution is taken from a table of one fit's degrees of freedom: values and
two derivatives over s with z = sinh(s), between which a polynomial of degree 5 lies within 1e-10.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import TINY
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

_STEP = 0.05  # between the places s of the table
_TAIL = 1e-13  # probability beyond its end
_POINTS, _ROUNDS = 9, 16  # of the search between two places
_FINE = 1e-4  # difference in probability between which it is straight


@lru_cache(maxsize=16)
def student_table(freedom: float) -> FloatArray:
    """Return Student's distribution over s = 0, `_STEP`, ... (M, 3): value and two derivatives.

    Parameters
    ----------
    freedom : float
        Degrees of freedom [1].
    """
    from scipy.special import gammaln, stdtr, stdtrit  # slow to import

    end = np.arcsinh(-float(stdtrit(freedom, _TAIL)))
    s = _STEP * np.arange(int(end / _STEP) + 2.0)
    z, stretch = np.sinh(s), np.cosh(s)
    scale = gammaln(0.5 * freedom + 0.5) - gammaln(0.5 * freedom) - 0.5 * np.log(np.pi * freedom)
    density = np.exp(scale - 0.5 * (freedom + 1.0) * np.log1p(z * z / freedom))
    bend = -density * (freedom + 1.0) * z / (freedom + z * z) * stretch**2 + density * z
    return np.column_stack([stdtr(freedom, z), _STEP * density * stretch, _STEP**2 * bend])


@njit(cache=True)
def student(table: FloatArray, z: float) -> float:
    """Return the probability below z, see `student_table`.

    Parameters
    ----------
    table : (M, 3) array
        The distribution.
    z : float
        Standardised value [1].
    """
    if not abs(z) >= 0.0:
        return np.nan
    place = np.arcsinh(abs(z)) / _STEP
    if place >= len(table) - 1.0:
        return 1.0 if z > 0.0 else 0.0
    i = int(place)
    t, a, b = place - i, table[i], table[i + 1]
    # value, slope and curvature at both ends (quintic Hermite)
    d = b[0] - a[0] - a[1] - 0.5 * a[2]
    e, f = b[1] - a[1] - a[2], b[2] - a[2]
    c3, c4, c5 = 10.0 * d - 4.0 * e + 0.5 * f, -15.0 * d + 7.0 * e - f, 6.0 * d - 3.0 * e + 0.5 * f
    upper: float = a[0] + t * (a[1] + t * (0.5 * a[2] + t * (c3 + t * (c4 + t * c5))))
    return upper if z >= 0.0 else 1.0 - upper


@njit(cache=True)
def _shape(law: int, number: float, u: float) -> float:
    """Return g(u) of one shape, see `core.aging.laws.shapes.curves`."""
    if law == 0:
        return u
    if law == 1:
        return float(np.expm1(min(number * u, 60.0)) / np.expm1(number))
    if law == 2:
        return float(u**number)
    return float(np.expm1(-number * u) / np.expm1(-number))


@njit(cache=True)
def _way(law: IntArray, rows: FloatArray, u: float, best: FloatArray) -> FloatArray:
    """Return how far every shape is beyond the threshold at u, or was before, (K,) [1].

    `rows` are number, weight, gap, change, their covariance as (K,) rows; `best` is before u.
    """
    out = np.empty(len(law))
    for i in range(len(law)):
        h = _shape(law[i], rows[0, i], u) - 1.0
        variance = rows[4, i] + 2.0 * h * rows[5, i] + h * h * rows[6, i]
        z = (rows[2, i] + rows[3, i] * h) / max(variance, TINY) ** 0.5
        out[i] = best[i] if best[i] >= z else z
    return out


@njit(cache=True)
def _mean(table: FloatArray, weight: FloatArray, z: FloatArray) -> float:
    total = 0.0
    for i in range(len(z)):
        total += weight[i] * student(table, z[i])
    return total


@njit(cache=True)
def reached(
    law: IntArray,
    rows: FloatArray,
    table: FloatArray,
    since: float,
    length: float,
    ahead: FloatArray,
) -> float:
    """Return the probability that the threshold is reached at one of some places [1].

    Parameters
    ----------
    law : (K,) int64 array
        Law of each shape.
    rows : (7, K) array
        Number, weight, gap, change, variance of the gap, covariance, variance of the change [1],
        [unit], [unit^2].
    table : (M, 3) array
        Student's distribution [1].
    since, length : float
        From u = 0 to the present, and to u = 1 [axis unit].
    ahead : (N,) array
        Places ahead of the present, rising [axis unit].
    """
    best = np.full(len(law), -np.inf)
    for place in ahead:
        best = _way(law, rows, max((since + place) / length, 0.0), best)
    return _mean(table, rows[1], best)


@njit(cache=True)
def first_places(
    law: IntArray,
    rows: FloatArray,
    table: FloatArray,
    since: float,
    length: float,
    ahead: FloatArray,
    shares: FloatArray,
) -> FloatArray:
    """Return where the probability first is each share, infinite where it never is [axis unit].

    Parameters
    ----------
    law, rows, table, since, length : arrays and float
        As in `reached`.
    ahead : (N,) array
        Places between which it is sought, rising [axis unit].
    shares : (S,) array
        Probabilities [1].
    """
    coarse = np.empty((len(ahead), len(law)))
    best = np.full(len(law), -np.inf)
    for j in range(len(ahead)):
        best = _way(law, rows, max((since + ahead[j]) / length, 0.0), best)
        coarse[j] = best
    out = np.full(len(shares), np.inf)
    end = _mean(table, rows[1], coarse[-1])
    for k in range(len(shares)):
        share, places, ways = shares[k], ahead, coarse
        low, high = _mean(table, rows[1], ways[0]), end
        if not high >= share:
            continue
        if low >= share:
            out[k] = ahead[0]
            continue
        for turn in range(_ROUNDS):
            a, b = 0, len(places) - 1
            while b - a > 1:
                middle = (a + b) // 2
                value = _mean(table, rows[1], ways[middle])
                if value >= share:
                    b, high = middle, value
                else:
                    a, low = middle, value
            first, last = places[a], places[b]
            if high - low < _FINE or turn == _ROUNDS - 1:
                break
            finer, within = np.empty(_POINTS), np.empty((_POINTS, len(law)))
            finer[0], finer[-1], within[0], within[-1] = first, last, ways[a], ways[b]
            for j in range(1, _POINTS - 1):
                finer[j] = first + (last - first) * j / (_POINTS - 1)
                u = max((since + finer[j]) / length, 0.0)
                within[j] = _way(law, rows, u, within[j - 1])
            places, ways = finer, within
        out[k] = first + (share - low) / (high - low) * (last - first)
    return out
