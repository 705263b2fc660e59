# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Scatter that a few outliers do not spoil."""

from __future__ import annotations

from math import comb, sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

MAD_SCALE = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""

_SPIKE = 12.0
"""Height of a spike over the median height of all peaks; of normal noise one in 1e8 has it [1]."""

NORMAL_975 = 1.959963984540054
"""97.5 % point of the normal distribution."""


def robust_sigma(off: FloatArray) -> float:
    """Return the standard deviation of N deviations from their centre, by their median size."""
    return MAD_SCALE * _median_taken(np.abs(off).ravel())


def robust_sigmas(off: FloatArray) -> FloatArray:
    """Return the same of each column of (N, F) deviations, (F,)."""
    return np.asarray(MAD_SCALE * np.median(np.abs(off), axis=0))


def _median_taken(values: FloatArray) -> float:
    """Return the bits of `np.median`, but bring the values, (N,), into another order.

    One place to part at instead of numpy's three, which its fastest selection does not take.
    """
    half = len(values) // 2
    if not len(values):
        return float("nan")
    values.partition(half)
    upper = values[half:]
    if np.isnan(upper.max()):  # what is no number is sorted to the end
        return float("nan")
    if len(values) % 2:
        return float(upper[0])
    return float((values[:half].max() + upper[0]) / 2.0)


def difference_sigma(differences: FloatArray, order: int) -> float:
    """Return the standard deviation of white noise from its differences of an order, (N,).

    They have the variance binomial(2 order, order) over that of the noise; a smooth motion below
    has none.
    """
    return robust_sigma(differences) / sqrt(comb(2 * order, order))


def find_spikes(values: FloatArray, least: float) -> BoolArray:
    """Return which values jump away and come straight back: what no mass does, (N,).

    A slow sensor's repeated values are one. A ramp and the corner of a motion are no spikes.

    Parameters
    ----------
    values : (N,) array
        A signal, in order; not a number = missing.
    least : float
        Least height of a spike [unit of the values].
    """
    spikes = np.zeros(len(values), dtype=bool)
    known = np.flatnonzero(np.isfinite(values))
    first = known[np.concatenate(([True], np.diff(values[known]) != 0.0))] if len(known) else known
    if len(first) < 3:
        return spikes
    step = np.diff(values[first])
    turns = step[:-1] * step[1:] < 0.0
    height = np.where(turns, np.minimum(np.abs(step[:-1]), np.abs(step[1:])), 0.0)
    if not turns.any():
        return spikes
    high = height > max(_SPIKE * float(np.median(height[turns])), least)
    last = np.append(first[1:], len(values))
    for k in (np.flatnonzero(high) + 1).tolist():
        spikes[first[k] : last[k]] = True
    return spikes
