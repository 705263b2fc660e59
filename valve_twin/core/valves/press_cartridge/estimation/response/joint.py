# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled search of delay and pole together, from eight places at once.

The free run is linear in the rest, and what weighs a sample depends on neither: a Gauss-Newton
step of both comes from the sensitivities of one pass over the cycle (variable projection, Golub
and Pereyra 1973, with the Jacobian of Kaufman 1975). The delay is piecewise linear in the
commands, so a search stays between two whole samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
    solve_positive,
)
from valve_twin.core.valves.press_cartridge.estimation.response.lanes import (
    AT,
    DELAY,
    GRAM,
    POLE,
    SIZE,
    STILL,
    run_lanes,
)
from valve_twin.core.valves.press_cartridge.estimation.response.weights import weigh_rows
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import LANES
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import Rows
    from valve_twin.core.valves.press_cartridge.estimation.response.weights import Weighed

_LAST = N_LINEAR + 2
_PASSES = 25
_ROUGH = 1e-4  # speed of a response that is at rest where the pole to begin with is chosen [1]
_LARGEST_POLE, _LARGEST_PART = 0.2, 0.3  # steps at once [1, samples]
_FOUND = 1e-6  # of twice the log likelihood: a step that gains less is taken without a look
_HOPELESS = 4.0  # times the gain of a step that leave a search behind the best
_STARTS = (-0.8, -0.4, -0.17, -0.06, 0.06, 0.2, 0.5)  # about the lag [samples]
_WHOLE = 0.05  # a delay nearer to the lag is compared with it [samples]
_SINGULAR = 1e-12  # relative pivot below which a step cannot be told


class Cycle(NamedTuple):
    """What is searched in.

    Attributes
    ----------
    rows : Rows
        The cycle, commands without delay.
    v_max, wander : float
        Greatest command, random walk [1].
    columns : (5,) bool array
        Parameters that are fitted.
    lag : int
        About which the delay is searched [samples].
    usual : float
        Standard deviation of the part of a sample; 0 = the delay is the lag [samples].
    searched : bool
        Whether the pole is searched.
    """

    rows: Rows
    v_max: float
    wander: float
    columns: BoolArray
    lag: int
    usual: float
    searched: bool


class Searches(NamedTuple):
    """Eight searches beside each other, (8,) each where not said.

    Attributes
    ----------
    work : (SIZE,) array
        Of `run_lanes`.
    pole, part : arrays
        Where each looks next [1, samples].
    low, high : arrays
        Limits of the part [samples].
    best, best_pole, best_part : arrays
        Least minus twice the log likelihood, and where [1, 1, samples].
    step_pole, step_part, gain : arrays
        The step from there that is tried [1, samples], and what it should lower the best by.
    p : (8, 5) array
        Parameters [1].
    done : bool array
        Whether it has ended.
    """

    work: FloatArray
    pole: FloatArray
    part: FloatArray
    low: FloatArray
    high: FloatArray
    best: FloatArray
    best_pole: FloatArray
    best_part: FloatArray
    step_pole: FloatArray
    step_part: FloatArray
    gain: FloatArray
    p: FloatArray
    done: BoolArray


@njit(cache=True)
def _new_searches() -> Searches:
    return Searches(
        np.zeros(SIZE),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.full(LANES, np.inf),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros((LANES, N_LINEAR)),
        np.zeros(LANES, dtype=np.bool_),
    )


@njit(cache=True, error_model="numpy")
def _schur(whole: FloatArray, p: FloatArray, matrix: FloatArray, side: FloatArray) -> None:
    """Write the normal equations of pole and delay with the positive parameters projected out."""
    factor = np.zeros((_LAST, _LAST))
    kept = np.zeros(_LAST, dtype=np.bool_)
    for j in range(_LAST):
        kept[j] = j >= N_LINEAR or p[j] > 0.0
        if not kept[j]:
            continue
        for k in range(min(j + 1, N_LINEAR)):
            if not kept[k]:
                continue
            t = whole[j, k]
            for m in range(k):
                t -= factor[j, m] * factor[k, m]
            if j == k:
                kept[j] = t > _SINGULAR * whole[j, j]
                factor[j, j] = np.sqrt(t) if kept[j] else 1.0
            else:
                factor[j, k] = t / factor[k, k]
    for i in range(2):
        side[i] = whole[_LAST, N_LINEAR + i]
        for k in range(N_LINEAR):
            side[i] -= p[k] * whole[N_LINEAR + i, k]
        for j in range(2):
            matrix[i, j] = whole[N_LINEAR + max(i, j), N_LINEAR + min(i, j)]
            for k in range(N_LINEAR):
                if kept[k]:
                    matrix[i, j] -= factor[N_LINEAR + i, k] * factor[N_LINEAR + j, k]


