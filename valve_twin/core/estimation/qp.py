# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Least squares under linear inequalities: min |u theta - y|^2, A theta <= b (paper 002, (22)).

`solve_qp` works on the normal equations with columns of unit length. DAQP finds the active set (a
proximal term makes a singular matrix regular); from there a primal active-set method goes on until
the Karush-Kuhn-Tucker conditions hold to rounding, so that bounds are met bit for bit. A column
without excitation keeps its parameter at zero unless an inequality forbids it. `solve_qp_cvxpy`
states the same problem in cvxpy, as the reference in cost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import daqp
import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.estimation.constraints import Inequalities
    from valve_twin.core.estimation.regression import Gram
    from valve_twin.core.types import BoolArray, FloatArray

KKT_TOLERANCE = 1e-10
"""Largest Karush-Kuhn-Tucker residual of a solution in scaled variables [1]."""

_PROX = 1e-9  # proximal weight for DAQP, beside a unit diagonal
_PROX_STEPS = 3
_FINE_PROX = 1e-12  # proximal weight after it, beside a unit diagonal
_FINE_STEPS = 60  # most steps with it; one or two unless columns are nearly dependent
_ACTIVE = 1e-11  # multiplier or slack that counts as zero, scaled [1]
_RANK = (
    1e-12  # eigenvalue of the scaled matrix that counts as zero: columns 1e-6 apart are equal [1]
)
_CHANGES = 200  # most changes of the active set after DAQP
_BLAND = 40  # after so many the first candidate is taken instead of the best, which cannot cycle


@dataclass(frozen=True, slots=True)
class QpSolution:
    """Solution of a constrained least squares problem.

    Attributes
    ----------
    theta : (K,) array
        The parameters; NaN where `solved` is False.
    active : (M,) bool array
        Inequalities that hold with equality.
    cost : float
        Sum of squared errors, from the normal equations [1].
    kkt : float
        Largest violation of the Karush-Kuhn-Tucker conditions in scaled variables [1].
    solved : bool
        Whether the conditions hold to `KKT_TOLERANCE`.
    reason : str
        Why not; empty where solved.
    """

    theta: FloatArray
    active: BoolArray
    cost: float
    kkt: float
    solved: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class _Scaled:
    """The problem in s = theta * unit: unit columns, unit right-hand side, unit rows."""

    g: FloatArray
    f: FloatArray
    a: FloatArray
    b: FloatArray
    unit: FloatArray


def quadratic_cost(gram: Gram, theta: FloatArray) -> float:
    """Return the sum of squared errors [1] of some parameters from the normal equations."""
    return float(gram.power - 2.0 * gram.vector @ theta + theta @ gram.matrix @ theta)


def column_condition(gram: Gram) -> float:
    """Return the condition number of the regressor, its excited columns of unit length [1].

    From the normal equations, so it saturates near 1e8; infinite where columns depend on each
    other.
    """
    length = np.sqrt(np.diag(gram.matrix))
    k = np.flatnonzero(length > 0.0)
    if len(k) == 0:
        return float("inf")
    eigen = np.linalg.eigvalsh(gram.matrix[np.ix_(k, k)] / np.outer(length[k], length[k]))
    return float(np.sqrt(eigen[-1] / eigen[0])) if eigen[0] > 0.0 else float("inf")


def unsolved(inequalities: Inequalities, reason: str) -> QpSolution:
    """Return the value that says why a problem has no solution."""
    m, k = inequalities.matrix.shape
    nothing = float("nan")
    return QpSolution(np.full(k, nothing), np.zeros(m, bool), nothing, nothing, False, reason)


