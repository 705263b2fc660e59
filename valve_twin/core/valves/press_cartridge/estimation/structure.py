# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Is one parameter enough? A cycle split by direction, command level or operating point.

Where the model is too simple its parameters are precise and wrong, and residuals hide it: they
are never white. So each split gives one parameter a second value on one side of the split; a Wald
test says whether the two differ (Chow 1960, for whitened innovations of a common pole and noise
ratio), and their relative difference whether that matters. On real valves nearly every difference
is significant in time; only one that is also large fails.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Guard
from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import absorb
from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import invert
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import Phases, Run, Solution


_MAX_DIFFERENCE = 0.1
"""Largest difference of a gain on both sides of a split, relative to the gain [1], assumed."""

_MAX_POLE_DIFFERENCE = 0.3
"""Largest difference of the poles of both directions, to first order [1], assumed; a part of a
sample in the lag makes 0.4 on the simulated press, whose pole is thus not one parameter."""

_STANDARD_ERRORS = 4.0
"""How many of them a difference must have to count [1], assumed."""

_DEPENDENT = 1e12  # condition number from which a split says nothing of its own [1]

_MIN_SHARE = 0.15
"""Least share of the motion on each side of a split [1], assumed."""


@dataclass(frozen=True, slots=True)
class _Split:
    """One question: its column, the size that the answer is relative to, and how to say it."""

    name: str
    drive: FloatArray
    size: float
    limit: float
    text: str


def check_structure(
    run: Run,
    phases: Phases,
    use: BoolArray,
    solution: Solution,
    ratio: float,
    v_max: float,
) -> tuple[Guard, ...]:
    """Test whether directions, command levels and operating points share their parameters.

    Parameters
    ----------
    run, phases : Run, Phases
        The cycle.
    use : (N,) bool array
        Samples that were fitted.
    solution : Solution
        The fit.
    ratio : float
        Its ratio of process to measurement noise variance [1].
    v_max : float
        Greatest command [1].

    Returns
    -------
    tuple of Guard
        `value` is the difference relative to the gain (of the poles: itself), NaN where the cycle
        does not show it.
    """
    drives = _drives(phases, v_max)
    poles = _pole_drives(phases, drives, solution)
    splits, undecided = _splits(run, phases, solution, poles, v_max)
    if not splits:
        return tuple(undecided)
    base = np.flatnonzero(solution.linear > 0.0)
    columns = [*drives[:, base].T, *([poles.sum(axis=1)] if solution.pole > 0.0 else [])]
    matrix = np.column_stack([*columns, *(s.drive for s in splits)])
    gram = np.zeros((matrix.shape[1] + 1, matrix.shape[1] + 1))
    rows = whiten_columns(
        run.position,
        use,
        phases.free,
        phases.anchor,
        phases.moving,
        matrix,
        solution.pole,
        ratio,
        gram,
    )
    second = np.empty((len(splits), 2))
    second_values(gram, len(columns), rows, second)
    found = [
        _judged(s, *(second[k] if regular else _second_value(gram, len(columns), k, rows)))
        for k, (s, regular) in enumerate(zip(splits, np.isfinite(second[:, 0]), strict=True))
    ]
    return (*found, *undecided)


def _drives(phases: Phases, v_max: float) -> FloatArray:
    """Return the drive of each linear parameter: (N, 5); see `output_error_kernel`."""
    a, b = phases.v_in, phases.v_out
    sag_in, sag_out = a * (2.0 * v_max - a), -b * (2.0 * v_max - b)
    return np.column_stack([a, sag_in, -b, sag_out, -np.ones(len(a))])


def _pole_drives(phases: Phases, drives: FloatArray, solution: Solution) -> FloatArray:
    """Return the drives (N, 2) whose responses are the sensitivities to the pole.

    Of inflow and outflow: the speed s obeys s[n] = z s[n-1] + (1 - z) d[n], its derivative by z
    the same with s[n-1] - d[n] in place of (1 - z) d[n].
    """
    speed = np.zeros((len(drives), 2))
    own = np.column_stack(
        [drives[:, :2] @ solution.linear[:2], drives[:, 2:4] @ solution.linear[2:4]]
    )
    propagate(phases.free, own, solution.pole, speed)
    before = np.vstack([np.zeros((1, 2)), speed[:-1]])
    return (before - own) / (1.0 - solution.pole)