@njit(cache=True, error_model="numpy")
def _step(
    matrix: FloatArray, side: FloatArray, low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    """Return the step of pole and delay within limits that minimises the quadratic form."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[1, 1]
    determinant = a * c - b * b
    first, second = 0.0, 0.0
    if a > 0.0 and c > 0.0 and determinant > _SINGULAR * a * c:
        first = (c * side[0] - b * side[1]) / determinant
        second = (a * side[1] - b * side[0]) / determinant
    elif a > 0.0:
        first = side[0] / a
    elif c > 0.0:
        second = side[1] / c
    if not low[0] <= first <= high[0]:
        first = min(max(first, low[0]), high[0])
        second = (side[1] - b * first) / c if c > 0.0 else 0.0
    if not low[1] <= second <= high[1]:
        second = min(max(second, low[1]), high[1])
        first = (side[0] - b * second) / a if a > 0.0 else 0.0
        first = min(max(first, low[0]), high[0])
    return first, second


@njit(cache=True, error_model="numpy")
def _pass(cycle: Cycle, data: Weighed, still: float, s: Searches) -> None:
    """Look at the eight places, keep what is better, and choose the next eight."""
    work = s.work
    for i in range(LANES):
        work[POLE + i] = s.pole[i]
        work[DELAY + i] = cycle.lag + s.part[i]
        for k in range(N_LINEAR):
            work[AT + LANES * k + i] = s.p[i, k]
    run_lanes(data, cycle.v_max, still, work)
    for i in range(LANES):
        if not s.done[i]:
            _advance(cycle, s, i, max(data.rows, 1), data.log_determinant)


@njit(cache=True, error_model="numpy")
def _advance(cycle: Cycle, s: Searches, i: int, rows: int, log_determinant: float) -> None:
    """Keep a place that is better with the step from it, else shorten the step."""
    whole = np.zeros((_LAST + 1, _LAST + 1))
    gram = np.zeros((N_COLUMNS, N_COLUMNS))
    at = 0
    for j in range(_LAST + 1):
        for k in range(j + 1):
            whole[j, k] = whole[k, j] = s.work[GRAM + LANES * at + i]
            at += 1
    for j in range(N_COLUMNS):
        for k in range(N_COLUMNS):
            gram[j, k] = whole[j + (j > N_LINEAR), k + (k > N_LINEAR)]
    p = np.zeros(N_LINEAR)
    cost = max(solve_positive(gram, cycle.columns, p), 1e-300)
    value = rows * np.log(cost / rows) + log_determinant
    variance = 0.0
    if cycle.usual > 0.0:
        value += (s.part[i] / cycle.usual) ** 2
        variance = cost / rows / cycle.usual**2
    if not value < s.best[i]:
        s.step_pole[i] *= 0.25
        s.step_part[i] *= 0.25
        s.gain[i] *= 0.25
    else:
        s.best[i], s.best_pole[i], s.best_part[i] = value, s.pole[i], s.part[i]
        s.p[i] = p
        matrix, side = np.zeros((2, 2)), np.zeros(2)
        _schur(whole, p, matrix, side)
        side[1] -= variance * s.part[i]
        matrix[1, 1] += variance
        low = 0.0, max(s.low[i] - s.part[i], -_LARGEST_PART)
        high = 0.0, min(s.high[i] - s.part[i], _LARGEST_PART)
        if cycle.searched:
            low = max(-s.pole[i], -_LARGEST_POLE), low[1]
            high = min(POLE_MAX - s.pole[i], _LARGEST_POLE), high[1]
        first, second = _step(matrix, side, low, high)
        s.step_pole[i], s.step_part[i] = first, second
        gain = first * (2.0 * side[0] - matrix[0, 0] * first - matrix[0, 1] * second)
        gain += second * (2.0 * side[1] - matrix[1, 0] * first - matrix[1, 1] * second)
        s.gain[i] = gain * rows / cost
    s.pole[i] = s.best_pole[i] + s.step_pole[i]
    s.part[i] = s.best_part[i] + s.step_part[i]
    s.part[i] = min(max(s.part[i], s.low[i]), s.high[i])
    s.done[i] = not s.gain[i] > _FOUND


@njit(cache=True)
def _shifted(pole: float, samples: float) -> float:
    """Return the pole whose mean time is so much longer [samples]."""
    mean = max(pole / (1.0 - pole) + samples, 0.0)
    return min(mean / (1.0 + mean), POLE_MAX)


@njit(cache=True)
def find_joint(cycle: Cycle, pole: float) -> tuple[float, float]:
    """Return the part of a sample beyond the lag, and the pole, of greatest likelihood.

    Parameters
    ----------
    cycle : Cycle
        What is searched in.
    pole : float
        Taken where none is searched [1].
    """
    s = _new_searches()
    data = weigh_rows(cycle.rows, cycle.wander, cycle.lag + 1.0)
    for i in range(LANES):
        s.pole[i] = (i + 0.5) / LANES if cycle.searched else pole
    _pass(cycle, data, _ROUGH, s)  # without parameters no sensitivity, and so no step
    k = int(np.argmin(s.best))
    pole, p = s.best_pole[k], s.p[k].copy()
    s.best[:] = np.inf
    s.done[:] = False
    for i in range(LANES if cycle.usual > 0.0 else 0):
        part = _STARTS[min(i, len(_STARTS) - 1)]
        whole = np.floor(part)
        s.low[i], s.high[i] = max(whole, -float(cycle.lag)), whole + 1.0
        if i == LANES - 1:
            part = s.low[i] = s.high[i] = 0.0
        s.part[i] = max(part, s.low[i])
        s.pole[i] = _shifted(pole, -s.part[i]) if cycle.searched else pole
        s.p[i] = p
    for _ in range(_PASSES):
        _pass(cycle, data, STILL, s)
        least = s.best.min()
        for i in range(LANES):
            s.done[i] |= s.best[i] - _HOPELESS * s.gain[i] > least
        if s.done.all():
            break
    k = int(np.argmin(s.best))
    if cycle.usual > 0.0 and 0.0 < abs(s.best_part[k]) < _WHOLE and s.best[-1] <= s.best[k]:
        k = LANES - 1
    if s.gain[k] <= _FOUND:
        return s.part[k], s.pole[k]
    return s.best_part[k], s.best_pole[k]
