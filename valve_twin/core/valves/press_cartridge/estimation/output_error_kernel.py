# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled output error of a valve that is filled and emptied: equations, solver, pole search.

For a fixed pole z the free run is linear in the rest. With g(v) = 2 v_max - v,

    drive = p_0 v_in + p_1 g(v_in) v_in - p_2 v_out - p_3 g(v_out) v_out - p_4
    speed[n] = z speed[n-1] + (1 - z) drive[n],    x[n] = x[n-1] + speed[n]

holds off the seats, all p >= 0; on a seat nothing moves. K(v) = p_0 + p_1 g(v) then falls with the
command while K(v) v still rises up to v_max: the physical constraints of equations.md 2.2(7) are
the signs of p, and the bounded problem is solved exactly by trying every set of positive
parameters.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.solvers.small_dense import eliminate
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, ByteArray, FloatArray, IntArray

N_LINEAR = 5
"""Inflow and its sag, outflow and its sag, leak."""

N_COLUMNS = N_LINEAR + 2
"""The linear columns, the sensitivity to the pole, the measured position."""

POLE_MAX = 0.98
"""Upper end of the pole search: at 1 the commands have no effect at all."""

_GRID = 25
_CHANGES = 10  # of the positive parameters, until all of their sets are tried
_SINGULAR = 1e-12  # relative pivot below which columns count as dependent


class Stretch(NamedTuple):
    """One cycle as the kernels see it, (N,) each.

    Attributes
    ----------
    y : (N,) array
        Measured position [1].
    use, free, moving : (N,) bool arrays
        Sample has weight; spool is off the seats; a command acts.
    anchor : (N,) array
        Variance by which the level is less known from here on, in units of the noise variance;
        infinite = unknown anew [1].
    v_in, v_out : (N,) arrays
        Commands that act at the sample, lag included [1].
    """

    y: FloatArray
    use: BoolArray
    free: BoolArray
    anchor: FloatArray
    moving: BoolArray
    v_in: FloatArray
    v_out: FloatArray


class Rows(NamedTuple):
    """The samples of a cycle as eight filters take them, (N,) each, see `whiten_lanes`."""

    y: FloatArray
    flags: ByteArray
    anchor: FloatArray
    v_in: FloatArray
    v_out: FloatArray


@njit(cache=True)
def sample_flags(data: Stretch) -> ByteArray:
    """Return what each sample is, as `Rows` says it: (N,) uint8.

    Parameters
    ----------
    data : Stretch
        N samples.
    """
    flags = np.empty(len(data.y), dtype=np.uint8)
    for n in range(len(flags)):
        flags[n] = 1 * data.free[n] + 2 * data.use[n] + 4 * data.moving[n]
    return flags


@njit(cache=True)
def pack_rows(data: Stretch) -> Rows:
    """Return the samples that change anything: rest without weight does not.

    Parameters
    ----------
    data : Stretch
        The cycle.
    """
    size = len(data.y)
    y, anchor, v_in, v_out = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    flags = sample_flags(data)
    count = 0
    at_rest = False
    for n in range(size):
        flag = flags[n]
        if at_rest and not flag & 3 and not data.anchor[n] > 0.0:
            continue
        at_rest = not flag & 1
        y[count], anchor[count], flags[count] = data.y[n], data.anchor[n], flag
        v_in[count], v_out[count] = data.v_in[n], data.v_out[n]
        count += 1
    return Rows(y[:count], flags[:count], anchor[:count], v_in[:count], v_out[:count])


@njit(cache=True, inline="always")
def advance(
    commands: tuple[float, float],
    v_max: float,
    pole: float,
    p: FloatArray,
    drive: FloatArray,
    speed: FloatArray,
    level: FloatArray,
) -> None:
    """Move the responses to the parameters, and their sensitivity to the pole, by one sample.

    Parameters
    ----------
    commands : (float, float)
        Inflow and outflow at the sample [1].
    v_max, pole : float
        Greatest command [1], pole [1].
    p : (5,) array
        Parameters at which the sensitivity is taken [1].
    drive : (5,) array
        Overwritten [1].
    speed, level : (7,) arrays
        Of the responses, written in place [1].
    """
    a, b = commands
    drive[0] = a
    drive[1] = a * (2.0 * v_max - a)
    drive[2] = -b
    drive[3] = -b * (2.0 * v_max - b)
    drive[4] = -1.0
    pull = 0.0
    for k in range(N_LINEAR):
        pull += p[k] * (speed[k] - drive[k])
    for k in range(N_LINEAR):
        speed[k] = pole * speed[k] + (1.0 - pole) * drive[k]
        level[k] += speed[k]
    speed[N_LINEAR] = pole * speed[N_LINEAR] + pull
    level[N_LINEAR] += speed[N_LINEAR]


