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
    found = [
        _judged(s, *_second_value(gram, len(columns), len(columns) + k, rows))
        for k, s in enumerate(splits)
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
    moved = np.abs(np.diff(run.position, prepend=run.position[:1]))
    before = np.concatenate([run.position[:1], run.position[:-1]])
    for name, command, first, sign in (
        ("K_in", phases.v_in, 0, 1.0),
        ("K_out", phases.v_out, 2, -1.0),
    ):
        on = phases.free & phases.moving & (command > 0.0) & (solution.linear[first] > 0.0)
        weight = np.where(on, moved, 0.0)
        mean = float(weight @ command) / max(float(weight.sum()), 1e-300)
        base, sag = solution.linear[first : first + 2]
        size = float(base + sag * (2.0 * v_max - mean))
        for kind, where, text in (
            ("level", command, "at commands above"),
            ("place", before, "at positions above"),
        ):
            title = f"structure: {name} by {kind}"
            at = _median(where, weight)
            upper = on & (where > at)
            share = float(weight[upper].sum()) / max(float(weight.sum()), 1e-300)
            if not _MIN_SHARE <= share <= 1.0 - _MIN_SHARE or size <= 0.0:
                lies = f"{share:.0%} of the motion lies {text} {at:.2g}"
                why = f"cannot be told: {lies if weight.any() else 'no motion this way'}"
                undecided.append(Guard(title, True, np.nan, _MAX_DIFFERENCE, why))
                continue
            said = f"{name} {{}} {text} {at:.2g}"
            drive = np.where(upper, sign * command, 0.0)
            splits.append(_Split(title, drive, size, _MAX_DIFFERENCE, said))
    if solution.pole > 0.0 and (solution.linear[[0, 2]] > 0.0).all():
        title, limit = "structure: pole by direction", _MAX_POLE_DIFFERENCE
        splits.append(_Split(title, poles[:, 1], 1.0, limit, "the pole {} in outflow"))
    return splits, undecided


def _median(values: FloatArray, weight: FloatArray) -> float:
    """Return the weighted median."""
    weighty = weight > 0.0
    if not weighty.any():
        return float("nan")
    values, weight = values[weighty], weight[weighty]
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])


def _second_value(gram: FloatArray, size: int, column: int, rows: int) -> tuple[float, float]:
    """Return how much one parameter differs beyond the split, and its standard error."""
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = gram / np.outer(scale, scale)
    chosen = [*range(size), column]
    matrix = scaled[np.ix_(chosen, chosen)]
    inverse = np.empty_like(matrix)
    if not invert(matrix, np.arange(len(chosen)), inverse):
        if np.linalg.cond(matrix) > 1e12:
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
