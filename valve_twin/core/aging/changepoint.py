# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Find where a trend changes: straight pieces, never constant ones, since aging is not a jump.

For every number of pieces K the best partition is found exactly (dynamic programming over the
residual sums of squares, each from cumulative sums). K is then chosen by the likelihood of lines
with AR(1) scatter,

    n log(S_K (1 - rho_K^2)) + (K - 1) penalty(n),

with S_K and rho_K the residual sum of squares and the lag-1 autocorrelation about the K lines.
The noise level is thus judged under each hypothesis and nothing has to be known beforehand;
scatter that wanders (rho > 0) explains itself by rho_K and is not cut into steps. The penalty was
calibrated by simulation, see `penalty`. Single outliers are found beforehand against a
repeated-median line through their neighbours (Siegel 1982) and left out.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import MAX_AUTOCORRELATION, RESOLUTION, TINY, line_sums
from valve_twin.core.estimation.data.robust import robust_sigma
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

HALF_WINDOW = 5
"""Neighbours on each side that judge a value [1]; up to 4 outliers of 11 do no harm."""

_FEWEST = 7  # values that are judged


def penalty(samples: int) -> float:
    """Return the penalty of one more piece, in units of twice the log-likelihood [1].

    Calibrated on Gaussian scatter about one line, 150-1000 histories each of 20 to 500 values:
    the line is cut in 0.5-1 % of them where the scatter is white, in about 2 % at rho = 0.3 and 3
    % at rho = 0.5. A step of 3 standard deviations in the middle of 120 values is worth about
    twice the penalty.
    """
    return 15.0 + 0.5 * float(np.log(samples))