@njit(cache=True)
def accumulate(
    data: Stretch,
    pole: float,
    v_max: float,
    wander: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, int]:
    """Write the normal equations of the free run; return log determinant of weights, and rows.

    The level of each stretch is unknown; so is, with variance `wander` (in units of the noise
    variance) a sample in motion, its random walk. A scalar filter takes both out of the
    measurement and of every column alike, which is exactly the least squares with that covariance.
    `wander` = 0 is the plain output error with a free initial position.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    pole, v_max, wander : float
        Pole [1], greatest command [1], random walk [1].
    p : (5,) array
        Parameters at which the sensitivity to the pole is taken [1].
    gram : (7, 7) array
        Result [1].
    """
    y, use, free, anchor, moving, v_in, v_out = data
    gram[:, :] = 0.0
    speed = np.zeros(N_COLUMNS)
    level = np.zeros(N_COLUMNS)
    known = np.zeros(N_COLUMNS)
    innovation = np.zeros(N_COLUMNS)
    drive = np.zeros(N_LINEAR)
    variance = -1.0  # of the level, in units of the noise; negative = unknown
    log_determinant = 0.0
    rows = 0
    last = N_COLUMNS - 1
    for n in range(len(y)):
        if anchor[n] > 0.0:
            known_still = variance >= 0.0 and anchor[n] < np.inf
            variance = variance + anchor[n] if known_still else -1.0
        if free[n]:
            advance((v_in[n], v_out[n]), v_max, pole, p, drive, speed, level)
            if moving[n]:
                variance += wander if variance >= 0.0 else 0.0
        else:
            speed[:] = 0.0
        if not use[n]:
            continue
        level[last] = y[n]
        if variance < 0.0:
            known[:] = level
            variance = 1.0
            continue
        weight = 1.0 / (1.0 + variance)
        gain = variance * weight
        for k in range(N_COLUMNS):
            innovation[k] = level[k] - known[k]
            known[k] += gain * innovation[k]
        variance = gain
        for i in range(N_COLUMNS):
            for j in range(i + 1):
                gram[i, j] += weight * innovation[i] * innovation[j]
        log_determinant -= np.log(weight)
        rows += 1
    for i in range(N_COLUMNS):
        for j in range(i + 1, N_COLUMNS):
            gram[i, j] = gram[j, i]
    return log_determinant, rows


@njit(cache=True)
def _solve_subset(
    gram: FloatArray, chosen: IntArray, m: int, factor: FloatArray, x: FloatArray
) -> float:
    """Write the unconstrained minimiser over the first m chosen columns; return its cost."""
    last = N_COLUMNS - 1
    cost = eliminate(gram, chosen[:m], last, gram[last, last], _SINGULAR, factor, x)
    if cost == np.inf:
        return cost
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            x[i] -= factor[k, i] * x[k]
        x[i] /= factor[i, i]
    return cost


@njit(cache=True)
def list_subset(subset: int, chosen: IntArray) -> int:
    """Write the columns of a set of bits; return how many."""
    m = 0
    for k in range(N_LINEAR):
        chosen[m] = k
        m += (subset >> k) & 1
    return m


@njit(cache=True)
def _optimal_change(
    gram: FloatArray, chosen: IntArray, m: int, x: FloatArray, subset: int, allowed: int
) -> int:
    """Return the next set of columns, the same where this one is the constrained minimum.

    What is negative leaves; where nothing is, the column enters whose entry lowers the cost most.
    """
    following = subset
    for i in range(m):
        if x[i] < 0.0:
            following &= ~(1 << chosen[i])
    if following != subset:
        return following
    steepest, last = 0.0, N_COLUMNS - 1
    for k in range(N_LINEAR):
        if (subset >> k) & 1 or not (allowed >> k) & 1 or not gram[k, k] > 0.0:
            continue
        slope = gram[k, last]
        for i in range(m):
            slope -= gram[k, chosen[i]] * x[i]
        if slope > 0.0 and slope * slope > steepest * gram[k, k]:
            steepest = slope * slope / gram[k, k]
            following = subset | (1 << k)
    return following


