# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled linear algebra of a few unknowns: loops beat a library call at this size."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


@njit(cache=True, error_model="numpy")
def factorise(h: FloatArray, lower: FloatArray) -> float:
    """Factorise h = lower lower^T; returns the least pivot."""
    least = np.inf
    for i in range(len(h)):
        for j in range(i + 1):
            rest = h[i, j]
            for n in range(j):
                rest -= lower[i, n] * lower[j, n]
            if i == j:
                least = min(least, rest)
                lower[i, i] = np.sqrt(rest) if rest > 0.0 else 1e-30
            else:
                lower[i, j] = rest / lower[j, j]
    return least


@njit(cache=True, inline="always")
def eliminate(
    gram: FloatArray,
    chosen: IntArray,
    column: int,
    cost: float,
    least: float,
    factor: FloatArray,
    x: FloatArray,
) -> float:
    """Take what some columns explain out of another's squares; return what is left.

    Infinite where the columns are dependent.

    Parameters
    ----------
    gram : (P, P) array
        Normal equations [1].
    chosen : (F,) int64 array
        The columns that explain.
    column : int
        The one that is explained.
    cost : float
        Its squares [1].
    least : float
        Relative pivot below which columns count as dependent [1].
    factor, x : (F, F), (F,) arrays
        Overwritten with the Cholesky factor and what it makes of the column [1].
    """
    for i in range(len(chosen)):
        total = gram[chosen[i], column]
        pivot = gram[chosen[i], chosen[i]]
        whole = pivot
        for j in range(i):
            t = gram[chosen[i], chosen[j]]
            for k in range(j):
                t -= factor[i, k] * factor[j, k]
            factor[i, j] = t / factor[j, j]
            total -= factor[i, j] * x[j]
            pivot -= factor[i, j] * factor[i, j]
        if pivot <= least * whole:
            return np.inf
        factor[i, i] = np.sqrt(pivot)
        x[i] = total / factor[i, i]
        cost -= x[i] * x[i]
    return cost


@njit(cache=True, error_model="numpy")
def solve_lower(lower: FloatArray, x: FloatArray, n: int) -> None:
    """Overwrite x by lower^-1 x, leading n rows.

    Parameters
    ----------
    lower : (K, K) array
        Lower triangular matrix [1].
    x : (K,) array
        Right-hand side, overwritten [1].
    n : int
        Rows that count [1].
    """
    for i in range(n):
        rest = x[i]
        for j in range(i):
            rest -= lower[i, j] * x[j]
        x[i] = rest / lower[i, i]


@njit(cache=True, error_model="numpy")
def solve_upper(lower: FloatArray, x: FloatArray, n: int) -> None:
    """Overwrite x by lower^-T x, leading n rows.

    Parameters
    ----------
    lower : (K, K) array
        Lower triangular matrix [1].
    x : (K,) array
        Right-hand side, overwritten [1].
    n : int
        Rows that count [1].
    """
    for i in range(n - 1, -1, -1):
        rest = x[i]
        for j in range(i + 1, n):
            rest -= lower[j, i] * x[j]
        x[i] = rest / lower[i, i]


@njit(cache=True, error_model="numpy")
def orthogonalise(a: FloatArray, chosen: IntArray, q: FloatArray, r: FloatArray) -> None:
    """Fill the orthogonal q (K, K) and r (m, m) of the chosen rows as columns (Householder).

    Parameters
    ----------
    a : (R, K) array
        Rows [1].
    chosen : (m,) int64 array
        Which of them.
    q : (K, K) array
        Filled with the orthogonal factor [1].
    r : (m, m) array
        Filled with the triangular factor [1].
    """
    k, m = len(q), len(chosen)
    columns, mirrors = np.empty((m, k)), np.zeros((m, k))
    for c in range(m):
        columns[c] = a[chosen[c]]
    for c in range(m):
        square = 0.0
        for i in range(c, k):
            square += columns[c, i] * columns[c, i]
        size = np.sqrt(square) if columns[c, c] <= 0.0 else -np.sqrt(square)
        for i in range(c, k):
            mirrors[c, i] = columns[c, i]
        mirrors[c, c] -= size
        weight = square - size * columns[c, c]
        for d in range(c, m):
            _mirror(mirrors[c], weight, c, columns[d])
        for n in range(c):
            r[n, c] = columns[c, n]
        r[c, c] = size
        mirrors[c] /= np.sqrt(weight)
    for j in range(k):
        column = q[j]
        for i in range(k):
            column[i] = 1.0 if i == j else 0.0
        # row j of q: the mirrors act on it in their order
        for c in range(m):
            _mirror(mirrors[c], 1.0, c, column)


@njit(cache=True, error_model="numpy")
def _mirror(direction: FloatArray, weight: float, first: int, x: FloatArray) -> None:
    """Reflect x at the plane of a direction whose half squared length is the weight."""
    product = 0.0
    for i in range(first, len(x)):
        product += direction[i] * x[i]
    product /= weight
    for i in range(first, len(x)):
        x[i] -= product * direction[i]


@njit(cache=True, error_model="numpy")
def project(h: FloatArray, basis: FloatArray) -> FloatArray:
    """Return the lower half of basis^T h basis."""
    k, free = basis.shape
    reduced, column = np.empty((free, free)), np.empty(k)
    for c in range(free):
        for i in range(k):
            column[i] = 0.0
            for j in range(k):
                column[i] += h[i, j] * basis[j, c]
        for d in range(c, free):
            reduced[d, c] = 0.0
            for i in range(k):
                reduced[d, c] += basis[i, d] * column[i]
    return reduced
