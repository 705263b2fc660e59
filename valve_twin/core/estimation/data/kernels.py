# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled passes over the samples of one cycle: masks, noise, rows, excitation, independence.

Each does in one pass what its caller describes; the callers hold the meaning and the limits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.gaps import mark_gaps
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_LONG_AGO = -(1 << 40)


@njit(cache=True)
def mark_samples(
    position: FloatArray,
    inputs: FloatArray,
    valid: BoolArray,
    push: FloatArray,
    bad: BoolArray,
    drive: FloatArray,
    x: FloatArray,
) -> None:
    """Fill bad (N,), the net command (N,) and the position (N,), NaN where bad.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    inputs : (N, M) array
        Commands [1].
    valid : (N,) bool array
        Whether the frame is complete.
    push : (M,) array
        Direction into which each command drives [1].
    bad : (N,) bool array
        Overwritten.
    drive, x : (N,) arrays
        Overwritten with net command and position [1].
    """
    for i in range(len(position)):
        good = valid[i] and np.isfinite(position[i])
        drive[i] = 0.0
        for j in range(inputs.shape[1]):
            if np.isfinite(inputs[i, j]):
                drive[i] += inputs[i, j] * push[j]
            else:
                good = False
        bad[i] = not good
        x[i] = position[i] if good else np.nan


@njit(cache=True)
def mark_breaks(bad: BoolArray, gap: BoolArray, breaks: BoolArray) -> None:
    """Fill breaks (N,): the sample before this one is missing or bad, or this one is bad.

    Parameters
    ----------
    bad, gap : (N,) bool arrays
        Bad samples, and those after a gap.
    breaks : (N,) bool array
        Overwritten.
    """
    for i in range(len(bad)):
        breaks[i] = gap[i] or bad[i] or (i > 0 and bad[i - 1])


@njit(cache=True)
def longest_run(x: FloatArray, breaks: BoolArray) -> int:
    """Return the length of the longest repetition of one value; a break ends it."""
    longest = run = 0
    for i in range(len(x)):
        run = run + 1 if i > 0 and x[i] == x[i - 1] and not breaks[i] else 1
        longest = max(longest, run)
    return longest


@njit(cache=True)
def mark_seat(
    x: FloatArray,
    drive: FloatArray,
    low: float,
    high: float,
    active: float,
    reach: int,
    seat: BoolArray,
) -> None:
    """Fill seat (N,): beyond a stop and pushed into it within the last `reach` samples.

    Parameters
    ----------
    x, drive : (N,) arrays
        Position and net command [1].
    low, high : float
        Where the stops begin [1].
    active : float
        Command that pushes [1].
    reach : int
        Samples that a push counts [1].
    seat : (N,) bool array
        Overwritten.
    """
    down = up = _LONG_AGO
    for i in range(len(x)):
        if drive[i] < -active:
            down = i
        if drive[i] > active:
            up = i
        seat[i] = (x[i] <= low and i - down <= reach) or (x[i] >= high and i - up <= reach)


@njit(cache=True)
def mark_stuck(
    x: FloatArray,
    drive: FloatArray,
    breaks: BoolArray,
    half: int,
    max_lag: int,
    command: float,
    motion: float,
    stuck: BoolArray,
) -> None:
    """Mark windows of 2 `half` samples commanded one way throughout without motion.

    Parameters
    ----------
    x, drive : (N,) arrays
        Position and net command [1].
    breaks : (N,) bool array
        See `mark_breaks`.
    half : int
        Half a window [samples].
    max_lag : int
        Longest lag of the motion [samples].
    command, motion : float
        Least command that moves, least motion [1].
    stuck : (N,) bool array
        Set where it is stuck, else kept.
    """
    n, window = len(x), 2 * half
    if n < window + max_lag:
        return
    up = down = whole = 0
    for i in range(n):
        up = up + 1 if drive[i] > command else 0
        down = down + 1 if drive[i] < -command else 0
        whole = 0 if breaks[i] else whole + 1
        if max(up, down) < window + max_lag or whole < window:
            continue
        late = early = power = 0.0
        for k in range(half):
            late += x[i - k]
            early += x[i - half - k]
        for k in range(window):
            step = x[i - k] - x[i - k - 1] if i > k else 0.0
            if np.isfinite(step):
                power += step * step
        # standard deviation of the difference of two half means of white noise:
        # sigma sqrt(2 / half), its steps have twice the variance
        floor = max(motion, 3.0 * np.sqrt(0.5 * power / window * 2.0 / half))
        if abs(late - early) / half < floor:
            for k in range(window):
                stuck[i - k] = True