def solve_qp(gram: Gram, inequalities: Inequalities) -> QpSolution:
    """Minimise the sum of squared errors under linear inequalities, to rounding.

    Parameters
    ----------
    gram : Gram
        Normal equations of K terms; may be singular.
    inequalities : Inequalities
        Over the same K parameters; may be empty.

    Returns
    -------
    QpSolution
        With `solved` False where the inequalities contradict each other.
    """
    scaled = _scale(gram, inequalities)
    if scaled is None:
        return unsolved(inequalities, _never_holds(inequalities))
    start = _start(scaled)
    if start is None:
        return unsolved(inequalities, "the constraints contradict each other")
    s, multipliers = _polish(scaled, *start)
    kkt = _kkt(scaled, s, multipliers)
    active = (multipliers > 0.0) | (scaled.a @ s - scaled.b >= -_ACTIVE)
    shut = (np.diag(scaled.g) == 0.0) & (np.abs(s) <= _ACTIVE)
    theta = _exact_bounds(np.where(shut, 0.0, s / scaled.unit), active, inequalities)
    solved = kkt <= KKT_TOLERANCE
    reason = "" if solved else f"the solver stopped at a residual of {kkt:.1e}"
    return QpSolution(theta, active, quadratic_cost(gram, theta), kkt, solved, reason)


def solve_qp_cvxpy(u: FloatArray, y: FloatArray, inequalities: Inequalities) -> QpSolution:
    """Solve the same problem stated in cvxpy, from the regression rows (the paper used CVX).

    Parameters
    ----------
    u : (R, K) array
        Regressor.
    y : (R,) array
        Right-hand side [1].
    inequalities : Inequalities
        Over the K parameters.

    Returns
    -------
    QpSolution
        `active` within 1e-6 in scaled variables; `kkt` is NaN.
    """
    import cvxpy

    length = np.linalg.norm(u, axis=0)
    length[length == 0.0] = 1.0
    size = float(np.linalg.norm(y)) or 1.0
    # an orthogonal reduction keeps the cost and spares the solver the many rows
    q, r = np.linalg.qr(u / length)
    target = q.T @ (y / size)
    s = cvxpy.Variable(u.shape[1])
    a = inequalities.matrix / length
    norm = np.linalg.norm(a, axis=1)
    norm[norm == 0.0] = 1.0
    limits = [(a / norm[:, None]) @ s <= inequalities.bound / norm / size] if len(a) else []
    error = cvxpy.sum_squares(r @ s - target)  # type: ignore[attr-defined]
    problem = cvxpy.Problem(cvxpy.Minimize(error), limits)
    problem.solve(  # type: ignore[no-untyped-call]
        solver=cvxpy.CLARABEL, tol_gap_abs=1e-14, tol_gap_rel=1e-12, tol_feas=1e-12, max_iter=200
    )
    if s.value is None:
        return unsolved(inequalities, f"cvxpy: the problem is {problem.status}")
    theta = np.asarray(s.value, float) / length * size
    slack = (inequalities.bound - inequalities.matrix @ theta) / norm / size
    cost = float(np.sum((y - u @ theta) ** 2))
    return QpSolution(theta, slack <= 1e-6, cost, float("nan"), True)


def _never_holds(inequalities: Inequalities) -> str:
    empty = ~inequalities.matrix.any(axis=1) & (inequalities.bound < 0.0)
    return f'the constraint "{inequalities.labels[int(np.argmax(empty))]}" can never hold'


def _scale(gram: Gram, inequalities: Inequalities) -> _Scaled | None:
    """Scale the problem; None where an inequality without coefficients is false."""
    length = np.sqrt(np.diag(gram.matrix))
    length[length == 0.0] = 1.0
    size = np.sqrt(gram.power) if gram.power > 0.0 else 1.0
    unit = length / size
    a = inequalities.matrix / unit
    norm = np.linalg.norm(a, axis=1)
    if (inequalities.bound[norm == 0.0] < 0.0).any():
        return None
    norm[norm == 0.0] = 1.0
    g, f = _without_rounding(gram.matrix / np.outer(length, length), gram.vector / (length * size))
    return _Scaled(g, f, a / norm[:, None], inequalities.bound / norm, unit)


