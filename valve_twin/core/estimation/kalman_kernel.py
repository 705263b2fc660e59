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
from numba import njit

from valve_twin.core.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
    solve_positive,
)

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

_POLES = 13
_FEW = 4
_NEAR = 0.1  # half width of the pole search once the ratio is about known
_POLE_WIDTH = 1e-3
LOG_LOW = -14.0
"""Logarithm of the smallest noise ratio that is told from none."""

_LOG_HIGH, _LOG_STEP = 10.0, 2.0
_LOG_WIDTH = 0.02
_GOLDEN = 0.6180339887498949
_SINGULAR = 1e-12  # relative pivot below which columns count as dependent


@njit(cache=True)
def whiten(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: BoolArray,
    moving: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    pole: float,
    v_max: float,
    ratio: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, int]:
    """Write the normal equations of the innovations; return their log determinant, and rows.

    Parameters
    ----------
    y : (N,) array
        Measured position [1].
    use, free, anchor, moving : (N,) bool arrays
        Sample is measured; spool is off the seats; level is unknown anew; a command acts.
    v_in, v_out : (N,) arrays
        Commands that act at the sample, lag included [1].
    pole, v_max, ratio : float
        Pole [1], greatest command [1], variance of process over measurement noise [1].
    p : (5,) array
        Parameters at which the sensitivity to the pole is taken.
    gram : (7, 7) array
        Result.
    """
    gram[:, :] = 0.0
    # response of the free run and state of the filter, one column a parameter
    speed, level = np.zeros(N_COLUMNS), np.zeros(N_COLUMNS)
    place, drift, news = np.zeros(N_COLUMNS), np.zeros(N_COLUMNS), np.zeros(N_COLUMNS)
    drive = np.zeros(N_LINEAR)
    share = 1.0 - pole
    known = False
    p11 = p12 = p22 = 0.0
    log_determinant = 0.0
    rows = 0
    last = N_COLUMNS - 1
    for n in range(len(y)):
        if anchor[n]:
            known = False
            drift[:] = 0.0
            p12 = p22 = 0.0
        if free[n]:
            a, b = v_in[n], v_out[n]
            drive[0] = a
            drive[1] = a * (2.0 * v_max - a)
            drive[2] = -b
            drive[3] = -b * (2.0 * v_max - b)
            drive[4] = -1.0
            pull = 0.0
            for k in range(N_LINEAR):
                pull += p[k] * (speed[k] - drive[k])
            for k in range(N_LINEAR):
                speed[k] = pole * speed[k] + share * drive[k]
                level[k] += speed[k]
            speed[N_LINEAR] = pole * speed[N_LINEAR] + pull
            level[N_LINEAR] += speed[N_LINEAR]
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
        gain, turn = p11 / total, p12 / total
        for k in range(N_COLUMNS):
            news[k] = level[k] - place[k]
            place[k] += gain * news[k]
            drift[k] += turn * news[k]
        p22 -= turn * p12
        p12 -= gain * p12
        p11 = gain
        for i in range(N_COLUMNS):
            for j in range(i + 1):
                gram[i, j] += news[i] * news[j] / total
        log_determinant += np.log(total)
        rows += 1
    for i in range(N_COLUMNS):
        for j in range(i + 1, N_COLUMNS):
            gram[i, j] = gram[j, i]
    return log_determinant, rows


@njit(cache=True)
def _log_determinant(gram: FloatArray, used: BoolArray) -> float:
    """Return the log determinant of the used rows and columns; -inf where they are dependent."""
    size = len(used)
    factor = np.zeros((size, size))
    total = 0.0
    for i in range(size):
        if not used[i]:
            continue
        pivot = gram[i, i]
        for j in range(i):
            if not used[j]:
                continue
            t = gram[i, j]
            for k in range(j):
                t -= factor[i, k] * factor[j, k]
            factor[i, j] = t / factor[j, j]
            pivot -= factor[i, j] * factor[i, j]
        if pivot <= _SINGULAR * gram[i, i]:
            return -np.inf
        factor[i, i] = np.sqrt(pivot)
        total += np.log(pivot)
    return total


