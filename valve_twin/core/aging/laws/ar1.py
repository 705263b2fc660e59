# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Products u' R v under AR(1) scatter, R[i, j] = rho^|i - j|, each in one pass."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

_NOTHING = 1e-300  # what is left of a vector that has ended adds nothing to a product


@njit(cache=True)
def ar1_product(u: FloatArray, v: FloatArray, rho: float) -> float:
    """Return u' R v with R[i, j] = rho^|i - j| in one pass.

    Parameters
    ----------
    u, v : (N,) arrays
        Vectors of any unit [1].
    rho : float
        Autocorrelation between neighbours [1].
    """
    total, behind_u, behind_v = 0.0, 0.0, 0.0
    for i in range(len(u)):
        total += u[i] * v[i] + rho * (u[i] * behind_v + v[i] * behind_u)
        behind_u = u[i] + rho * behind_u
        behind_v = v[i] + rho * behind_v
    return total


@njit(cache=True)
def ar1_leading(u: FloatArray, v: FloatArray, rho: float) -> FloatArray:
    """Return u' R v, see `ar1_product`, of every row of v, where u ends before they do, (K,).

    Parameters
    ----------
    u, v : (M,) and (K, N) arrays
        Vectors of any unit [1], N >= M.
    rho : float
        Autocorrelation between neighbours [1].
    """
    out = np.empty(len(v))
    for k in range(len(v)):
        total, behind_u, behind_v = 0.0, 0.0, 0.0
        for i in range(len(u)):
            total += u[i] * v[k, i] + rho * (u[i] * behind_v + v[k, i] * behind_u)
            behind_u, behind_v = u[i] + rho * behind_u, v[k, i] + rho * behind_v
        for i in range(len(u), v.shape[1]):
            total += rho * v[k, i] * behind_u
            behind_u *= rho
            if abs(behind_u) < _NOTHING:
                break
        out[k] = total
    return out


@njit(cache=True)
def ar1_forms(u: FloatArray, v: FloatArray, rho: float) -> FloatArray:
    """Return u' R u, u' R v and v' R v, see `ar1_product`, of every pair of rows, (3, K).

    Parameters
    ----------
    u, v : (K, N) arrays
        Vectors of any unit [1].
    rho : float
        Autocorrelation between neighbours [1].
    """
    out = np.zeros((3, len(u)))
    for k in range(len(u)):
        first, cross, second, behind_u, behind_v = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(u.shape[1]):
            a, b = u[k, i], v[k, i]
            first += a * a + 2.0 * rho * a * behind_u
            cross += a * b + rho * (a * behind_v + b * behind_u)
            second += b * b + 2.0 * rho * b * behind_v
            behind_u, behind_v = a + rho * behind_u, b + rho * behind_v
        out[0, k], out[1, k], out[2, k] = first, cross, second
    return out


@njit(cache=True)
def shape_weights(
    g: FloatArray,
    kept: IntArray,
    fits: FloatArray,
    rho: float,
    level: FloatArray,
    change: FloatArray,
) -> FloatArray:
    """Write the weights that give level and change of some shapes; return their `ar1_forms`.

    Parameters
    ----------
    g : (J, N) array
        Shapes [1].
    kept : (K,) int64 array
        Which of them [1].
    fits : (K, 4) array
        Means, sums of squares and whatever else of these, see `core.aging.laws.shapes.squares`.
    rho : float
        Autocorrelation between neighbours [1].
    level, change : (K, N) arrays
        Take the weights [1].
    """
    n = g.shape[1]
    for k in range(len(kept)):
        mean, square = fits[k, 0], fits[k, 1]
        last = g[kept[k], n - 1] - mean
        for i in range(n):
            change[k, i] = (g[kept[k], i] - mean) / square
            level[k, i] = 1.0 / n + last * change[k, i]
    return ar1_forms(level, change, rho)