def _without_rounding(g: FloatArray, f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Remove the directions in which the normal equations hold nothing but rounding."""
    eigen, vectors = np.linalg.eigh(g)
    lost = (eigen < _RANK) & (vectors != 0.0).any(axis=0)
    shut = np.diag(g) == 0.0
    if lost.sum() == shut.sum():
        return g, f
    kept = vectors[:, ~lost]
    kept[shut] = 0.0
    return (kept * eigen[~lost]) @ kept.T, kept @ (kept.T @ f)


def _feasible(p: _Scaled) -> FloatArray | None:
    """Return a point inside: zero, or the one nearest to it; None where there is none."""
    k = len(p.f)
    if (p.b >= 0.0).all():
        return np.zeros(k)
    s, flag, _ = _daqp(p, np.eye(k), np.zeros(k))
    return s if flag > 0 else None


def _start(p: _Scaled) -> tuple[FloatArray, list[int]] | None:
    """Return optimum and active set by DAQP with proximal steps, else just a point inside."""
    s, multipliers = np.zeros(len(p.f)), np.zeros(len(p.b))
    h = p.g + _PROX * np.eye(len(p.f))
    for _ in range(_PROX_STEPS if len(p.b) else 0):
        s, flag, multipliers = _daqp(p, h, -p.f - _PROX * s)
        if flag <= 0:
            inside = _feasible(p)
            return None if inside is None else (inside, [])
    return s, _independent(p.a, [int(i) for i in np.flatnonzero(multipliers > 0.0)])


def _daqp(p: _Scaled, h: FloatArray, linear: FloatArray) -> tuple[FloatArray, int, FloatArray]:
    """Minimise s h s / 2 + linear s inside: (s, flag, multipliers); flag > 0 = solved."""
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


def _polish(p: _Scaled, s: FloatArray, active: list[int]) -> tuple[FloatArray, FloatArray]:
    """Go from a feasible point to the optimum by proximal steps, each exact: (s, multipliers)."""
    multipliers = np.zeros(len(p.b))
    regular = p.g + _FINE_PROX * np.eye(len(s))
    for _ in range(_FINE_STEPS):
        before = s
        step = replace(p, g=regular, f=p.f + _FINE_PROX * before)
        s, multipliers, active = _descend(step, before, active)
        if _FINE_PROX * np.abs(s - before).max(initial=0.0) <= 0.1 * _ACTIVE:
            break
    return s, multipliers


def _descend(
    p: _Scaled, s: FloatArray, active: list[int]
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
        negative = [i for i in sorted(active) if multipliers[i] < -_ACTIVE]
        if not negative:
            break
        worst = negative[0] if change > _BLAND else min(negative, key=multipliers.__getitem__)
        active = [i for i in active if i != worst]
    positive: FloatArray = np.maximum(multipliers, 0.0)
    return s, positive, active


def _blocking(
    p: _Scaled, s: FloatArray, step: FloatArray, active: list[int], *, first: bool
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


def _on_set(p: _Scaled, active: list[int]) -> tuple[FloatArray, FloatArray]:
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


def _kkt(p: _Scaled, s: FloatArray, multipliers: FloatArray) -> float:
    """Return the largest violation of stationarity, feasibility and complementarity.

    Relative to the solution where that is large: nearly dependent columns.
    """
    slack = p.b - p.a @ s
    stationarity = p.g @ s - p.f + p.a.T @ multipliers
    complementarity = multipliers * slack
    parts = (np.abs(stationarity), np.maximum(-slack, 0.0), np.abs(complementarity))
    return float(max(part.max(initial=0.0) for part in parts) / max(1.0, np.abs(s).max()))


def _exact_bounds(theta: FloatArray, active: BoolArray, inequalities: Inequalities) -> FloatArray:
    """Set parameters that rest on a bound of their own to the bound, bit for bit."""
    theta = theta.copy()
    for i in np.flatnonzero(active):
        columns = np.flatnonzero(inequalities.matrix[i])
        if len(columns) == 1:
            theta[columns[0]] = inequalities.bound[i] / inequalities.matrix[i, columns[0]] + 0.0
    return theta