@njit(cache=True, inline="always")
def _median(values: FloatArray) -> float:
    """Return the median of a few values, which it sorts."""
    n = len(values)
    for i in range(1, n):
        value, j = values[i], i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value
    middle: float = 0.5 * (values[(n - 1) // 2] + values[n // 2])
    return middle


@njit(cache=True)
def _repeated_median(x: FloatArray, y: FloatArray, half: int, out: FloatArray) -> None:
    n = len(x)
    width = min(2 * half + 1, n)
    inner = np.empty(width - 1)
    slopes = np.empty(width)
    heights = np.empty(width)
    for i in range(n):
        first = min(max(i - half, 0), n - width)
        for j in range(width):
            m = 0
            for k in range(width):
                if k != j:
                    inner[m] = (y[first + k] - y[first + j]) / (x[first + k] - x[first + j])
                    m += 1
            slopes[j] = _median(inner)
        slope = _median(slopes)
        for j in range(width):
            heights[j] = y[first + j] - slope * (x[first + j] - x[i])
        out[i] = y[i] - _median(heights)


def find_outliers(x: FloatArray, y: FloatArray, limit: float) -> BoolArray:
    """Return which (N,) values lie off a line through their neighbours.

    Fewer than 7 values are not judged.

    Parameters
    ----------
    x : (N,) array
        Axis positions, strictly increasing [axis unit].
    y : (N,) array
        Values [unit of the parameter].
    limit : float
        Distance from which a value is an outlier [robust standard deviations].
    """
    return far_from_neighbours(y, distances(x, y), limit)


def far_from_neighbours(y: FloatArray, off: FloatArray, limit: float) -> BoolArray:
    """Return which (N,) values lie off a line through their neighbours, by their distances.

    Parameters
    ----------
    y : (N,) array
        Values [unit of the parameter].
    off : (N,) array
        Their `distances` [unit of the parameter].
    limit : float
        Distance from which a value is an outlier [robust standard deviations].
    """
    if len(y) < _FEWEST:
        return np.zeros(len(y), dtype=np.bool_)
    scale = robust_sigma(off) + RESOLUTION * float(np.abs(y).max())
    return np.asarray(np.abs(off) > limit * scale)


def distances(x: FloatArray, y: FloatArray, known: FloatArray | None = None) -> FloatArray:
    """Return how far values lie off a line through their neighbours, (N,) [unit].

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit], strictly increasing, and values [unit].
    known : (M,) array, optional
        Those of the first M values alone [unit]; all but the last of them stay as they are.
    """
    off = np.empty(len(x))
    if len(x) < _FEWEST:
        return off
    first = 0
    if known is not None and len(known) > 2 * HALF_WINDOW:
        first = len(known) - 2 * HALF_WINDOW
    _repeated_median(x[first:], y[first:], HALF_WINDOW, off[first:])
    if known is not None and first:
        off[: first + HALF_WINDOW] = known[: first + HALF_WINDOW]
    return off


@njit(cache=True)
def _sums(x: FloatArray, y: FloatArray) -> FloatArray:
    out = np.zeros((len(x) + 1, 5))
    for i in range(len(x)):
        out[i + 1, 0] = out[i, 0] + x[i]
        out[i + 1, 1] = out[i, 1] + y[i]
        out[i + 1, 2] = out[i, 2] + x[i] * x[i]
        out[i + 1, 3] = out[i, 3] + x[i] * y[i]
        out[i + 1, 4] = out[i, 4] + y[i] * y[i]
    return out


@njit(cache=True)
def _cost(sums: FloatArray, a: int, b: int) -> float:
    n = float(b - a)
    sx, sy = sums[b, 0] - sums[a, 0], sums[b, 1] - sums[a, 1]
    sxx = sums[b, 2] - sums[a, 2] - sx * sx / n
    sxy = sums[b, 3] - sums[a, 3] - sx * sy / n
    syy = sums[b, 4] - sums[a, 4] - sy * sy / n
    cost: float = max(syy - sxy * sxy / sxx, 0.0)
    return cost


@njit(cache=True)
def _partition(sums: FloatArray, places: IntArray, least: int, most: int) -> IntArray:
    """Return (most, most + 1) bounds: row K - 1 holds those of the best K pieces, then -1."""
    m = len(places)
    cost = np.full((m, m), np.inf)
    for a in range(m):
        for b in range(a + 1, m):
            if places[b] - places[a] >= least:
                cost[b, a] = _cost(sums, places[a], places[b])
    best = np.full((most + 1, m), np.inf)
    origin = np.zeros((most + 1, m), dtype=np.int64)
    best[0, 0] = 0.0
    for k in range(1, most + 1):
        for b in range(1, m):
            low, place = np.inf, 0
            for a in range(b):
                value = best[k - 1, a] + cost[b, a]
                if value < low:
                    low, place = value, a
            best[k, b], origin[k, b] = low, place
    bounds = np.full((most, most + 1), -1, dtype=np.int64)
    for k in range(1, most + 1):
        if best[k, m - 1] < np.inf:
            b = m - 1
            for j in range(k, -1, -1):
                bounds[k - 1, j] = places[b]
                b = origin[j, b]
    return bounds


@njit(cache=True)
def _refine(sums: FloatArray, bounds: IntArray, least: int, reach: int) -> None:
    """Shift the inner bounds by up to `reach` to their best places until nothing moves."""
    for _ in range(5):
        moved = False
        for k in range(1, len(bounds) - 1):
            low, place = np.inf, bounds[k]
            first = max(bounds[k] - reach, bounds[k - 1] + least)
            last = min(bounds[k] + reach, bounds[k + 1] - least)
            for at in range(first, last + 1):
                value = _cost(sums, bounds[k - 1], at) + _cost(sums, at, bounds[k + 1])
                if value < low:
                    low, place = value, at
            moved = moved or place != bounds[k]
            bounds[k] = place
        if not moved:
            break


@njit(cache=True)
def _off_lines(
    sums: FloatArray, x: FloatArray, y: FloatArray, bounds: IntArray
) -> tuple[float, float]:
    """Return the sums of squares and of lag-1 products of the residuals of one partition."""
    power, product = 0.0, 0.0
    for k in range(len(bounds) - 1):
        a, b = bounds[k], bounds[k + 1]
        n = float(b - a)
        mx, my = (sums[b, 0] - sums[a, 0]) / n, (sums[b, 1] - sums[a, 1]) / n
        sxx = sums[b, 2] - sums[a, 2] - n * mx * mx
        slope = (sums[b, 3] - sums[a, 3] - n * mx * my) / sxx
        before = 0.0
        for i in range(a, b):
            r = y[i] - my - slope * (x[i] - mx)
            power += r * r
            product += r * before
            before = r
    return power, product


def left_by(x: FloatArray, y: FloatArray, bounds: IntArray) -> tuple[float, float]:
    """Return the sums of squares and of lag-1 products of the residuals of straight pieces.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit] without outliers.
    bounds : (K + 1,) int64 array
        0, the first index of each further piece, and N.
    """
    pieces = [line_sums(x[a:b], y[a:b]) for a, b in itertools.pairwise(bounds.tolist())]
    return sum(p.power for p in pieces), sum(p.product for p in pieces)


def log_left(power: float, product: float, floor: float) -> float:
    """Return log(S (1 - rho^2)) of residuals: what is left of AR(1) scatter.

    Parameters
    ----------
    power, product : float
        Sums of their squares and of their lag-1 products [unit^2].
    floor : float
        Square sum below which they are round-off [unit^2].
    """
    rho = min(max(product / power, 0.0), MAX_AUTOCORRELATION) if power > floor else 0.0
    return float(np.log((power + floor) * (1.0 - rho * rho)))


def best_lines(
    x: FloatArray,
    y: FloatArray,
    *,
    least: int,
    most: int,
    max_candidates: int,
    penalty_scale: float = 1.0,
) -> IntArray:
    """Return the bounds of the straight pieces of one undisturbed stretch.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit], strictly increasing, and values [unit] without outliers.
    least, most : int
        Fewest values in a piece, most pieces [1].
    max_candidates : int
        Places tried; see `AgingConfig`.
    penalty_scale : float
        Factor on `penalty` [1].

    Returns
    -------
    (K + 1,) int64 array
        0, the first index of each further piece, and N.
    """
    n = len(x)
    whole = np.array([0, n], dtype=np.int64)
    most = min(most, n // least)
    if most < 2:
        return whole
    u = (x - x[0]) / (x[-1] - x[0]) - 0.5
    v = y - y.mean()
    floor = n * (RESOLUTION * float(np.abs(y).max())) ** 2 + TINY
    sums = _sums(u, v)
    grid = -(-n // max_candidates)
    places = np.append(np.arange(0, n, grid), n)
    table = _partition(sums, places, least, most)
    best, chosen = np.inf, whole
    for k in range(1, most + 1):
        bounds = table[k - 1, : k + 1].copy()
        if bounds[0] < 0:
            break
        if grid > 1:
            _refine(sums, bounds, least, grid)
        power, product = _off_lines(sums, u, v, bounds)
        score = n * log_left(power, product, floor) + (k - 1) * penalty_scale * penalty(n)
        if score < best:
            best, chosen = score, bounds
    return chosen