@njit(cache=True)
def mark_all(
    position: FloatArray,
    inputs: FloatArray,
    valid: BoolArray,
    stamp_ns: IntArray,
    gap_ns: float,
    push: FloatArray,
    limits: tuple[float, float, float, float, float],
    samples: tuple[int, int],
    flags: BoolArray,
    found: FloatArray,
) -> tuple[int, bool]:
    """Fill all flags that `masks` needs no other pass for, net command and position.

    Parameters
    ----------
    position, inputs, valid : arrays
        See `mark_samples`.
    stamp_ns : (N,) int64 array
        Stamps [ns].
    gap_ns : float
        Step between stamps above which a sample is missing [ns].
    push : (M,) array
        Direction into which each command drives [1].
    limits : tuple of float
        Where the stops begin, the command that pushes, least command that moves, least motion [1].
    samples : tuple of int
        Longest lag, half a window of `mark_stuck` [samples].
    flags : (5, N) bool array of False
        Filled with bad samples, those after a gap, breaks, samples on a seat and stuck ones.
    found : (2, N) array
        Overwritten with net command and position [1].

    Returns
    -------
    int, bool
        Length of the longest repetition of one value, whether any sample is stuck.
    """
    bad, gap, breaks, seat, stuck = flags[0], flags[1], flags[2], flags[3], flags[4]
    drive, x = found[0], found[1]
    (low, high, active, command, motion), (max_lag, half) = limits, samples
    mark_samples(position, inputs, valid, push, bad, drive, x)
    mark_gaps(stamp_ns, gap_ns, gap)
    mark_breaks(bad, gap, breaks)
    # the lookback covers the lag and the sample after the impact, whose speed the stop cut off
    mark_seat(x, drive, low, high, active, max_lag + 2, seat)
    mark_stuck(x, drive, breaks, half, max_lag, command, motion, stuck)
    return longest_run(x, breaks), bool(stuck.any())


@njit(cache=True)
def rest_bends(
    position: FloatArray,
    inputs: FloatArray,
    bad: BoolArray,
    gap: BoolArray,
    stale: BoolArray,
    stuck: BoolArray,
    active: float,
    settle: int,
    bends: FloatArray,
) -> tuple[float, int]:
    """Return the sum of squared second differences at rest, of fresh samples, and their number.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    inputs : (N, M) array
        Commands [1].
    bad, gap, stale, stuck : (N,) bool arrays
        Bad samples, those after a gap, and others not to be used.
    active : float
        Command that acts [1].
    settle : int
        Samples after a command until rest [1].
    bends : (N,) array
        Gets these second differences [1].
    """
    acted, label = _LONG_AGO, 0
    count, first, second, total = 0, 0.0, 0.0, 0.0
    first_label = second_label = -1
    for i in range(len(position)):
        acting = bad[i]
        for j in range(inputs.shape[1]):
            acting = acting or abs(inputs[i, j]) > active
        if acting:
            acted = i
        rest = i - acted > settle
        if not rest or gap[i]:
            label += 1
        if not rest or bad[i] or stale[i] or stuck[i]:
            continue
        if first_label == label:
            bend = position[i] - 2.0 * second + first
            total += bend * bend
            bends[count] = bend
            count += 1
        first, first_label = second, second_label
        second, second_label = position[i], label
    return total, count


