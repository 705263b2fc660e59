# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled solver of a constrained least squares with few terms: microseconds a cycle.

With H = L L^T the problem is a projection, min |L^T s - L^-1 f|^2 under a s <= b, whose dual is a
linear complementarity problem in the multipliers. Principal pivoting finds the active set: whole
blocks first, then one index at a time, which ends (Judice and Pires 1994). The solution
is then computed afresh on that set in its null space, refined, and its Karush-Kuhn-Tucker
conditions are verified; whoever calls decides what to do where they do not hold. A column without
excitation gets a weight of its own, which leaves its parameter at zero and every condition exact;
dependent columns get a proximal weight whose effect the refinement takes back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.small_dense import (
    factorise,
    orthogonalise,
    project,
    solve_lower,
    solve_upper,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

SOLVED = 0
"""A point was found whose residual is given."""

NOT_FOUND = 1
"""No active set was found; the general path has to answer."""

ACTIVE = 1e-11
"""Multiplier or slack that counts as zero, scaled [1]."""

_PIVOT = 1e-9  # pivot below which columns count as dependent, beside a unit diagonal
_PROX = 1e-9  # proximal weight where they are
_TINY = 1e-13  # complementarity error that counts as zero while pivoting, scaled
_BLOCKS = 8  # most exchanges of whole blocks
_SINGLES = 60  # most exchanges of one index after them
_ROUNDING = 1e-14  # gradient along the free directions that ends the refinement, scaled
_REFINEMENTS = 60  # most refinements; two unless columns are nearly dependent


@njit(cache=True, error_model="numpy")
def solve_small(
    matrix: FloatArray,
    vector: FloatArray,
    power: float,
    rows: FloatArray,
    bound: FloatArray,
    theta: FloatArray,
    active: BoolArray,
) -> tuple[int, float, float]:
    """Minimise theta G theta - 2 v theta + power under rows @ theta <= bound.

    Parameters
    ----------
    matrix : (K, K) array
        Normal matrix G [1]; may be singular.
    vector : (K,) array
        Right-hand side v [1].
    power : float
        Sum of y^2 [1].
    rows : (M, K) array
        Inequalities [1].
    bound : (M,) array
        Their right-hand sides [1].
    theta : (K,) array
        Filled with the solution [1].
    active : (M,) bool array
        Filled with the inequalities that hold with equality.

    Returns
    -------
    tuple of int, float, float
        `SOLVED` or `NOT_FOUND`, the cost [1], the scaled residual of the conditions [1].
    """
    k, m = len(vector), len(bound)
    unit, g, f = np.empty(k), np.empty((k, k)), np.empty(k)
    a, b = np.empty((m, k)), np.empty(m)
    if not _scale(matrix, vector, power, rows, bound, unit, g, f, a, b):
        return NOT_FOUND, np.nan, np.nan
    h, lower = np.empty((k, k)), np.empty((k, k))
    prox = _regular(g, h, lower)
    chosen = np.empty(min(k, m), np.int64)
    count = _active_set(f, a, b, lower, chosen)
    if count < 0:
        return NOT_FOUND, np.nan, np.nan
    s, multipliers = np.empty(k), np.zeros(m)
    _solve_on_set(g, f, a, b, h, prox, chosen[:count], s, multipliers)
    kkt = _residual(g, f, a, b, s, multipliers)
    for i in range(k):
        shut = g[i, i] == 0.0 and abs(s[i]) <= ACTIVE
        theta[i] = 0.0 if shut else s[i] / unit[i]
    for i in range(m):
        slack = b[i]
        for j in range(k):
            slack -= a[i, j] * s[j]
        active[i] = multipliers[i] > 0.0 or slack <= ACTIVE
        if active[i]:
            _rest_on_bound(rows[i], bound[i], theta)
    return SOLVED, _cost(matrix, vector, power, theta), kkt


@njit(cache=True, error_model="numpy")
def _scale(
    matrix: FloatArray,
    vector: FloatArray,
    power: float,
    rows: FloatArray,
    bound: FloatArray,
    unit: FloatArray,
    g: FloatArray,
    f: FloatArray,
    a: FloatArray,
    b: FloatArray,
) -> bool:
    """State the problem in s = theta * unit; False where an inequality without terms is false."""
    k = len(vector)
    if not power > 0.0:
        power = 1.0
    size = np.sqrt(power)
    for i in range(k):
        length = np.sqrt(matrix[i, i])
        unit[i] = (length if length > 0.0 else 1.0) / size
        f[i] = vector[i] / (unit[i] * power)
    for i in range(k):
        for j in range(k):
            g[i, j] = matrix[i, j] / (unit[i] * unit[j]) / power
    for i in range(len(bound)):
        square = 0.0
        for j in range(k):
            a[i, j] = rows[i, j] / unit[j]
            square += a[i, j] * a[i, j]
        norm = np.sqrt(square)
        if norm == 0.0:
            if bound[i] < 0.0:
                return False
            norm = 1.0
        b[i] = bound[i] / norm
        for j in range(k):
            a[i, j] /= norm
    return True


@njit(cache=True, error_model="numpy")
def _regular(g: FloatArray, h: FloatArray, lower: FloatArray) -> float:
    """Fill a regular form of g and its factor; returns the proximal weight, 0 if none is needed.

    A column without excitation gets the weight one.
    """
    k = len(g)
    for i in range(k):
        for j in range(k):
            h[i, j] = g[i, j]
        if g[i, i] == 0.0:
            h[i, i] = 1.0
    if factorise(h, lower) >= _PIVOT:
        return 0.0
    for i in range(k):
        h[i, i] += _PROX
    factorise(h, lower)
    return _PROX


@njit(cache=True, error_model="numpy")
def _active_set(
    f: FloatArray, a: FloatArray, b: FloatArray, lower: FloatArray, chosen: IntArray
) -> int:
    """Find the inequalities that bind by principal pivoting; returns their number or -1."""
    k, m = len(f), len(b)
    z, v, s, q = f.copy(), a.copy(), np.empty((m, m)), np.empty(m)
    solve_lower(lower, z, k)
    for i in range(m):
        solve_lower(lower, v[i], k)
        q[i] = -b[i]
        for n in range(k):
            q[i] += v[i, n] * z[n]
    for i in range(m):
        for j in range(i + 1):
            s[i, j] = 0.0
            for n in range(k):
                s[i, j] += v[i, n] * v[j, n]
            s[j, i] = s[i, j]
    member = np.zeros(m, np.bool_)
    factor, x, wrong = np.empty((k, k)), np.empty(k), np.empty(m, np.bool_)
    for step in range(_BLOCKS + _SINGLES):
        count = _independent(s, member, chosen, factor, k)
        for c in range(count):
            x[c] = q[chosen[c]]
        solve_lower(factor, x, count)
        solve_upper(factor, x, count)
        if _mark_wrong(s, q, member, chosen, x, count, wrong) == 0:
            return count
        for i in range(m):
            if wrong[i]:
                member[i] = not member[i]
                if step >= _BLOCKS:
                    break
    return -1


@njit(cache=True, error_model="numpy")
def _independent(
    s: FloatArray, member: BoolArray, chosen: IntArray, factor: FloatArray, most: int
) -> int:
    """Choose members in order without those that depend on earlier ones, with their factor."""
    count = 0
    for i in range(len(s)):
        if not member[i]:
            continue
        if count < most:
            rest = s[i, i]
            for c in range(count):
                part = s[i, chosen[c]]
                for n in range(c):
                    part -= factor[count, n] * factor[c, n]
                factor[count, c] = part / factor[c, c]
                rest -= factor[count, c] * factor[count, c]
            if rest > 1e-12 * s[i, i]:
                factor[count, count] = np.sqrt(rest)
                chosen[count] = i
                count += 1
                continue
        member[i] = False
    return count


@njit(cache=True, error_model="numpy")
def _mark_wrong(
    s: FloatArray,
    q: FloatArray,
    member: BoolArray,
    chosen: IntArray,
    x: FloatArray,
    count: int,
    wrong: BoolArray,
) -> int:
    """Mark members with a negative multiplier and others that are violated; returns how many."""
    found = 0
    for i in range(len(q)):
        wrong[i] = False
        if not member[i]:
            violation, scale = q[i], max(1.0, abs(q[i]))
            for c in range(count):
                part = s[i, chosen[c]] * x[c]
                violation -= part
                scale = max(scale, abs(part))
            wrong[i] = violation > _TINY * scale
    for c in range(count):
        wrong[chosen[c]] = x[c] < -_TINY
    for i in range(len(q)):
        found += wrong[i]
    return found


@njit(cache=True, error_model="numpy")
def _solve_on_set(
    g: FloatArray,
    f: FloatArray,
    a: FloatArray,
    b: FloatArray,
    h: FloatArray,
    prox: float,
    chosen: IntArray,
    s: FloatArray,
    multipliers: FloatArray,
) -> None:
    """Minimise with the chosen inequalities as equations, in their null space, refined."""
    k, m = len(f), len(chosen)
    q, r = np.empty((k, k)), np.empty((m, m))
    orthogonalise(a, chosen, q, r)
    x, rest = np.empty(k), np.empty(k)
    for c in range(m):
        x[c] = b[chosen[c]]
        for n in range(c):
            x[c] -= r[n, c] * x[n]
        x[c] /= r[c, c]
    for i in range(k):
        s[i] = 0.0
        for c in range(m):
            s[i] += q[i, c] * x[c]
    _descend(g, f, h, prox, q[:, m:], s)
    _gradient(g, f, s, rest)
    for c in range(m - 1, -1, -1):
        x[c] = 0.0
        for i in range(k):
            x[c] += q[i, c] * rest[i]
        for n in range(c + 1, m):
            x[c] -= r[c, n] * x[n]
        x[c] /= r[c, c]
        multipliers[chosen[c]] = max(x[c], 0.0)


@njit(cache=True, error_model="numpy")
def _descend(
    g: FloatArray, f: FloatArray, h: FloatArray, prox: float, basis: FloatArray, s: FloatArray
) -> None:
    """Move s to the optimum along the columns of a basis, until only rounding is left."""
    k, free = basis.shape
    if free == 0:
        return
    factor, part, rest = np.empty((free, free)), np.empty(free), np.empty(k)
    factorise(project(h, basis), factor)
    for step in range(_REFINEMENTS):
        _gradient(g, f, s, rest)
        worst = 0.0
        for c in range(free):
            part[c] = 0.0
            for i in range(k):
                part[c] += basis[i, c] * rest[i]
            worst = max(worst, abs(part[c]))
        if step >= 2 and (prox == 0.0 or worst <= _ROUNDING):
            break
        solve_lower(factor, part, free)
        solve_upper(factor, part, free)
        for i in range(k):
            for c in range(free):
                s[i] += basis[i, c] * part[c]


@njit(cache=True, error_model="numpy")
def _gradient(g: FloatArray, f: FloatArray, s: FloatArray, rest: FloatArray) -> None:
    """Fill rest with f - g s."""
    for i in range(len(f)):
        rest[i] = f[i]
        for j in range(len(f)):
            rest[i] -= g[i, j] * s[j]


@njit(cache=True, error_model="numpy")
def _residual(
    g: FloatArray,
    f: FloatArray,
    a: FloatArray,
    b: FloatArray,
    s: FloatArray,
    multipliers: FloatArray,
) -> float:
    """Return the largest violation of stationarity, feasibility and complementarity.

    Relative to the solution where that is large: nearly dependent columns.
    """
    worst, size = 0.0, 1.0
    rest = np.empty(len(f))
    _gradient(g, f, s, rest)
    for i in range(len(b)):
        slack = b[i]
        for j in range(len(f)):
            slack -= a[i, j] * s[j]
            rest[j] -= multipliers[i] * a[i, j]
        worst = max(worst, -slack, abs(multipliers[i] * slack))
    for j in range(len(f)):
        worst = max(worst, abs(rest[j]))
        size = max(size, abs(s[j]))
    return worst / size


@njit(cache=True, error_model="numpy")
def _rest_on_bound(row: FloatArray, bound: float, theta: FloatArray) -> None:
    """Set a parameter that rests on a bound of its own to the bound, bit for bit."""
    column, terms = -1, 0
    for j in range(len(row)):
        if row[j] != 0.0:
            column, terms = j, terms + 1
    if terms == 1:
        theta[column] = bound / row[column] + 0.0


@njit(cache=True, error_model="numpy")
def _cost(matrix: FloatArray, vector: FloatArray, power: float, theta: FloatArray) -> float:
    """Sum of squared errors of the parameters from the normal equations."""
    cost = power
    for i in range(len(vector)):
        part = -2.0 * vector[i]
        for j in range(len(vector)):
            part += matrix[i, j] * theta[j]
        cost += part * theta[i]
    return cost