@njit(cache=True)
def solve_positive(gram: FloatArray, columns: BoolArray, p: FloatArray) -> float:
    """Write the exact minimiser p >= 0 over the chosen columns; return its cost [1].

    A subset of columns whose solution is positive, and from which no other column would lower the
    cost, is the constrained minimum; it is found in a few changes. Where it is not, or columns are
    dependent, every subset is solved by Cholesky: of two that cannot be distinguished, one stays.

    Parameters
    ----------
    gram : (7, 7) array
        Normal equations, see `accumulate`.
    columns : (5,) bool array
        Columns that may be used.
    p : (5,) array
        Overwritten with the parameters [1].
    """
    best = float(gram[N_COLUMNS - 1, N_COLUMNS - 1])
    p[:] = 0.0
    factor = np.zeros((N_LINEAR, N_LINEAR))
    x = np.zeros(N_LINEAR)
    chosen = np.zeros(N_LINEAR + 1, dtype=np.int64)
    allowed = 0
    for k in range(N_LINEAR):
        allowed += (1 << k) * columns[k]
    subset = allowed
    for _ in range(_CHANGES):
        m = list_subset(subset, chosen)
        cost = _solve_subset(gram, chosen, m, factor, x)
        if cost == np.inf:
            break
        changed = _optimal_change(gram, chosen, m, x, subset, allowed)
        if changed == subset:
            p[chosen[:m]] = x[:m]
            return cost
        subset = changed
    for subset in range(1, 1 << N_LINEAR):
        if subset & ~allowed:
            continue
        m = list_subset(subset, chosen)
        cost = _solve_subset(gram, chosen, m, factor, x)
        if cost < best and x[:m].min() >= 0.0:
            best = cost
            p[:] = 0.0
            p[chosen[:m]] = x[:m]
    return best


@njit(cache=True)
def _cost(
    data: Stretch,
    pole: float,
    v_max: float,
    wander: float,
    columns: BoolArray,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return the least cost for one pole; `p` and `gram` are written."""
    p[:] = 0.0
    accumulate(data, pole, v_max, wander, p, gram)
    return float(solve_positive(gram, columns, p))


@njit(cache=True)
def search_pole(
    data: Stretch,
    v_max: float,
    wander: float,
    columns: BoolArray,
    fixed: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, float, int]:
    """Minimise over the pole and the rest; return pole, cost, log determinant, rows.

    The pole is one of a grid, which is enough to choose a lag.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max, wander : float
        Greatest command [1], random walk, see `accumulate` [1].
    columns : (5,) bool array
        Parameters that are fitted.
    fixed : float
        Pole that is taken as it is where not negative [1].
    p, gram : (5,), (7, 7) arrays
        Overwritten with parameters and normal equations at the minimum, with the sensitivity to
        the pole [1].
    """
    pole = fixed
    if fixed < 0.0:
        step = POLE_MAX / (_GRID - 1)
        best = np.inf
        pole = 0.0
        for k in range(_GRID):
            cost = _cost(data, k * step, v_max, wander, columns, p, gram)
            if cost < best:
                best, pole = cost, k * step
    _cost(data, pole, v_max, wander, columns, p, gram)
    cost, log_determinant, rows = fit_at_pole(data, v_max, wander, columns, pole, p, gram)
    return pole, cost, log_determinant, rows


@njit(cache=True)
def fit_at_pole(
    data: Stretch,
    v_max: float,
    wander: float,
    columns: BoolArray,
    pole: float,
    p: FloatArray,
    gram: FloatArray,
) -> tuple[float, float, int]:
    """Minimise over all but the pole; return cost, log determinant, rows.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max, wander : float
        Greatest command [1], random walk, see `accumulate` [1].
    columns : (5,) bool array
        Parameters that are fitted.
    pole : float
        The pole [1].
    p, gram : (5,), (7, 7) arrays
        Overwritten with parameters and normal equations; the sensitivity to the pole is that at
        the parameters that were in p [1].
    """
    log_determinant, rows = accumulate(data, pole, v_max, wander, p, gram)
    return solve_positive(gram, columns, p), log_determinant, rows


@njit(cache=True)
def pole_likelihood(
    data: Stretch,
    v_max: float,
    wander: float,
    columns: BoolArray,
    pole: float,
    p: FloatArray,
    gram: FloatArray,
) -> float:
    """Return minus twice the log likelihood at a pole, a constant left out.

    Parameters
    ----------
    data : Stretch
        N samples [1].
    v_max, wander : float
        Greatest command [1], random walk, see `accumulate` [1].
    columns : (5,) bool array
        Parameters that are fitted.
    pole : float
        The pole [1].
    p, gram : (5,), (7, 7) arrays
        Overwritten, see `search_pole`.
    """
    p[:] = 0.0
    cost, log_determinant, rows = fit_at_pole(data, v_max, wander, columns, pole, p, gram)
    return float(max(rows, 1) * np.log(max(cost, 1e-300) / max(rows, 1)) + log_determinant)
