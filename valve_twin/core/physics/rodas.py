# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Pieces of the Rosenbrock method RODAS of order 4 with an embedded solution of order 3.

L-stable, stiffly accurate, six stages, one factorisation a step (Hairer and Wanner, Solving
Ordinary Differential Equations II, section IV.7 and their program RODAS, first set of
coefficients). A valve's compiled integrator calls its own right-hand side between these pieces: a
function handed over as an argument would be compiled anew by every process. For an autonomous
system y' = f(y) with J = df/dy and a step h, W = 1/(gamma h) - J and

    W k_i = f(y + sum_j A[i, j] k_j) + sum_j C[i, j] k_j / h,   i = 1..6,

where stages 5 and 6 add the stage before: y_new = y_6 + k_6, and k_6 estimates the error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

STAGES = 6
GAMMA = 0.25

A = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ]
)
"""How stage i is made of the increments before it, (6, 5)."""

C = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [
            8.083246795921522,
            -7.981132988064893,
            -31.52159432874371,
            16.31930543123136,
            -6.058818238834054,
        ],
    ]
)
"""What the increments before add to the right-hand side of stage i, (6, 5)."""

D = np.array(
    [
        [
            10.12623508344586,
            -7.487995877610167,
            -34.80091861555747,
            -7.992771707568823,
            1.025137723295662,
        ],
        [
            -0.6762803392801253,
            6.087714651680015,
            16.43084320892478,
            24.76722511418386,
            -6.594389125716872,
        ],
    ]
)
"""How the solution inside a step, of order 3, is made of the increments, (2, 5)."""

SMALLEST_STEP = 1e-12
"""Shortest step before an integration counts as failed [s]."""

_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0


@njit(cache=True)
def factorise(m: FloatArray, pivot: IntArray) -> bool:
    """Factorise a matrix in place, rows exchanged; False where it is singular or not finite.

    Parameters
    ----------
    m : (S, S) array
        Overwritten with L and U, on the diagonal the inverse of U's.
    pivot : (S,) int64 array
        Overwritten with the row that stands where.
    """
    size = len(m)
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(m[i, k]) > abs(m[best, k]):
                best = i
        pivot[k] = best
        if not abs(m[best, k]) > 0.0 or not np.isfinite(m[best, k]):
            return False
        if best != k:
            for j in range(size):
                m[k, j], m[best, j] = m[best, j], m[k, j]
        inverse = 1.0 / m[k, k]
        m[k, k] = inverse
        for i in range(k + 1, size):
            factor = m[i, k] * inverse
            m[i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, size):
                    m[i, j] -= factor * m[k, j]
    return True


@njit(cache=True, inline="always")
def solve(m: FloatArray, pivot: IntArray, b: FloatArray) -> None:
    """Solve with what `factorise` left; `b` (S,) becomes the solution.

    Parameters
    ----------
    m : (S, S) array
        Factors of W [1/s].
    pivot : (S,) int64 array
        Exchanged rows.
    b : (S,) array
        Right-hand side [unit by state].
    """
    size = len(b)
    for k in range(size):
        if pivot[k] != k:
            b[k], b[pivot[k]] = b[pivot[k]], b[k]
    for k in range(size):
        known = b[k]
        for i in range(k + 1, size):
            b[i] -= m[i, k] * known
    for k in range(size - 1, -1, -1):
        known = b[k] * m[k, k]
        b[k] = known
        for i in range(k):
            b[i] -= m[i, k] * known


@njit(cache=True, inline="always")
def shift(jacobian: FloatArray, step: float, w: FloatArray) -> None:
    """Write W = 1/(gamma h) - J of a step [s]; both (S, S).

    Parameters
    ----------
    jacobian : (S, S) array
        J [1/s in the units of the states].
    step : float
        Step h [s].
    w : (S, S) array
        Overwritten [as the Jacobian].
    """
    size = len(w)
    for i in range(size):
        for j in range(size):
            w[i, j] = -jacobian[i, j]
        w[i, i] += 1.0 / (GAMMA * step)


@njit(cache=True, inline="always")
def stage_point(y: FloatArray, k: FloatArray, i: int, point: FloatArray) -> None:
    """Write where stage i (0..5) takes the right-hand side, (S,), from increments `k` (6, S).

    Parameters
    ----------
    y : (S,) array
        State at the begin of the step [unit by state].
    k : (6, S) array
        Increments [unit by state].
    i : int
        Stage, 0 to 5.
    point : (S,) array
        Overwritten [unit by state].
    """
    for s in range(len(y)):
        value = y[s]
        for j in range(i):
            value += A[i, j] * k[j, s]
        point[s] = value


@njit(cache=True, inline="always")
def stage_load(k: FloatArray, i: int, step: float) -> None:
    """Add the increments before stage i to `k[i]`, which holds f.

    Parameters
    ----------
    k : (6, S) array
        Increments; row i holds f [unit by state].
    i : int
        Stage, 0 to 5.
    step : float
        Step [s].
    """
    for j in range(i):
        weight = C[i, j] / step
        for s in range(k.shape[1]):
            k[i, s] += weight * k[j, s]


@njit(cache=True, inline="always")
def error_norm(
    y: FloatArray, new: FloatArray, error: FloatArray, floor: FloatArray, rtol: float
) -> float:
    """Return the error of a step over what is allowed, root mean square [1].

    Parameters
    ----------
    y, new, error : (S,) arrays
        State before and after the step, and its estimated error [unit by state].
    floor : (S,) array
        Size of each state below which the error counts absolutely [its unit].
    rtol : float
        Allowed error in parts of the state, or of its floor [1].
    """
    total = 0.0
    for s in range(len(y)):
        scale = rtol * (floor[s] + max(abs(y[s]), abs(new[s])))
        total += (error[s] / scale) ** 2
    return float(np.sqrt(total / len(y)))


@njit(cache=True)
def next_step(step: float, error: float, before: float, error_before: float) -> float:
    """Return the step to take after one with this relative error [s].

    Where errors grow from step to step, the next one is taken into account (Gustafsson).

    Parameters
    ----------
    step, error : float
        Step [s] and its error [1].
    before, error_before : float
        The last step that was accepted [s], 0 = none, and its error [1].
    """
    if not np.isfinite(error):
        return step * _SHRINK
    error = max(error, 1e-6)
    factor = _SAFETY * error**-0.25
    if before > 0.0 and error <= 1.0:
        trend = (step / before) * (max(error_before, 1e-2) / error) ** 0.25
        factor = min(factor, factor * trend)
    return float(step * min(max(factor, _SHRINK), _GROW))


@njit(cache=True)
def inside(y: FloatArray, new: FloatArray, k: FloatArray, theta: float, point: FloatArray) -> None:
    """Write the solution inside an accepted step, of order 3.

    Parameters
    ----------
    y, new : (S,) arrays
        State before and after the step [unit by state].
    k : (6, S) array
        Its increments [unit by state].
    theta : float
        Share of the step [1].
    point : (S,) array
        Overwritten [unit by state].
    """
    for s in range(len(y)):
        first, second = 0.0, 0.0
        for j in range(STAGES - 1):
            first += D[0, j] * k[j, s]
            second += D[1, j] * k[j, s]
        bend = first + theta * second
        point[s] = y[s] * (1.0 - theta) + theta * (new[s] + (1.0 - theta) * bend)
