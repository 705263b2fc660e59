# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Command to position lag, found by scanning the fit over the lags.

A sensor with fresh samples is scanned by the one-step error of the paper's four-term QP
(equations.md 2.4). Under a sensor that repeats its values that error follows the phase of the
refresh, not the valve: there the increments between fresh samples are fitted by the commands
summed over them, which no repeat enters (equations.md 2.6(4)).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.constraints import (
    Inequalities,
    parse_inequalities,
    physical_inequalities,
)
from valve_twin.core.valves.press_cartridge.estimation.qp import (
    VERIFIED,
    quadratic_cost,
    solve_qp,
)
from valve_twin.core.valves.press_cartridge.estimation.regression import (
    TERMS,
    Gram,
    gram,
    gram_kernel,
    mean_square_error,
    residual_kernel,
    usable_rows,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.small_qp import SOLVED, solve_small
from valve_twin.core.valves.press_cartridge.estimators import TERM_SETS
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import FloatArray, Frames, IntArray

MAX_LAG = 4
"""Default end of the scan [samples]; the lag is the sensor delay + 1 (equations.md 2.4)."""

MIN_ROWS = 12
"""Fewest rows on which lags are compared: three a parameter [1]."""

_POLES = (0.0, 0.1, 0.2, 0.3, 0.4)  # tried with increments: a slow pole must not pass for lag [1]

_FOUR = tuple(term - 1 for term in TERM_SETS["4"])

_GAINS = ("k_in", "k_out", "k_out_slope")


@dataclass(frozen=True, slots=True)
class LagScan:
    """Outcome of a lag scan.

    Attributes
    ----------
    lag : int
        The lag with the least mean squared error [samples]; -1 where the cycle does not show it.
    mse : (L,) array
        Mean squared error at lags 0, 1, ... on the same rows [1]; NaN where not computed.
    sharpness : float
        Least relative rise of the error at any other lag [1]; NaN where there is no lag. A few
        per mille and less are chance.
    reason : str
        Why there is no lag; empty where there is one.
    by_increments : bool
        The error is that of increments between fresh samples, not the one-step error of QP4.
    """

    lag: int
    mse: FloatArray
    sharpness: float
    reason: str = ""
    by_increments: bool = False


def scan_lag(frames: Frames, masks: Masks, *, max_lag: int = MAX_LAG) -> LagScan:
    """Find the lag between command and position.

    Every lag is fitted on the same rows, so that the errors compare. The smallest of equal lags
    wins.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    max_lag : int
        Longest lag tried [samples].
    """
    slow_sensor = masks.refresh_period > 1.0
    if slow_sensor:
        rows, before = _fresh_pairs(frames, masks, max_lag)
    else:
        rows = before = usable_rows(frames, masks, max_lag)
    if len(rows) < MIN_ROWS:
        return _unknown(max_lag, f"{len(rows)} usable rows, {MIN_ROWS} needed", slow_sensor)
    commands = frames.inputs[int(before[0]) - max_lag : int(rows[-1]) + 1]
    if not (commands != commands[0]).any():
        return _unknown(max_lag, "the commands do not change", slow_sensor)
    if slow_sensor:
        mse = _increment_errors(frames, before, rows, max_lag)
    else:
        mse = _one_step_errors(frames, rows, max_lag)
    if not np.isfinite(mse).all() or mse.max() <= 0.0:
        return _unknown(max_lag, "no lag could be fitted", slow_sensor)
    best = int(np.argmin(mse))
    other = min((error for lag, error in enumerate(mse.tolist()) if lag != best), default=np.inf)
    sharpness = float(other / mse[best] - 1.0) if mse[best] > 0.0 else float("inf")
    return LagScan(best, mse, sharpness, by_increments=slow_sensor)


def _unknown(max_lag: int, reason: str, slow_sensor: bool) -> LagScan:
    return LagScan(-1, np.full(max_lag + 1, np.nan), float("nan"), reason, slow_sensor)


def _one_step_errors(frames: Frames, rows: IntArray, max_lag: int) -> FloatArray:
    """Mean squared one-step error of QP4 at each lag, within paper 002, eq. (23)."""
    mse = np.full(max_lag + 1, np.nan)
    columns, limits = list(_FOUR), _limits_of_four()
    x, inputs = np.ascontiguousarray(frames.position), np.ascontiguousarray(frames.inputs)
    done = _solve_lags(x, inputs, rows, limits.matrix, limits.bound, mse)
    for lag in range(done, max_lag + 1):  # what the compiled solver cannot verify
        solution = solve_qp(gram(frames, rows, lag).part(TERM_SETS["4"]), limits)
        if solution.solved:
            theta = np.zeros(TERMS)
            theta[columns] = solution.theta
            mse[lag] = mean_square_error(frames, rows, lag, theta)
    return mse


@cache
def _limits_of_four() -> Inequalities:
    """Return paper 002, eq. (23), over the terms of QP4."""
    return physical_inequalities(extended=False).part(_FOUR)


@njit(cache=True, error_model="numpy")
def _solve_lags(
    x: FloatArray,
    inputs: FloatArray,
    rows: IntArray,
    limits: FloatArray,
    bound: FloatArray,
    mse: FloatArray,
) -> int:
    """Fill the mean squared error of QP4, (L,), up to a lag that cannot be verified; return it."""
    theta, active = np.empty(4), np.empty(len(bound), dtype=np.bool_)
    terms = np.zeros(TERMS)
    four, its = np.empty((4, 4)), np.empty(4)
    for lag in range(len(mse)):
        matrix, vector = np.zeros((TERMS, TERMS)), np.zeros(TERMS)
        power = gram_kernel(x, inputs, rows, lag, matrix, vector)
        for i in range(4):
            its[i] = vector[_FOUR[i]]
            for j in range(4):
                four[i, j] = matrix[_FOUR[i], _FOUR[j]]
        found, _, kkt = solve_small(four, its, power, limits, bound, theta, active)
        if found != SOLVED or not kkt <= VERIFIED:
            return lag
        for i in range(4):
            terms[_FOUR[i]] = theta[i]
        mse[lag] = residual_kernel(x, inputs, rows, lag, terms) / len(rows)
    return len(mse)


def _fresh_pairs(frames: Frames, masks: Masks, max_lag: int) -> tuple[IntArray, IntArray]:
    """Later and earlier sample of each increment between fresh samples in one unmasked piece."""
    fresh = np.flatnonzero(~(masks.stale | masks.bad))
    fresh = fresh[fresh >= max_lag]
    before, after = fresh[:-1], fresh[1:]
    lost = np.cumsum(masks.seat | masks.stuck | masks.bad)
    broken = np.cumsum(masks.gap)
    whole = (lost[after] == lost[before]) & ~(masks.seat | masks.stuck)[before]
    whole &= broken[after] == broken[before - max_lag]
    return after[whole], before[whole]


def _increment_errors(
    frames: Frames, before: IntArray, after: IntArray, max_lag: int
) -> FloatArray:
    """Mean squared error of the fitted increments at each lag, each with its best pole."""
    increment = frames.position[after] - frames.position[before]
    power = float(increment @ increment)
    inputs = np.where(np.isfinite(frames.inputs), frames.inputs, 0.0)
    drive = np.column_stack([inputs[:, 0], inputs[:, 1], inputs[:, 1] ** 2])
    limits = parse_inequalities(["k_in >= 0", "k_out <= 0", "k_out_slope >= 0"], _GAINS)
    mse = np.full(max_lag + 1, np.inf)
    for pole in _POLES:
        total = np.zeros((len(drive) + 1, len(_GAINS)))
        _filter_and_sum(drive, pole, total)
        for lag in range(max_lag + 1):
            u = total[after - lag + 1] - total[before - lag + 1]
            problem = Gram(u.T @ u, u.T @ increment, power, len(after))
            solution = solve_qp(problem, limits)
            if solution.solved:
                error = quadratic_cost(problem, solution.theta) / len(after)
                mse[lag] = min(mse[lag], error)
    return mse


@njit(cache=True)
def _filter_and_sum(drive: FloatArray, pole: float, total: FloatArray) -> None:
    """Pass each column through (1 - pole)/(1 - pole/z) and sum it up: total[n + 1] - total[n]."""
    for k in range(drive.shape[1]):
        state = 0.0
        for n in range(drive.shape[0]):
            state = pole * state + (1.0 - pole) * drive[n, k]
            total[n + 1, k] = total[n, k] + state
