# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled scatter of a series about its robust line, with the bits of numpy's median and sum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import MAD_SCALE
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_BLOCK = 128  # numbers that numpy sums without halving them
_FEW = 48  # numbers that are sorted to find their middle
_HALVINGS = 40  # of the range that holds the middle; equal numbers cannot be parted


@njit(cache=True, error_model="numpy")
def scatter_about_line(values: FloatArray, outlier: float) -> tuple[float, int]:
    """Return the standard deviation about the line of median slope, and degrees of freedom.

    Parameters
    ----------
    values : (N,) array
        Values at equal distances, at least three; where one is not finite, so is the result
        [any unit].
    outlier : float
        Values further from the line are left out [robust standard deviations].
    """
    n = len(values)
    if not np.isfinite(values).all():
        return np.nan, n - 2
    slope = _median_slope(values)
    off = np.empty(n)
    for i in range(n):
        off[i] = values[i] - slope * i
    off -= middle_of(off)
    limit = outlier * (MAD_SCALE * middle_of(np.abs(off)))
    keep = np.abs(off) <= limit if limit > 0.0 else np.ones(n, dtype=np.bool_)
    at = np.flatnonzero(keep)
    x, y = at.astype(np.float64), values[at]
    x -= sum_as_numpy(x) / len(x)
    y -= sum_as_numpy(y) / len(y)
    along = sum_as_numpy(x * y)
    squares = sum_as_numpy(y * y) - along * along / sum_as_numpy(x * x)
    freedom = len(y) - 2
    return np.sqrt(max(squares, 0.0) / freedom), freedom


@njit(cache=True, error_model="numpy")
def _median_slope(values: FloatArray) -> float:
    """Return the median slope between any two of N values at equal distances."""
    n = len(values)
    slopes = np.empty(n * (n - 1) // 2)
    first = 0
    for gap in range(1, n):
        for i in range(n - gap):
            slopes[first + i] = (values[i + gap] - values[i]) / gap
        first += n - gap
    return middle_of(slopes)


@njit(cache=True, error_model="numpy")
def middle_of(values: FloatArray) -> float:
    """Return the median of N finite values, at least one: the bits of `np.median`.

    The range that holds the middle is halved by counting what lies below, which is a loop of
    vectors; only the few left in it are sorted.

    Parameters
    ----------
    values : (N,) array
        Any unit.
    """
    last = len(values) // 2
    first = last if len(values) % 2 else last - 1
    low, high = values.min(), values.max()
    below, until = 0, len(values)  # so many lie below `low` and, of its copies too, up to `high`
    top = True  # whether `high` itself is inside
    for _ in range(_HALVINGS):
        if until - below <= _FEW:
            break
        half = low + 0.5 * (high - low)
        count = 0
        for i in range(len(values)):
            count += values[i] < half
        if count <= first:
            low, below = half, count
        elif count > last:
            high, until, top = half, count, False
        else:
            break
    inside = np.empty(until - below)
    count = 0
    for value in values:
        if low <= value and (value < high or (top and value == high)):
            inside[count] = value
            count += 1
    inside.sort()
    middle: float = inside[last - below]
    return middle if first == last else (inside[first - below] + middle) / 2.0


@njit(cache=True)
def sum_as_numpy(values: FloatArray) -> float:
    """Return the sum of N values, added in the order in which `np.sum` adds: eight sums.

    Parameters
    ----------
    values : (N,) array
        Any unit.
    """
    n = len(values)
    if n > _BLOCK:
        half = n // 2
        half -= half % 8
        return sum_as_numpy(values[:half]) + sum_as_numpy(values[half:])
    if n < 8:
        total = 0.0
        for value in values:
            total += value
        return total
    parts = values[:8].copy()
    whole = n - n % 8
    for i in range(8, whole):
        parts[i % 8] += values[i]
    whole_sum: float = ((parts[0] + parts[1]) + (parts[2] + parts[3])) + (
        (parts[4] + parts[5]) + (parts[6] + parts[7])
    )
    for i in range(whole, n):
        whole_sum += values[i]
    return whole_sum
