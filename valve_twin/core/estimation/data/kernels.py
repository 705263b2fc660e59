# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled passes over the samples of one cycle: masks, noise, rows, excitation, independence.

Each does in one pass what its caller describes; the callers hold the meaning and the limits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_LONG_AGO = -(1 << 40)
_SWEEPS = 30  # most Jacobi sweeps; five or six unless columns are nearly dependent


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
def rest_bends(
    position: FloatArray,
    inputs: FloatArray,
    bad: BoolArray,
    gap: BoolArray,
    left_out: BoolArray,
    active: float,
    settle: int,
) -> tuple[float, int]:
    """Return the sum of squared second differences at rest, of fresh samples, and their number.

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    inputs : (N, M) array
        Commands [1].
    bad, gap, left_out : (N,) bool arrays
        Bad samples, those after a gap, those not to be used.
    active : float
        Command that acts [1].
    settle : int
        Samples after a command until rest [1].
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
        if not rest or left_out[i]:
            continue
        if first_label == label:
            bend = position[i] - 2.0 * second + first
            total += bend * bend
            count += 1
        first, first_label = second, second_label
        second, second_label = position[i], label
    return total, count


@njit(cache=True)
def mark_rows(lost: BoolArray, bad: BoolArray, gap: BoolArray, back: int, rows: IntArray) -> int:
    """Fill rows with the samples whose regression row is whole; returns how many.

    Parameters
    ----------
    lost, bad, gap : (N,) bool arrays
        Masked samples, bad ones, those after a gap.
    back : int
        Samples that a row reaches back [1].
    rows : (N,) int64 array
        Filled from its begin.
    """
    count = 0
    last_lost = last_bad = last_gap = _LONG_AGO
    for i in range(len(lost)):
        if lost[i]:
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


@njit(cache=True)
def extreme_eigenvalues(matrix: FloatArray) -> tuple[float, float]:
    """Return least and greatest eigenvalue of a Gram matrix scaled to a unit diagonal.

    By Jacobi rotations; columns of zeros are left out, (0, 0) where nothing is left.
    """
    columns = np.flatnonzero(np.diag(matrix) > 0.0)
    k = len(columns)
    if k == 0:
        return 0.0, 0.0
    a = np.empty((k, k))
    for i in range(k):
        for j in range(k):
            size = np.sqrt(matrix[columns[i], columns[i]]) * np.sqrt(
                matrix[columns[j], columns[j]]
            )
            a[i, j] = matrix[columns[i], columns[j]] / size
    for _ in range(_SWEEPS):
        off = 0.0
        for i in range(k):
            for j in range(i):
                off += a[i, j] * a[i, j]
        if off < 1e-36:
            break
        for i in range(1, k):
            for j in range(i):
                _rotate(a, i, j)
    return np.diag(a).min(), np.diag(a).max()


@njit(cache=True)
def _rotate(a: FloatArray, i: int, j: int) -> None:
    """Make the element (i, j) of a symmetric matrix zero by a rotation."""
    if a[i, j] == 0.0:
        return
    slope = (a[j, j] - a[i, i]) / (2.0 * a[i, j])
    tangent = 1.0 / (abs(slope) + np.sqrt(slope * slope + 1.0))
    if slope < 0.0:
        tangent = -tangent
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for n in range(len(a)):
        left, right = a[n, i], a[n, j]
        a[n, i], a[n, j] = cosine * left - sine * right, sine * left + cosine * right
    for n in range(len(a)):
        left, right = a[i, n], a[j, n]
        a[i, n], a[j, n] = cosine * left - sine * right, sine * left + cosine * right
