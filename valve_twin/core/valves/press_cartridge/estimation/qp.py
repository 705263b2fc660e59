# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Least squares under linear inequalities: min |u theta - y|^2, A theta <= b (paper 002, (22)).

`solve_qp` works on the normal equations with columns of unit length, until the Karush-Kuhn-Tucker
conditions hold to rounding and bounds are met bit for bit. A compiled solver answers; what it
cannot verify goes to the general path. A column without excitation keeps its parameter at zero
unless an inequality forbids it. `solve_qp_cvxpy` states the same problem in cvxpy, as the
reference in cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.solvers.eigenvalues import extreme_eigenvalues
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.valves.press_cartridge.estimation.solvers.active_set import (
    ACTIVE,
    QuadraticProgram,
    kkt_residual,
    minimise,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.small_qp import SOLVED, solve_small

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.constraints import Inequalities
    from valve_twin.core.valves.press_cartridge.estimation.regression import Gram

KKT_TOLERANCE = 1e-10
"""Largest Karush-Kuhn-Tucker residual of a solution in scaled variables [1]."""

VERIFIED = 1e-12
"""Largest residual with which the compiled solution is taken [1]."""

_RANK = 1e-12  # eigenvalue that counts as zero: scaled columns 1e-6 apart are equal [1]


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


def quadratic_cost(gram: Gram, theta: FloatArray) -> float:
    """Return the sum of squared errors [1] of some parameters from the normal equations."""
    return float(gram.power - 2.0 * gram.vector @ theta + theta @ gram.matrix @ theta)


def column_condition(gram: Gram) -> float:
    """Return the condition number of the regressor, its excited columns of unit length [1].

    From the normal equations, so it saturates near 1e8; infinite where columns depend on each
    other.
    """
    least, greatest = extreme_eigenvalues(np.array(gram.matrix, order="C"))
    return float(np.sqrt(greatest / least)) if least > 0.0 else float("inf")


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
    return _solve_compiled(gram, inequalities) or solve_qp_general(gram, inequalities)


def _solve_compiled(gram: Gram, inequalities: Inequalities) -> QpSolution | None:
    """Solve by the compiled path; None where its conditions do not hold to rounding."""
    m, k = inequalities.matrix.shape
    theta, active = np.empty(k), np.empty(m, np.bool_)
    # copies: one layout, writable, so that one specialisation of the kernel serves all
    found, cost, kkt = solve_small(
        np.array(gram.matrix, order="C"),
        gram.vector,
        float(gram.power),
        np.array(inequalities.matrix, order="C"),
        np.array(inequalities.bound),
        theta,
        active,
    )
    if found == SOLVED and kkt <= VERIFIED:
        return QpSolution(theta, active, cost, kkt, True)
    return None


def solve_qp_general(gram: Gram, inequalities: Inequalities) -> QpSolution:
    """Solve as `solve_qp` does, by the slower path that refuses nothing."""
    unit = _unit(gram)
    problem = _scale(gram, inequalities, unit)
    if problem is None:
        return unsolved(inequalities, _never_holds(inequalities))
    optimum = minimise(problem)
    if optimum is None:
        return unsolved(inequalities, "the constraints contradict each other")
    s, multipliers = optimum
    kkt = kkt_residual(problem, s, multipliers)
    active = (multipliers > 0.0) | (problem.a @ s - problem.b >= -ACTIVE)
    shut = (np.diag(problem.g) == 0.0) & (np.abs(s) <= ACTIVE)
    theta = _exact_bounds(np.where(shut, 0.0, s / unit), active, inequalities)
    solved = kkt <= KKT_TOLERANCE
    text = f"the solver stopped at a residual of {kkt:.1e}"
    reason = "" if solved else Refusal(RefusalCode.NO_CONVERGENCE, text)
    return QpSolution(theta, active, quadratic_cost(gram, theta), kkt, solved, reason)


def solve_qp_cvxpy(u: FloatArray, y: FloatArray, inequalities: Inequalities) -> QpSolution:
    """Solve the same problem stated in cvxpy, from the regression rows (the paper used CVX).

    Parameters
    ----------
    u : (R, K) array
        Regressor [1].
    y : (R,) array
        Right-hand side [1].
    inequalities : Inequalities
        Over the K parameters.

    Returns
    -------
    QpSolution
        `active` within 1e-6 in scaled variables; `kkt` is NaN. Unsolved without cvxpy.
    """
    try:
        import cvxpy
    except ModuleNotFoundError:
        missing = "cvxpy is not installed: pip install valve_twin[cvxpy], or set solver to exact"
        return unsolved(inequalities, missing)
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
    rows = cvxpy.Constant(a / norm[:, None])
    limits = [rows @ s <= inequalities.bound / norm / size] if len(a) else []
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


def _unit(gram: Gram) -> FloatArray:
    """Scale of the parameters: columns and right-hand side of unit length."""
    length = np.sqrt(np.diag(gram.matrix))
    length[length == 0.0] = 1.0
    unit: FloatArray = length / (np.sqrt(gram.power) if gram.power > 0.0 else 1.0)
    return unit


def _scale(gram: Gram, inequalities: Inequalities, unit: FloatArray) -> QuadraticProgram | None:
    """State the problem in s = theta * unit; None where an inequality without terms is false."""
    a = inequalities.matrix / unit
    norm = np.linalg.norm(a, axis=1)
    if (inequalities.bound[norm == 0.0] < 0.0).any():
        return None
    norm[norm == 0.0] = 1.0
    power = gram.power if gram.power > 0.0 else 1.0
    g, f = gram.matrix / np.outer(unit, unit) / power, gram.vector / unit / power
    return QuadraticProgram(*_without_rounding(g, f), a / norm[:, None], inequalities.bound / norm)


def _without_rounding(g: FloatArray, f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Remove the directions in which the normal equations hold nothing but rounding."""
    eigen, vectors = np.linalg.eigh(g)
    lost = eigen < _RANK
    shut = np.diag(g) == 0.0
    if lost.sum() == shut.sum():
        return g, f
    kept = vectors[:, ~lost]
    kept[shut] = 0.0
    return (kept * eigen[~lost]) @ kept.T, kept @ (kept.T @ f)


def _exact_bounds(theta: FloatArray, active: BoolArray, inequalities: Inequalities) -> FloatArray:
    """Set parameters that rest on a bound of their own to the bound, bit for bit."""
    theta = theta.copy()
    for i in np.flatnonzero(active):
        columns = np.flatnonzero(inequalities.matrix[i])
        if len(columns) == 1:
            theta[columns[0]] = inequalities.bound[i] / inequalities.matrix[i, columns[0]] + 0.0
    return theta