@njit(cache=True)
def mark_rows(
    seat: BoolArray,
    stuck: BoolArray,
    stale: BoolArray,
    bad: BoolArray,
    gap: BoolArray,
    keep_stale: bool,
    back: int,
    rows: IntArray,
) -> int:
    """Fill rows with the samples whose regression row is whole; returns how many.

    Parameters
    ----------
    seat, stuck, stale, bad, gap : (N,) bool arrays
        See `masks.Masks`.
    keep_stale : bool
        Whether stale samples are used as if they were measured.
    back : int
        Samples that a row reaches back [1].
    rows : (N,) int64 array
        Filled from its begin.
    """
    count = 0
    last_lost = last_bad = last_gap = _LONG_AGO
    for i in range(len(bad)):
        if bad[i] or seat[i] or stuck[i] or (stale[i] and not keep_stale):
            last_lost = i
        if bad[i]:
            last_bad = i
        if gap[i]:
            last_gap = i
        if i >= back and i - last_lost > 2 and i - last_bad > back and i - last_gap >= back:
            rows[count] = i
            count += 1
    return count


@njit(cache=True)
def count_masked(
    seat: BoolArray, stuck: BoolArray, stale: BoolArray, bad: BoolArray, gap: BoolArray
) -> tuple[int, int, int, int]:
    """Return how many samples are on a seat, stuck, stale, and bad or after a gap.

    Parameters
    ----------
    seat, stuck, stale, bad, gap : (N,) bool arrays
        See `masks.Masks`.
    """
    on_seat = is_stuck = is_stale = is_bad = 0
    for i in range(len(seat)):
        on_seat += seat[i]
        is_stuck += stuck[i]
        is_stale += stale[i]
        is_bad += bad[i] or gap[i]
    return on_seat, is_stuck, is_stale, is_bad


@njit(cache=True)
def excitation_sums(
    position: FloatArray, inputs: FloatArray, rows: IntArray, lag: int, column: int, active: float
) -> tuple[int, float, float, float]:
    """Return rows with an active input, travel in them, mean and deviation of its level.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    inputs : (N, M) array
        Commands [1].
    rows : (R,) int64 array
        Samples of the regression.
    lag : int
        From command to position [samples].
    column : int
        Which command.
    active : float
        Level above which it acts [1].
    """
    count, travel, total, square = 0, 0.0, 0.0, 0.0
    for n in rows:
        level = inputs[n - lag, column]
        if level > active:
            count += 1
            travel += position[n] - position[n - 1]
            total += level
    if count == 0:
        return 0, 0.0, np.nan, np.nan
    mean = total / count
    for n in rows:
        level = inputs[n - lag, column]
        if level > active:
            square += (level - mean) ** 2
    return count, abs(travel), mean, np.sqrt(square / count)


@njit(cache=True)
def choose_independent(
    matrix: FloatArray, columns: IntArray, least: float, chosen: IntArray
) -> int:
    """Fill chosen with the columns whose part outside the earlier ones is large enough.

    The part is a pivot of the Cholesky factor of the matrix scaled to a unit diagonal.

    Parameters
    ----------
    matrix : (K, K) array
        Normal matrix [1].
    columns : (C,) int64 array
        Candidates in their order.
    least : float
        Least part outside the earlier ones [1].
    chosen : (C,) int64 array
        Filled from its begin.
    """
    k = len(columns)
    lower, length = np.zeros((k, k)), np.empty(k)
    count = 0
    for column in columns:
        size = np.sqrt(matrix[column, column])
        if not size > 0.0:
            continue
        rest = 1.0
        for c in range(count):
            part = matrix[column, chosen[c]] / (size * length[c])
            for n in range(c):
                part -= lower[count, n] * lower[c, n]
            lower[count, c] = part / lower[c, c]
            rest -= lower[count, c] * lower[count, c]
        if rest > least:
            lower[count, count] = np.sqrt(rest)
            length[count] = size
            chosen[count] = column
            count += 1
    return count