def _splits(
    run: Run,
    phases: Phases,
    solution: Solution,
    poles: FloatArray,
    v_max: float,
) -> tuple[list[_Split], list[Guard]]:
    splits: list[_Split] = []
    undecided: list[Guard] = []
    before = np.concatenate([run.position[:1], run.position[:-1]])
    middles, shares = np.empty(2), np.empty(2)
    for name, command, first, sign in (
        ("K_in", phases.v_in, 0, 1.0),
        ("K_out", phases.v_out, 2, -1.0),
    ):
        on = phases.free & phases.moving & (command > 0.0) & (solution.linear[first] > 0.0)
        mean, amount = find_middles(run.position, on, command, middles, shares)
        base, sag = solution.linear[first : first + 2]
        size = float(base + sag * (2.0 * v_max - mean))
        for kind, where, text, at, share in (
            ("level", command, "at commands above", middles[0], shares[0]),
            ("place", before, "at positions above", middles[1], shares[1]),
        ):
            title = f"structure: {name} by {kind}"
            if not _MIN_SHARE <= share <= 1.0 - _MIN_SHARE or size <= 0.0:
                lies = f"{share:.0%} of the motion lies {text} {at:.2g}"
                why = f"cannot be told: {lies if amount > 0.0 else 'no motion this way'}"
                undecided.append(Guard(title, True, np.nan, _MAX_DIFFERENCE, why))
                continue
            said = f"{name} {{}} {text} {at:.2g}"
            drive = np.where(on & (where > at), sign * command, 0.0)
            splits.append(_Split(title, drive, size, _MAX_DIFFERENCE, said))
    if solution.pole > 0.0 and (solution.linear[[0, 2]] > 0.0).all():
        title, limit = "structure: pole by direction", _MAX_POLE_DIFFERENCE
        splits.append(_Split(title, poles[:, 1], 1.0, limit, "the pole {} in outflow"))
    return splits, undecided


def _second_value(gram: FloatArray, size: int, split: int, rows: int) -> tuple[float, float]:
    """Return the same as `second_values` of one split whose columns are nearly dependent."""
    scale = np.sqrt(np.maximum(np.diag(gram), 0.0))  # rounding may leave less
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = gram / np.outer(scale, scale)
    column = size + split
    chosen = [*range(size), column]
    matrix = scaled[np.ix_(chosen, chosen)]
    if np.linalg.cond(matrix) > _DEPENDENT:
        return float("nan"), float("nan")
    inverse = np.linalg.inv(matrix)
    solution = inverse @ scaled[chosen, -1]
    cost = max(1.0 - float(solution @ scaled[chosen, -1]), 0.0) * float(gram[-1, -1])
    variance = cost / max(rows - len(chosen), 1)
    error = float(np.sqrt(variance * inverse[-1, -1])) / scale[column]
    return float(solution[-1] * scale[-1] / scale[column]), error


def _judged(split: _Split, apart: float, error: float) -> Guard:
    if not (np.isfinite(apart) and error > 0.0):
        reason = "cannot be told: no motion of its own on both sides"
        return Guard(split.name, True, np.nan, split.limit, reason)
    relative, ratio = apart / split.size, abs(apart) / error
    passed = abs(relative) <= split.limit or ratio < _STANDARD_ERRORS
    unit = "" if split.size == 1.0 else " %"
    shown = f"{relative:+.2f}" if split.size == 1.0 else f"{100.0 * relative:+.1f}"
    said = split.text.format(f"differs by {shown}{unit}")
    reason = f"{said} ({ratio:.1f} standard errors)"
    return Guard(split.name, bool(passed), float(relative), split.limit, reason)


@njit(cache=True)
def second_values(gram: FloatArray, size: int, rows: int, found: FloatArray) -> None:
    """Write how much one parameter differs beyond each split, and its standard error.

    Parameters
    ----------
    gram : (C + S + 1, C + S + 1) array
        Normal equations of C parameters and S splits, the measurement last [1].
    size : int
        C [1].
    rows : int
        Innovations that they are made of [1].
    found : (S, 2) array
        Overwritten; NaN where the columns are dependent, or nearly [1].
    """
    last, count = len(gram) - 1, size + 1
    which, inverse = np.arange(count), np.empty((count, count))
    for split in range(len(found)):
        which[size] = size + split
        found[split, :] = np.nan
        if not invert(gram, which, inverse):
            continue
        explained = apart = 0.0
        for i in range(count):
            apart = 0.0
            for j in range(count):
                apart += inverse[i, j] * gram[which[j], last]
            explained += apart * gram[which[i], last]
        variance = max(gram[last, last] - explained, 0.0) / max(rows - count, 1)
        found[split, 0] = apart
        found[split, 1] = np.sqrt(variance * inverse[size, size])


