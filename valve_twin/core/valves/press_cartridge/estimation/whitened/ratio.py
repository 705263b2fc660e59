# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled search of noise ratio and pole, eight ratios at once.

Each round looks at eight ratios, whose poles follow Newton steps of the likelihood side by side
from what neighbours found; the next eight lie closer about the best. What is not smooth enough for
that (data without noise, a column that drops out at the optimum, a pole that does not settle) is
left to `kalman_kernel.search_ratio`, which is slow and needs values only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.kalman_kernel import (
    LOG_LOW,
    restricted,
    search_ratio,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_LINEAR,
    POLE_MAX,
    Stretch,
    pack_rows,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import LANES
from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import truncated_moments
from valve_twin.core.valves.press_cartridge.estimation.whitened.rounds import (
    Known,
    Lanes,
    Problem,
    begin,
    look,
    new_known,
    new_lanes,
    remember,
    settle,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_FIRST_POLES = (0.1, 0.3, 0.5, 0.7, 0.9)
_FIRST_STEP = 24.0 / 7.0  # from exp(-14) to exp(10)
_EXACT = 1e-13  # share of the variance that is left below which data have no noise [1]
_ROUNDS = 16
_FOUND, _FOUND_ON_WAY = 1e-7, 1e-5  # of a pole [1]
_CLOSE = 0.08  # of the logarithm of the ratio: a parabola will do
_CLOSEST = 0.01  # of the same, where a column drops out between
_LEAP = 10.0  # twice the log likelihood within which a leap may hide the best
_CLOSER = 7.5  # how much closer the next ratios lie
_WIDEST = 1.2  # distance beyond the end of those before, logarithmic
_LEAST_ROWS = 20


@njit(cache=True)
def _first(problem: Problem, lanes: Lanes, known: Known) -> bool:
    """Look at eight ratios over the whole range, at poles over the whole interval."""
    for i in range(LANES):
        lanes.log_ratio[i] = LOG_LOW + i * _FIRST_STEP
    searched = problem.high > problem.low
    best, pole = np.full(LANES, np.inf), np.full(LANES, problem.low)
    parameters = np.zeros((LANES, N_LINEAR))
    for z in _FIRST_POLES:
        lanes.pole[:] = z if searched else problem.low
        rows = look(problem, lanes)
        for i in range(LANES):
            if lanes.cost[i] <= _EXACT * lanes.gram[i, -1, -1] or rows < _LEAST_ROWS:
                return False
            if lanes.likelihood[i] < best[i]:
                best[i], pole[i] = lanes.likelihood[i], lanes.pole[i]
                parameters[i] = lanes.p[i]
        if not searched:
            break
    lanes.pole[:] = pole
    lanes.p[:] = parameters
    rows = settle(problem, lanes, 0.02)
    remember(known, lanes)
    return rows >= _LEAST_ROWS and lanes.cost.min() > _EXACT * lanes.gram[0, -1, -1]


@njit(cache=True)
def _with_prior(lanes: Lanes, prior: FloatArray, i: int) -> float:
    return float(lanes.value[i] + prior[1] * (lanes.log_ratio[i] - prior[0]) ** 2)


@njit(cache=True)
def _narrow(
    problem: Problem,
    lanes: Lanes,
    known: Known,
    prior: FloatArray,
    step: float,
    limits: tuple[float, float],
) -> float:
    """Return the logarithm of the best ratio, from eight ratios with their values; NaN = none.

    `step` is how far apart they are.
    """
    f = np.zeros(LANES)
    for _ in range(_ROUNDS):
        for i in range(LANES):
            f[i] = _with_prior(lanes, prior, i)
        k = int(np.argmin(f))
        at = lanes.log_ratio[k]
        center, inner = at, 0 < k < LANES - 1
        smooth = inner and lanes.kept[k - 1] == lanes.kept[k] == lanes.kept[k + 1]
        if smooth and _leaps(lanes, f, k):
            return np.nan
        if smooth:
            bend = f[k - 1] - 2.0 * f[k] + f[k + 1]
            if bend > 0.0:
                center += 0.5 * step * (f[k - 1] - f[k + 1]) / bend
        if inner and step <= (_CLOSE if smooth else _CLOSEST):
            return float(min(center, limits[1]))
        if inner:
            step /= _CLOSER if smooth else 0.5 * LANES
        elif limits[0] < at < limits[1]:
            step = min(1.5 * step, _WIDEST)
        else:
            return float(min(at, limits[1]))
        for i in range(LANES):
            lanes.log_ratio[i] = center + (i - 3.5) * step
        begin(known, lanes)
        if settle(problem, lanes, _FOUND_ON_WAY) < 0:
            return np.nan
        remember(known, lanes)
    return np.nan


@njit(cache=True)
def _leaps(lanes: Lanes, f: FloatArray, k: int) -> bool:
    """Tell whether the best may lie where a column drops out, away from the best lane.

    The restricted likelihood leaps there.
    """
    for i in range(LANES - 1):
        if lanes.kept[i] != lanes.kept[i + 1] and min(f[i], f[i + 1]) < f[k] + _LEAP:
            return True
    return False


@njit(cache=True)
def _away(problem: Problem, lanes: Lanes, known: Known, center: float) -> bool:
    """Tell whether a pole far from the one at hand is likelier, or data have no noise."""
    lanes.log_ratio[:] = center
    begin(known, lanes)
    if not problem.high > problem.low:
        return False
    for i in range(1, LANES):
        lanes.pole[i] = problem.low + (i - 1) * (problem.high - problem.low) / (LANES - 2)
    rows = look(problem, lanes)
    away = rows < _LEAST_ROWS or not lanes.cost[0] > _EXACT * lanes.gram[0, -1, -1]
    for i in range(1, LANES):
        away |= lanes.likelihood[i] < lanes.likelihood[0]
    begin(known, lanes)
    return away


@njit(cache=True)
def find_ratio(
    data: Stretch,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    fixed_pole: float,
    fixed_ratio: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, float, int, float]:
    """Find noise ratio, pole and parameters, where it can be in lanes.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max : float
        Greatest command [1].
    columns : (5,) bool array
        Parameters that are fitted.
    prior : (2,) array
        Mean and inverse variance of the logarithm of the ratio from other cycles; 0 = nothing [1].
    fixed_pole, fixed_ratio : float
        Taken as they are where not negative [1].
    p, gram : (5,), (7, 7) arrays
        Results, with the sensitivity to the pole [1].

    Returns
    -------
    tuple
        As `kalman_kernel.search_ratio`, but the restricted likelihood is that with the prior.
    """
    if fixed_ratio < 0.0:
        found = find_in_lanes(data, v_max, columns, prior, fixed_pole, p, gram)
        if found[4] >= 0:
            return found
    alone, ratio, pole, cost, rows, value = search_ratio(
        data, v_max, columns, prior, fixed_pole, fixed_ratio, p, gram
    )
    value += prior[1] * (np.log(max(ratio, np.exp(LOG_LOW))) - prior[0]) ** 2
    return alone, ratio, pole, cost, rows, value


@njit(cache=True)
def find_in_lanes(
    data: Stretch,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    fixed_pole: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, float, int, float]:
    """Find noise ratio, pole and parameters in lanes.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max : float
        Greatest command [1].
    columns : (5,) bool array
        Parameters that are fitted.
    prior : (2,) array
        Mean and inverse variance of the logarithm of the ratio from other cycles; 0 = nothing [1].
    fixed_pole : float
        Taken as it is where not negative [1].
    p, gram : (5,), (7, 7) arrays
        Results, with the sensitivity to the pole [1].

    Returns
    -------
    tuple
        As `find_ratio`; the rows are negative where the slow search has to decide.
    """
    low, high = (0.0, POLE_MAX) if fixed_pole < 0.0 else (fixed_pole, fixed_pole)
    problem = Problem(pack_rows(data), v_max, columns, low, high)
    lanes, known = new_lanes(), new_known()
    failed = (np.nan, np.nan, np.nan, np.nan, -1, np.nan)
    if not _first(problem, lanes, known):
        return failed
    limits = (LOG_LOW - 1.0, LOG_LOW + (LANES - 1) * _FIRST_STEP + 2.0)
    alone = _narrow(problem, lanes, known, np.zeros(2), _FIRST_STEP, limits)
    if np.isnan(alone):
        return failed
    center = alone
    if prior[1] > 0.0:
        # the best of a sum of two such curves lies between the best of each
        first = min(alone, prior[0]) - _CLOSE
        step = (max(alone, prior[0]) + _CLOSE - first) / (LANES - 1)
        for i in range(LANES):
            lanes.log_ratio[i] = first + i * step
        begin(known, lanes)
        if settle(problem, lanes, _FOUND_ON_WAY) < 0:
            return failed
        remember(known, lanes)
        center = _narrow(problem, lanes, known, prior, step, (-np.inf, np.inf))
        if np.isnan(center):
            return failed
    center = -np.inf if center <= LOG_LOW else center
    if _away(problem, lanes, known, center):
        return failed
    rows = settle(problem, lanes, _FOUND)
    if rows < 0:
        return failed
    p[:] = lanes.p[0]
    gram[:, :] = lanes.gram[0]
    found = 0.0 if alone <= LOG_LOW else np.exp(alone)
    value = lanes.value[0] + prior[1] * (max(center, LOG_LOW) - prior[0]) ** 2
    return found, np.exp(center), lanes.pole[0], lanes.cost[0], rows, value


@njit(cache=True)
def look_around(
    data: Stretch,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    log_ratio: FloatArray,
    limits: tuple[float, float],
    pole: float,
    p: FloatArray,
) -> tuple[Lanes, int]:
    """Return what eight ratios show, each with its pole, and the rows; values hold the prior.

    Parameters
    ----------
    data : Stretch
        The cycle.
    v_max : float
        Greatest command [1].
    columns : (5,) bool array
        Parameters that are fitted.
    prior : (2,) array
        See `kalman_kernel.search_ratio` [1].
    log_ratio : (8,) array
        Logarithms of the ratios [1].
    limits : (float, float)
        Of the pole; equal = it is given [1].
    pole : float
        Where the search of the poles begins [1].
    p : (5,) array
        Parameters there [1].
    """
    lanes = new_lanes()
    problem = Problem(pack_rows(data), v_max, columns, limits[0], limits[1])
    lanes.log_ratio[:] = log_ratio
    lanes.pole[:] = pole
    lanes.p[:] = p
    rows = settle(problem, lanes, _FOUND_ON_WAY)
    for i in range(LANES):
        if rows >= _LEAST_ROWS:
            lanes.value[i] = _with_prior(lanes, prior, i)
            continue
        lanes.value[i], lanes.pole[i], lanes.cost[i], count = restricted(
            data,
            v_max,
            np.exp(log_ratio[i]),
            columns,
            prior,
            limits[0],
            limits[1],
            pole,
            lanes.p[i],
            lanes.gram[i],
        )
        rows = -1 - count
    return lanes, rows if rows >= 0 else -1 - rows


@njit(cache=True)
def moments_around(
    around: tuple[Lanes, int], fitted: IntArray, pole: float, p: FloatArray, searched: bool
) -> tuple[FloatArray, FloatArray, bool]:
    """Return variances (8,) and second moments (8, 6, 6) about a solution; whether regular.

    Parameters
    ----------
    around : (Lanes, int)
        What `look_around` found.
    fitted : (F,) int64 array
        Columns that were fitted, the pole as column 5.
    pole : float
        Of the solution [1].
    p : (5,) array
        Its parameters [1].
    searched : bool
        Whether the pole was fitted.
    """
    lanes, rows = around
    variance, moments = np.empty(LANES), np.empty((LANES, N_LINEAR + 1, N_LINEAR + 1))
    regular = True
    for i in range(LANES):
        count = np.count_nonzero(lanes.p[i]) + searched
        variance[i] = lanes.cost[i] / max(rows - count, 1)
        regular &= truncated_moments(lanes.gram[i], fitted, variance[i], moments[i])
        off = np.append(lanes.p[i] - p, lanes.pole[i] - pole)
        moments[i] += np.outer(off, off)
    return variance, moments, regular