@njit(cache=True)
def _likelihood(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: BoolArray,
    moving: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    pole: float,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return minus twice the log likelihood, a constant left out, and write its minimiser `p`."""
    log_determinant, rows = whiten(
        y, use, free, anchor, moving, v_in, v_out, pole, v_max, ratio, p, gram
    )
    cost = float(solve_positive(gram, columns, p))
    return float(rows * np.log(max(cost, 1e-300) / max(rows, 1)) + log_determinant)


@njit(cache=True)
def _best_pole(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: BoolArray,
    moving: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    low: float,
    high: float,
    points: int,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return the pole of greatest likelihood in an interval: a grid, then golden section."""
    if high <= low:
        return low
    step = (high - low) / (points - 1)
    best, pole = np.inf, low
    for k in range(points):
        f = _likelihood(
            y,
            use,
            free,
            anchor,
            moving,
            v_in,
            v_out,
            low + k * step,
            v_max,
            ratio,
            columns,
            p,
            gram,
        )
        if f < best:
            best, pole = f, low + k * step
    left, right = max(pole - step, low), min(pole + step, high)
    a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
    f_a = _likelihood(y, use, free, anchor, moving, v_in, v_out, a, v_max, ratio, columns, p, gram)
    f_b = _likelihood(y, use, free, anchor, moving, v_in, v_out, b, v_max, ratio, columns, p, gram)
    while right - left > _POLE_WIDTH:
        if f_a < f_b:
            right, b, f_b = b, a, f_a
            a = right - _GOLDEN * (right - left)
            f_a = _likelihood(
                y, use, free, anchor, moving, v_in, v_out, a, v_max, ratio, columns, p, gram
            )
        else:
            left, a, f_a = a, b, f_b
            b = left + _GOLDEN * (right - left)
            f_b = _likelihood(
                y, use, free, anchor, moving, v_in, v_out, b, v_max, ratio, columns, p, gram
            )
    if min(f_a, f_b) >= best:
        return pole
    return a if f_a < f_b else b


@njit(cache=True)
def restricted(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: BoolArray,
    moving: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    v_max: float,
    ratio: float,
    columns: BoolArray,
    prior: FloatArray,
    low: float,
    high: float,
    points: int,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, int]:
    """Return minus twice the log restricted likelihood of a ratio, its pole, cost and rows.

    The pole is that of greatest likelihood between `low` and `high`. `prior` (2,) is what other
    cycles say of the logarithm of the ratio: mean, and inverse variance, 0 = nothing. `p` (5,)
    and `gram` (7, 7), with the sensitivity to the pole, are written there.
    """
    pole = _best_pole(
        y,
        use,
        free,
        anchor,
        moving,
        v_in,
        v_out,
        v_max,
        ratio,
        columns,
        low,
        high,
        points,
        p,
        gram,
    )
    _likelihood(y, use, free, anchor, moving, v_in, v_out, pole, v_max, ratio, columns, p, gram)
    log_determinant, rows = whiten(
        y, use, free, anchor, moving, v_in, v_out, pole, v_max, ratio, p, gram
    )
    cost = float(solve_positive(gram, columns, p))
    used = np.zeros(N_LINEAR + 1, dtype=np.bool_)
    count = 0
    for k in range(N_LINEAR):
        used[k] = p[k] > 0.0
        count += used[k]
    used[N_LINEAR] = high > low and gram[N_LINEAR, N_LINEAR] > 0.0
    count += used[N_LINEAR]
    degrees = max(rows - count, 1)
    value = degrees * np.log(max(cost, 1e-300) / degrees) + log_determinant
    if prior[1] > 0.0:
        value += prior[1] * (np.log(ratio) - prior[0]) ** 2
    return value + _log_determinant(gram, used), pole, cost, rows


@njit(cache=True)
def search_ratio(
    y: FloatArray,
    use: BoolArray,
    free: BoolArray,
    anchor: BoolArray,
    moving: BoolArray,
    v_in: FloatArray,
    v_out: FloatArray,
    v_max: float,
    columns: BoolArray,
    prior: FloatArray,
    fixed_pole: float,
    fixed_ratio: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, int]:
    """Find noise ratio, pole and parameters; return ratio, pole, cost, rows.

    The ratio maximises the restricted likelihood, which counts the parameters that were fitted:
    plain maximum likelihood took 35 % too little process noise at sigma 1e-3 and half of it at
    3e-3, and its intervals covered 75-88 %. For each ratio the pole is that of greatest plain
    likelihood: the restricted one would prefer poles of which the data say little.

    Parameters
    ----------
    y, use, free, anchor, moving, v_in, v_out, v_max
        As in `whiten`.
    columns : (5,) bool array
        Parameters that are fitted.
    prior : (2,) array
        Mean and inverse variance of the logarithm of the ratio from other cycles; 0 = nothing.
    fixed_pole, fixed_ratio : float
        Taken as they are where not negative.
    p, gram : (5,), (7, 7) arrays
        Results, with the sensitivity to the pole.
    """
    low, high = (0.0, POLE_MAX) if fixed_pole < 0.0 else (fixed_pole, fixed_pole)
    pole = low
    center = np.log(fixed_ratio) if fixed_ratio > 0.0 else LOG_LOW
    if fixed_ratio < 0.0:
        best, count = np.inf, round((_LOG_HIGH - LOG_LOW) / _LOG_STEP)
        for k in range(count + 1):
            at = LOG_LOW + k * _LOG_STEP
            f, z, _, _ = restricted(
                y,
                use,
                free,
                anchor,
                moving,
                v_in,
                v_out,
                v_max,
                np.exp(at),
                columns,
                prior,
                low,
                high,
                _POLES,
                p,
                gram,
            )
            if f < best:
                best, center, pole = f, at, z
        left, right = center - _LOG_STEP, center + _LOG_STEP
        near, far = max(pole - _NEAR, low), min(pole + _NEAR, high)
        while right - left > _LOG_WIDTH:
            a, b = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
            f_a, _, _, _ = restricted(
                y,
                use,
                free,
                anchor,
                moving,
                v_in,
                v_out,
                v_max,
                np.exp(a),
                columns,
                prior,
                near,
                far,
                _FEW,
                p,
                gram,
            )
            f_b, _, _, _ = restricted(
                y,
                use,
                free,
                anchor,
                moving,
                v_in,
                v_out,
                v_max,
                np.exp(b),
                columns,
                prior,
                near,
                far,
                _FEW,
                p,
                gram,
            )
            if f_a < f_b:
                right = b
            else:
                left = a
        center = 0.5 * (left + right)
    ratio = 0.0 if fixed_ratio == 0.0 or center <= LOG_LOW else np.exp(center)
    _, pole, cost, rows = restricted(
        y,
        use,
        free,
        anchor,
        moving,
        v_in,
        v_out,
        v_max,
        ratio,
        columns,
        prior,
        low,
        high,
        _POLES,
        p,
        gram,
    )
    return ratio, pole, cost, rows
