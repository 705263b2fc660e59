# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled Kalman whitening of a valve that is filled and emptied.

The spool obeys, with g(v) = 2 v_max - v and all p >= 0 (see `output_error_kernel`),

    speed[n] = z speed[n-1] + (1 - z) drive[n] + w[n],    x[n] = x[n-1] + speed[n]

off the seats, with process noise w of variance q R in motion only, and is measured with noise of
variance R. For fixed pole z and ratio q a Kalman filter turns the measurement and the response to
each parameter into innovations alike; least squares of those is maximum likelihood (equations.md
2.6). q = 0 is the output error, q = infinity the equation error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
    Stretch,
    advance,
    solve_positive,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.line_search import (
    BEST,
    BEST_VALUE,
    line_next,
    line_start,
    line_update,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import restricted_value
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

_POLES = 13
_NEAR = 0.1  # half width of the pole search around the pole of a neighbouring ratio
_EXTENSIONS = 10
_POLE_WIDTH = 1e-3
LOG_LOW = -14.0
"""Logarithm of the smallest noise ratio that is distinguished from none."""

_LOG_HIGH, _LOG_STEP = 10.0, 2.0
_LOG_WIDTH = 0.02


@njit(cache=True, inline="always")
def absorb(
    level: FloatArray,
    place: FloatArray,
    drift: FloatArray,
    innovation: FloatArray,
    covariance: tuple[float, float, float],
    gram: FloatArray,
    count: int,
) -> tuple[float, float, float]:
    """Take one sample into filter and normal equations; return the covariance after it.

    Parameters
    ----------
    level : (C,) array
        Responses and measurement [1].
    place, drift : (C,) arrays
        State of the filter of each, written in place [1].
    innovation : (C,) array
        Innovations, overwritten [1].
    covariance : tuple of float
        Of place and drift: variance, covariance, variance [1].
    gram : (C, C) array
        Lower triangle, added to [1].
    count : int
        C [1].
    """
    p11, p12, p22 = covariance
    total = 1.0 + p11
    gain, turn = p11 / total, p12 / total
    for k in range(count):
        innovation[k] = level[k] - place[k]
        place[k] += gain * innovation[k]
        drift[k] += turn * innovation[k]
    for i in range(count):
        for j in range(i + 1):
            gram[i, j] += innovation[i] * innovation[j] / total
    return gain, p12 - gain * p12, p22 - turn * p12


@njit(cache=True)
def whiten(
    data: Stretch,
    pole: float,
    v_max: float,
    ratio: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, int]:
    """Write the normal equations of the innovations; return their log determinant, and rows.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    pole, v_max, ratio : float
        Pole [1], greatest command [1], variance of process over measurement noise [1].
    p : (5,) array
        Parameters at which the sensitivity to the pole is taken [1].
    gram : (7, 7) array
        Result [1].
    """
    y, use, free, anchor, moving, v_in, v_out = data
    gram[:, :] = 0.0
    # response of the free run and state of the filter, one column a parameter
    speed, level = np.zeros(N_COLUMNS), np.zeros(N_COLUMNS)
    place, drift, innovation = np.zeros(N_COLUMNS), np.zeros(N_COLUMNS), np.zeros(N_COLUMNS)
    drive = np.zeros(N_LINEAR)
    known = False
    p11 = p12 = p22 = 0.0
    log_determinant = 0.0
    rows = 0
    last = N_COLUMNS - 1
    for n in range(len(y)):
        if 0.0 < anchor[n] < np.inf:
            p11 += anchor[n]
        elif anchor[n] > 0.0:
            known = False
            drift[:] = 0.0
            p12 = p22 = 0.0
        if free[n]:
            advance((v_in[n], v_out[n]), v_max, pole, p, drive, speed, level)
            for k in range(N_COLUMNS):
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
        total = 1.0 + p11
        p11, p12, p22 = absorb(level, place, drift, innovation, (p11, p12, p22), gram, N_COLUMNS)
        log_determinant += np.log(total)
        rows += 1
    for i in range(N_COLUMNS):
        for j in range(i + 1, N_COLUMNS):
            gram[i, j] = gram[j, i]
    return log_determinant, rows


@njit(cache=True)
def _likelihood(
    data: Stretch,
    pole: float,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return minus twice the log likelihood, a constant left out, and write its minimiser `p`."""
    log_determinant, rows = whiten(data, pole, v_max, ratio, p, gram)
    cost = float(solve_positive(gram, columns, p))
    return float(rows * np.log(max(cost, 1e-300) / max(rows, 1)) + log_determinant)


@njit(cache=True)
def _pole_between(
    data: Stretch,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    low: float,
    high: float,
    start: float,
    value: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float]:
    """Return the pole of least `_likelihood` in [low, high], and that; `value` is that of start.

    Searched is the neighbourhood of `start`, and on in the direction in which it falls.
    """
    pole, best = start, value
    for _ in range(_EXTENSIONS):
        left, right = max(pole - _NEAR, low), min(pole + _NEAR, high)
        state = line_start(left, right, pole, best)
        at = line_next(state, _POLE_WIDTH)
        while not np.isnan(at):
            line_update(state, at, _likelihood(data, at, v_max, ratio, columns, p, gram))
            at = line_next(state, _POLE_WIDTH)
        pole, best = state[BEST], state[BEST_VALUE]
        inner = (left <= low or pole > left + 3.0 * _POLE_WIDTH) and (
            right >= high or pole < right - 3.0 * _POLE_WIDTH
        )
        if inner:
            break
    for end in (low, high):
        if pole != end and abs(pole - end) <= 3.0 * _POLE_WIDTH:
            f = _likelihood(data, end, v_max, ratio, columns, p, gram)
            if f <= best:
                pole, best = end, f
    return pole, best


@njit(cache=True)
def _best_pole(
    data: Stretch,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    low: float,
    high: float,
    start: float,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return the pole of greatest likelihood: near `start`; where that is negative, of all."""
    if high <= low:
        return low
    best, pole = np.inf, start
    if start >= 0.0:
        best = _likelihood(data, start, v_max, ratio, columns, p, gram)
    else:
        for k in range(_POLES):
            at = low + k * (high - low) / (_POLES - 1)
            f = _likelihood(data, at, v_max, ratio, columns, p, gram)
            if f < best:
                best, pole = f, at
    return _pole_between(data, v_max, ratio, columns, low, high, max(pole, low), best, p, gram)[0]


@njit(cache=True)
def restricted(
    data: Stretch,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    prior: FloatArray,
    low: float,
    high: float,
    start: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, int]:
    """Return minus twice the log restricted likelihood of a ratio, its pole, cost and rows.

    The pole is that of greatest likelihood between `low` and `high`, searched near `start`, on
    the whole interval where that is negative.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max, ratio : float
        Greatest command [1], variance of process over measurement noise [1].
    columns : (5,) bool array
        Parameters that are fitted.
    prior : (2,) array
        Mean and inverse variance of the logarithm of the ratio from other cycles; 0 = nothing [1].
    low, high, start : float
        Interval of the pole, and where its search starts [1].
    p, gram : (5,), (7, 7) arrays
        Overwritten with parameters and normal equations, with the sensitivity to the pole [1].
    """
    pole = _best_pole(data, v_max, ratio, columns, low, high, start, p, gram)
    _likelihood(data, pole, v_max, ratio, columns, p, gram)
    log_determinant, rows = whiten(data, pole, v_max, ratio, p, gram)
    cost = float(solve_positive(gram, columns, p))
    value = restricted_value(gram, p, rows, log_determinant, cost, high > low)
    if prior[1] > 0.0:
        value += prior[1] * (np.log(ratio) - prior[0]) ** 2
    return value, pole, cost, rows


@njit(cache=True)
def _ratio_between(
    data: Stretch,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    poles: tuple[float, float],
    bracket: tuple[float, float, float],
    start: float,
    value: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float]:
    """Return the logarithm of the best ratio of a bracket (low, place, high), and its pole."""
    low, high = poles
    state = line_start(bracket[0], bracket[2], bracket[1], value)
    pole = start
    at = line_next(state, _LOG_WIDTH)
    while not np.isnan(at):
        f, z, _, _ = restricted(data, v_max, np.exp(at), columns, prior, low, high, pole, p, gram)
        if f <= state[BEST_VALUE]:
            pole = z
        line_update(state, at, f)
        at = line_next(state, _LOG_WIDTH)
    return state[BEST], pole


@njit(cache=True)
def search_ratio(
    data: Stretch,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    fixed_pole: float,
    fixed_ratio: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, float, int, float]:
    """Find noise ratio, pole and parameters.

    The ratio maximises the restricted likelihood, which counts the parameters that were fitted:
    plain maximum likelihood took 35 % too little process noise at sigma 1e-3 and half of it at
    3e-3, and its intervals covered 75-88 %. For each ratio the pole is that of greatest plain
    likelihood: the restricted one would prefer poles of which the data say little.

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
        The ratio found from this cycle alone, the ratio with the prior, then pole, cost, rows and
        minus twice the log restricted likelihood, without the prior.
    """
    low, high = (0.0, POLE_MAX) if fixed_pole < 0.0 else (fixed_pole, fixed_pole)
    nothing = np.zeros(2)
    alone = center = np.log(fixed_ratio) if fixed_ratio > 0.0 else LOG_LOW
    if fixed_ratio < 0.0:
        best, pole, start = np.inf, -1.0, -1.0
        for k in range(round((_LOG_HIGH - LOG_LOW) / _LOG_STEP) + 1):
            at = LOG_LOW + k * _LOG_STEP
            f, start, _, _ = restricted(
                data, v_max, np.exp(at), columns, nothing, low, high, start, p, gram
            )
            if f < best:
                best, alone, pole = f, at, start
        alone, pole = _ratio_between(
            data,
            v_max,
            columns,
            nothing,
            (low, high),
            (alone - _LOG_STEP, alone, alone + _LOG_STEP),
            pole,
            best,
            p,
            gram,
        )
        center = alone
        if prior[1] > 0.0:
            # the best of a sum of two such curves lies between the best of each
            value, pole, _, _ = restricted(
                data, v_max, np.exp(prior[0]), columns, prior, low, high, pole, p, gram
            )
            ends = (min(alone, prior[0]) - _LOG_WIDTH, max(alone, prior[0]) + _LOG_WIDTH)
            center, _ = _ratio_between(
                data,
                v_max,
                columns,
                prior,
                (low, high),
                (ends[0], prior[0], ends[1]),
                pole,
                value,
                p,
                gram,
            )
    ratio = 0.0 if fixed_ratio == 0.0 or center <= LOG_LOW else np.exp(center)
    value, pole, cost, rows = restricted(
        data, v_max, ratio, columns, nothing, low, high, -1.0, p, gram
    )
    return 0.0 if alone <= LOG_LOW else np.exp(alone), ratio, pole, cost, rows, value
