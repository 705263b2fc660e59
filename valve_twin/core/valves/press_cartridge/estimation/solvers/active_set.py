# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Small convex quadratic programs, solved to rounding.

DAQP finds the active set; a proximal term makes a singular matrix regular. From there a primal
active-set method goes on in proximal steps until nothing changes beyond rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

ACTIVE = 1e-11
"""Multiplier or slack that counts as zero, scaled [1]."""

_PROX = 1e-9  # proximal weight for DAQP, beside a unit diagonal
_PROX_STEPS = 3
_FINE_PROX = 1e-12  # proximal weight after it, beside a unit diagonal
_FINE_STEPS = 60  # most steps with it; one or two unless columns are nearly dependent
_CHANGES = 200  # most changes of the active set after DAQP
_BLAND = 40  # after so many the first candidate is taken instead of the best, which cannot cycle


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """Minimise s g s / 2 - f s subject to a s <= b.

    Attributes
    ----------
    g : (K, K) array
        Positive semidefinite, with a diagonal of ones and zeros; f lies in its range.
    f : (K,) array
        Linear part.
    a : (M, K) array
        Rows of unit length (or zero).
    b : (M,) array
        Limits.
    """

    g: FloatArray
    f: FloatArray
    a: FloatArray
    b: FloatArray


def minimise(p: QuadraticProgram) -> tuple[FloatArray, FloatArray] | None:
    """Return the optimum (K,) and the multipliers (M,); None where nothing is feasible."""
    start = _start(p)
    return None if start is None else _polish(p, *start)


def kkt_residual(p: QuadraticProgram, s: FloatArray, multipliers: FloatArray) -> float:
    """Return the largest violation of stationarity, feasibility and complementarity.

    Relative to the solution where that is large: nearly dependent columns.

    Parameters
    ----------
    p : QuadraticProgram
        The scaled problem.
    s : (K,) array
        Solution [1].
    multipliers : (M,) array
        Of the inequalities [1].
    """
    slack = p.b - p.a @ s
    stationarity = p.g @ s - p.f + p.a.T @ multipliers
    complementarity = multipliers * slack
    parts = (np.abs(stationarity), np.maximum(-slack, 0.0), np.abs(complementarity))
    return float(max(part.max(initial=0.0) for part in parts) / max(1.0, np.abs(s).max()))


def _start(p: QuadraticProgram) -> tuple[FloatArray, list[int]] | None:
    """Return optimum and active set by DAQP with proximal steps, else just a point inside."""
    s, multipliers = np.zeros(len(p.f)), np.zeros(len(p.b))
    h = p.g + _PROX * np.eye(len(p.f))
    for _ in range(_PROX_STEPS if len(p.b) else 0):
        s, flag, multipliers = _daqp(p, h, -p.f - _PROX * s)
        if flag <= 0:
            inside = _feasible(p)
            return None if inside is None else (inside, [])
    return s, _independent(p.a, [int(i) for i in np.flatnonzero(multipliers > 0.0)])


def _feasible(p: QuadraticProgram) -> FloatArray | None:
    """Return a point inside: zero, or the one nearest to it; None where there is none."""
    k = len(p.f)
    if (p.b >= 0.0).all():
        return np.zeros(k)
    s, flag, _ = _daqp(p, np.eye(k), np.zeros(k))
    return s if flag > 0 else None


def _daqp(
    p: QuadraticProgram, h: FloatArray, linear: FloatArray
) -> tuple[FloatArray, int, FloatArray]:
    """Minimise s h s / 2 + linear s inside: (s, flag, multipliers); flag > 0 = solved."""
    import daqp  # only where estimates are made

    m = len(p.b)
    s, _, flag, info = daqp.solve(
        np.ascontiguousarray(h),
        np.ascontiguousarray(linear),
        np.ascontiguousarray(p.a),
        np.ascontiguousarray(p.b),
        np.full(m, -1e30),
        np.zeros(m, np.int32),
        primal_tol=1e-11,
        dual_tol=1e-13,
        eps_prox=0.0,
    )
    return np.asarray(s, float), int(flag), np.asarray(info["lam"], float)


def _polish(
    p: QuadraticProgram, s: FloatArray, active: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Go from a feasible point to the optimum by proximal steps, each exact: (s, multipliers)."""
    multipliers = np.zeros(len(p.b))
    regular = p.g + _FINE_PROX * np.eye(len(s))
    for _ in range(_FINE_STEPS):
        before = s
        step = replace(p, g=regular, f=p.f + _FINE_PROX * before)
        s, multipliers, active = _descend(step, before, active)
        if _FINE_PROX * np.abs(s - before).max(initial=0.0) <= 0.1 * ACTIVE:
            break
    return s, multipliers


def _descend(
    p: QuadraticProgram, s: FloatArray, active: list[int]
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Go from a feasible point to the optimum of a regular problem, changing the active set."""
    multipliers = np.zeros(len(p.b))
    for change in range(_CHANGES):
        target, multipliers = _on_set(p, active)
        block, part = _blocking(p, s, target - s, active, first=change > _BLAND)
        if block >= 0:
            s = s + part * (target - s)
            active = [*active, block]
            continue
        s = target
        negative = [i for i in sorted(active) if multipliers[i] < -ACTIVE]
        if not negative:
            break
        worst = negative[0] if change > _BLAND else min(negative, key=multipliers.__getitem__)
        active = [i for i in active if i != worst]
    positive: FloatArray = np.maximum(multipliers, 0.0)
    return s, positive, active


def _blocking(
    p: QuadraticProgram, s: FloatArray, step: FloatArray, active: list[int], *, first: bool
) -> tuple[int, float]:
    """Return the inequality that stops a step and the part before it; (-1, 1) if none does."""
    rate = p.a @ step
    slack = np.maximum(p.b - p.a @ s, 0.0)
    rate[active] = 0.0
    hit = np.flatnonzero((rate > 1e-15) & (rate - slack > 1e-14))
    if len(hit) == 0:
        return -1, 1.0
    part = slack[hit] / rate[hit]
    nearest = np.flatnonzero(part <= part.min())
    k = int(nearest[0]) if first else int(nearest[np.argmax(rate[hit][nearest])])
    return int(hit[k]), float(part[k])


def _independent(a: FloatArray, candidates: list[int]) -> list[int]:
    """Candidates in order, without those whose rows depend on earlier ones."""
    chosen: list[int] = []
    basis = np.zeros((0, a.shape[1]))
    for i in candidates:
        rest = a[i] - basis.T @ (basis @ a[i])
        rest -= basis.T @ (basis @ rest)
        size = np.linalg.norm(rest)
        if size > 1e-9:
            chosen.append(i)
            basis = np.vstack([basis, rest / size])
    return chosen


def _on_set(p: QuadraticProgram, active: list[int]) -> tuple[FloatArray, FloatArray]:
    """Minimise with the active inequalities as equations: (s, multipliers)."""
    m = len(active)
    multipliers = np.zeros(len(p.b))
    s: FloatArray
    if m == 0:
        s = np.linalg.solve(p.g, p.f).astype(np.float64)
        return s, multipliers
    q, r = np.linalg.qr(p.a[active].T, mode="complete")
    fixed, free = q[:, :m], q[:, m:]
    s = fixed @ np.linalg.solve(r[:m].T, p.b[active])
    for _ in range(2 if m < len(s) else 0):  # the second pass refines the first
        s = s + free @ np.linalg.solve(free.T @ p.g @ free, free.T @ (p.f - p.g @ s))
    multipliers[active] = np.linalg.solve(r[:m], fixed.T @ (p.f - p.g @ s))
    return s, multipliers