@njit(cache=True)
def find_middles(
    y: FloatArray, moves: BoolArray, command: FloatArray, middles: FloatArray, shares: FloatArray
) -> tuple[float, float]:
    """Write where the motion under a command has its middle; return its mean and its amount.

    Parameters
    ----------
    y : (N,) array
        Measured position [1].
    moves : (N,) bool array
        Samples at which the command moves the spool.
    command : (N,) array
        Command [1].
    middles, shares : (2,) arrays
        Overwritten: the medians of command and of position before, each sample with the weight
        of its motion, NaN without motion; the share of the motion beyond each [1].

    Returns
    -------
    mean, amount : float
        Mean of the command with the same weight, sum of the weights [1].
    """
    weight, values = np.empty(len(y)), np.empty((2, len(y)))
    count, amount, mean = 0, 0.0, 0.0
    for n in range(1, len(y)):
        moved = abs(y[n] - y[n - 1])
        if moves[n] and moved > 0.0:
            weight[count], values[0, count], values[1, count] = moved, command[n], y[n - 1]
            count += 1
            amount += moved
            mean += moved * command[n]
    middles[:], shares[:] = np.nan, 0.0
    if not count:
        return 0.0, 0.0
    for kind in range(2):
        order = np.argsort(values[kind, :count], kind="mergesort")
        half = 0.0
        for k in order:
            half += weight[k]
            if half >= 0.5 * amount:
                middles[kind] = values[kind, k]
                break
        for k in range(count):
            if values[kind, k] > middles[kind]:
                shares[kind] += weight[k] / amount
    return mean / amount, amount


@njit(cache=True)
def propagate(free: BoolArray, drive: FloatArray, pole: float, speed: FloatArray) -> None:
    """Write the speeds of C drives: zero on the seats.

    Parameters
    ----------
    free : (N,) bool array
        Whether the spool is off the seats.
    drive : (N, C) array
        What drives the spool [1].
    pole : float
        Pole of the speed [1].
    speed : (N, C) array
        Overwritten where the spool is off the seats [1].
    """
    for n in range(1 if len(free) else 0, len(free)):
        for k in range(drive.shape[1]):
            if free[n]:
                speed[n, k] = pole * speed[n - 1, k] + (1.0 - pole) * drive[n, k]


@njit(cache=True)
def whiten_columns(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: FloatArray,
    moving: BoolArray,
    drives: FloatArray,
    pole: float,
    ratio: float,
    gram: FloatArray,
) -> int:
    """Write the normal equations of the innovations of any drives; return their rows.

    As `kalman_kernel.whiten`, which is faster for the columns that every fit has.

    Parameters
    ----------
    y : (N,) array
        Measured position [1].
    use, free, moving : (N,) bool arrays
        See `Stretch`.
    anchor : (N,) array
        See `Stretch` [1].
    drives : (N, C) array
        What drives the spool, a column a parameter [1].
    pole, ratio : float
        Pole, variance of process over measurement noise [1].
    gram : (C + 1, C + 1) array
        Overwritten, the measurement last [1].
    """
    count = drives.shape[1] + 1
    last = count - 1
    speed, level = np.zeros(count), np.zeros(count)
    place, drift, innovation = np.zeros(count), np.zeros(count), np.zeros(count)
    known = False
    p11 = p12 = p22 = 0.0
    rows = 0
    gram[:, :] = 0.0
    for n in range(len(y)):
        if 0.0 < anchor[n] < np.inf:
            p11 += anchor[n]
        elif anchor[n] > 0.0:
            known = False
            drift[:] = 0.0
            p12 = p22 = 0.0
        if free[n]:
            for k in range(last):
                speed[k] = pole * speed[k] + (1.0 - pole) * drives[n, k]
                level[k] += speed[k]
            for k in range(count):
                drift[k] *= pole
                place[k] += drift[k]
            noise = ratio if moving[n] else 0.0
            p11 += 2.0 * pole * p12 + pole * pole * p22 + noise
            p12 = pole * p12 + pole * pole * p22 + noise
            p22 = pole * pole * p22 + noise
        else:
            speed[:] = 0.0
            drift[:] = 0.0
            p12 = p22 = 0.0
        if not use[n]:
            continue
        level[last] = y[n]
        if not known:
            place[:] = level
            known = True
            p11, p12 = 1.0, 0.0
            continue
        p11, p12, p22 = absorb(level, place, drift, innovation, (p11, p12, p22), gram, count)
        rows += 1
    for i in range(count):
        for j in range(i + 1, count):
            gram[i, j] = gram[j, i]
    return rows
