# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Repeated position values: of a sensor refreshed slower than it is logged, or of a frozen one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_MAX_REFRESH = 32  # longest refresh period looked for [samples]
_MIN_RUNS = 6  # fewest changes of value in motion that establish a refresh period [1]
_REFRESH_FOUND = 1.25  # a mean run this long is a slow sensor, not chance [samples]
_FREEZE_RUN = 5  # shortest repetition that noise at rest makes a freeze [samples]
_CHANCE = 1e-4  # accepted probability of a false freeze in a cycle [1]
_ALIVE = 0.3  # share of reversals that is noise; white noise has 2/3 [1]


def find_stale(
    x: FloatArray, active: BoolArray, breaks: BoolArray, *, max_lag: int
) -> tuple[BoolArray, float]:
    """Mark repeated values of a sensor that is slower than its log, and single freezes.

    A repeat proves nothing at rest, on a quantised slow ramp or on a seat. It does where the value
    jumps by more than two quanta at both ends of the run, and not back (that is a stop): there the
    spool moved meanwhile. Where the refresh is regular, repeats at rest are stale too.

    Parameters
    ----------
    x : (N,) array
        Position [1]; NaN where it is bad.
    active : (N,) bool array
        A command acts.
    breaks : (N,) bool array
        The sample before this one is missing or bad.
    max_lag : int
        Longest command to position lag [samples].

    Returns
    -------
    tuple of (N,) bool array and float
        The stale samples and the refresh period [samples]; 1 = every sample is fresh.
    """
    stale = np.zeros(len(x), bool)
    first, length = _runs(x, breaks)
    if len(first) < _MIN_RUNS:
        return stale, 1.0
    jump = np.zeros(len(first) + 1)
    jump[1:-1] = np.where(breaks[first[1:]], 0.0, x[first[1:]] - x[first[1:] - 1])
    size = np.abs(jump)
    moved = size[size > 0.0]
    if len(moved) == 0:
        return stale, 1.0
    quantum = moved.min()
    before, after = jump[:-1], jump[1:]
    moving = (np.abs(before) > 2.0 * quantum) & (np.abs(after) > 2.0 * quantum)
    refresh = _refresh_period(length[moving])
    if refresh > 1.0:
        for i, n in zip(first[length > 1], length[length > 1], strict=True):
            k = np.arange(1, n)
            fresh = np.floor(k / refresh + 1e-9) > np.floor((k - 1) / refresh + 1e-9)
            stale[i + 1 : i + n] = ~fresh
        return stale, refresh
    through_motion = moving & (before * after > 0.0)
    return _find_freezes(x, active, first, length, through_motion, max_lag), 1.0


def _runs(x: FloatArray, breaks: BoolArray) -> tuple[IntArray, IntArray]:
    """First sample and length of each run of one repeated value; a break ends a run."""
    change = np.ones(len(x), bool)
    change[1:] = (x[1:] != x[:-1]) | breaks[1:]
    first = np.flatnonzero(change)
    return first, np.diff(np.append(first, len(x)))


def _refresh_period(length: IntArray) -> float:
    """Mean run length in motion where it is regular, else 1 [samples]."""
    length = length[length <= _MAX_REFRESH]
    if len(length) < _MIN_RUNS:
        return 1.0
    mode = int(np.argmax(np.bincount(length)))
    regular = length[np.abs(length - mode) <= 1]
    if len(regular) < 0.7 * len(length):
        return 1.0
    mean = float(regular.mean())
    if mean < _REFRESH_FOUND:
        return 1.0
    return float(round(mean)) if abs(mean - round(mean)) < 0.1 else mean


def _find_freezes(
    x: FloatArray,
    active: BoolArray,
    first: IntArray,
    length: IntArray,
    through_motion: BoolArray,
    max_lag: int,
) -> BoolArray:
    """Find single long repetitions: through a motion, or where noise is alive at rest.

    Noise reverses, a leak does not. A run at the end of the range is a sensor that clips.
    """
    stale = np.zeros(len(x), bool)
    alive = length >= _surprising_run(x, ~active, first, length, noise=True)
    long = length >= _surprising_run(x, active, first, length, noise=False)
    commanded = np.add.reduceat(active, first, dtype=np.int64)
    frozen = alive | (long & through_motion & (commanded > max_lag))
    frozen &= (x[first] > np.nanmin(x)) & (x[first] < np.nanmax(x))
    for i, n in zip(first[frozen], length[frozen], strict=True):
        stale[i + 1 : i + n] = True
    return stale


def _surprising_run(
    x: FloatArray, where: BoolArray, first: IntArray, length: IntArray, *, noise: bool
) -> float:
    """Shortest repetition beyond chance; infinite where there is no noise but must be."""
    longest = int(np.argmax(length))
    outside = where.copy()
    outside[first[longest] : first[longest] + length[longest]] = False
    step = np.diff(x)
    both = outside[1:-1] & outside[2:]
    if both.sum() < 4 * _FREEZE_RUN:
        return float("inf")
    if noise and np.mean((step[1:] * step[:-1] < 0.0)[both]) < _ALIVE:
        return float("inf")
    repeats = min(max(float(np.mean(step[1:][both] == 0.0)), 1e-3), 1.0 - 1e-9)
    return max(_FREEZE_RUN, 1.0 + float(np.log(_CHANCE / len(x)) / np.log(repeats)))
