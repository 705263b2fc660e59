# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The paper's estimators: least squares and sign-constrained QP on the equation error (paper 002).

They reproduce the paper. Position noise biases them (equations.md 2.6): the one-step error of a
noisy position is a moving average that correlates with the speed, th1 -> (th1 S - 3 sigma^2)/(S +
2 sigma^2), and the constraint clips that bias. Only the gains survive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.kernels import count_masked
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import (
    EstimateStatus,
    FloatArray,
    Frames,
    IntArray,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
)
from valve_twin.core.valves.press_cartridge.estimation.constraints import (
    THETA,
    Inequalities,
    no_inequalities,
    physical_inequalities,
)
from valve_twin.core.valves.press_cartridge.estimation.excitation import (
    Excitation,
    GuardOptions,
    assess_input,
    independent_terms,
    term_reasons,
)
from valve_twin.core.valves.press_cartridge.estimation.qp import (
    QpSolution,
    column_condition,
    solve_qp,
    solve_qp_cvxpy,
    unsolved,
)
from valve_twin.core.valves.press_cartridge.estimation.regression import (
    TERMS,
    Gram,
    design,
    gram,
    mean_square_error,
    usable_rows,
)
from valve_twin.core.valves.press_cartridge.estimators import EQUATION_ERROR

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks

MIN_ROWS_PER_TERM = 3
"""Fewest rows for each fitted term [1]."""


@dataclass(frozen=True, slots=True)
class EquationErrorOptions:
    """How the equation error is fitted.

    Attributes
    ----------
    v_in_max, v_out_max : float
        Greatest commands, where the extended constraints hold [1].
    extended : bool
        With the constraints that the paper lacks (equations.md 2.2(7)).
    constraints : Inequalities or None
        Further linear inequalities over theta_1 ... theta_8.
    keep_stale : bool
        Use repeated values as if measured, as the paper does.
    solver : str
        "exact", or "cvxpy" for the reference.
    guard : GuardOptions
        When a parameter is refused.
    """

    v_in_max: float = 1.0
    v_out_max: float = 1.0
    extended: bool = True
    constraints: Inequalities | None = None
    keep_stale: bool = True
    solver: str = "exact"
    guard: GuardOptions = field(default_factory=GuardOptions)


@dataclass(frozen=True, slots=True)
class EquationErrorFit:
    """What one equation error estimator says about a cycle.

    Attributes
    ----------
    estimator : str
        Its name.
    lag : int
        Lag used [samples].
    parameters : tuple of ParameterValue
        The terms of its set, in the order of the paper; standard errors NaN (not calibrated).
    status, reason : EstimateStatus, str
        Whether it may be used, and why in one line.
    theta : (8,) array
        theta_1 ... theta_8 with zero where a term is not in the set or not excited; NaN where
        refused.
    mse : float
        Mean squared one-step error over the rows used (paper 002, eq. (24)) [1].
    condition_number : float
        Of the column-scaled regressor of the fitted terms [1].
    counts : MaskCounts
        Rows used and samples masked.
    inflow, outflow : Excitation or None
        What the commands did; None where there were too few rows.
    """

    estimator: str
    lag: int
    parameters: tuple[ParameterValue, ...]
    status: EstimateStatus
    reason: str
    theta: FloatArray
    mse: float
    condition_number: float
    counts: MaskCounts
    inflow: Excitation | None = None
    outflow: Excitation | None = None


def kind_and_terms(name: str) -> tuple[str, tuple[int, ...]]:
    """Return ("ls" or "qp", terms) of an estimator name.

    Raises
    ------
    ValueError
        There is no such estimator; the message lists them.
    """
    if name not in EQUATION_ERROR:
        msg = f"estimator {name!r} is not known; choose one of {', '.join(EQUATION_ERROR)}"
        raise ValueError(msg)
    return EQUATION_ERROR[name]


def fit_equation_error(
    frames: Frames,
    masks: Masks,
    estimator: str,
    *,
    lag: int,
    noise_sigma: float = float("nan"),
    options: EquationErrorOptions | None = None,
) -> EquationErrorFit:
    """Fit the regression of paper 002 to one cycle, with or without its constraints.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    estimator : str
        One of `EQUATION_ERROR`.
    lag : int
        Command to position lag [samples]; negative = unknown, then the fit is refused.
    noise_sigma : float
        Position noise at rest [1]; NaN = unknown.
    options : EquationErrorOptions, optional
        Constraints, solver and limits.

    Returns
    -------
    EquationErrorFit
        A cycle that cannot be used is a value with its reason, never an exception.

    Raises
    ------
    ValueError
        The estimator or the solver is not known.
    """
    options = options or EquationErrorOptions()
    kind, terms = kind_and_terms(estimator)
    if options.solver not in ("exact", "cvxpy"):
        msg = f"solver {options.solver!r} is not known; choose exact or cvxpy"
        raise ValueError(msg)
    if lag < 0:
        unknown = Refusal(RefusalCode.LAG_UNKNOWN, "the lag is not known")
        return _refused(estimator, terms, lag, _counts(masks, 0), unknown)
    rows = usable_rows(frames, masks, lag, keep_stale=options.keep_stale)
    need = MIN_ROWS_PER_TERM * len(terms)
    if len(rows) < need:
        text = f"{len(rows)} usable rows of {len(frames)} samples, {need} needed"
        reason = Refusal(RefusalCode.FEW_SAMPLES, text)
        return _refused(estimator, terms, lag, _counts(masks, len(rows)), reason)
    inflow, outflow = (
        assess_input(frames, rows, lag, k, noise_sigma=noise_sigma, options=options.guard)
        for k in (0, 1)
    )
    problem = _pose(frames, rows, lag, terms, inflow, outflow, kind, options)
    solution = _solve(frames, rows, lag, problem, options.solver)
    counts = _counts(masks, len(rows))
    if not solution.solved:
        fit = _refused(estimator, terms, lag, counts, solution.reason)
        return replace(fit, inflow=inflow, outflow=outflow)
    theta = np.zeros(TERMS)
    theta[np.asarray(problem.fitted) - 1] = solution.theta
    parameters = _values(terms, theta, problem, solution)
    return EquationErrorFit(
        estimator,
        lag,
        parameters,
        *_verdict(parameters),
        theta,
        mean_square_error(frames, rows, lag, theta),
        column_condition(problem.gram),
        counts,
        inflow,
        outflow,
    )


@dataclass(frozen=True, slots=True)
class _Problem:
    """What is fitted: terms, normal equations, inequalities; why others are left out."""

    fitted: tuple[int, ...]
    gram: Gram
    limits: Inequalities
    reasons: tuple[str, ...]


def _pose(
    frames: Frames,
    rows: IntArray,
    lag: int,
    terms: tuple[int, ...],
    inflow: Excitation,
    outflow: Excitation,
    kind: str,
    options: EquationErrorOptions,
) -> _Problem:
    """Leave out the terms that the cycle does not excite."""
    full = gram(frames, rows, lag)
    reasons = term_reasons(inflow, outflow, full)
    excited = [term for term in terms if not reasons[term - 1]]
    fitted = independent_terms(full, excited, options.guard.max_condition)
    if len(fitted) < reasons.count(""):
        reasons = tuple(
            why or ("" if k + 1 in fitted else "not independent of the other terms")
            for k, why in enumerate(reasons)
        )
    return _Problem(fitted, full.part(fitted), _limits(kind, options, fitted), reasons)


def _limits(kind: str, options: EquationErrorOptions, terms: tuple[int, ...]) -> Inequalities:
    """Inequalities over the fitted terms: none for least squares."""
    columns = tuple(term - 1 for term in terms)
    if kind == "ls":
        return no_inequalities().part(columns)
    if options.constraints is None:
        return _physical_part(options.v_in_max, options.v_out_max, options.extended, columns)
    limits = physical_inequalities(
        v_in_max=options.v_in_max, v_out_max=options.v_out_max, extended=options.extended
    )
    return (limits + options.constraints).part(columns)


@lru_cache(maxsize=256)
def _physical_part(
    v_in_max: float, v_out_max: float, extended: bool, columns: tuple[int, ...]
) -> Inequalities:
    limits = physical_inequalities(v_in_max=v_in_max, v_out_max=v_out_max, extended=extended)
    return limits.part(columns)


def _solve(frames: Frames, rows: IntArray, lag: int, problem: _Problem, solver: str) -> QpSolution:
    """Solve with the chosen solver; unsolved without a moving spool."""
    if 1 not in problem.fitted or len(problem.fitted) < 2:
        text = problem.reasons[0] or "only one term is excited"
        return unsolved(problem.limits, Refusal(RefusalCode.NOT_EXCITED, text))
    if solver == "cvxpy":
        u, y = design(frames, rows, lag)
        return solve_qp_cvxpy(u[:, np.asarray(problem.fitted) - 1], y, problem.limits)
    return solve_qp(problem.gram, problem.limits)


def _values(
    terms: tuple[int, ...], theta: FloatArray, problem: _Problem, solution: QpSolution
) -> tuple[ParameterValue, ...]:
    """Return the parameters: not excited, on a bound (which), or free."""
    limits, values = problem.limits, theta.tolist()
    active = solution.active.nonzero()[0]
    on: dict[int, list[str]] = {}
    which, columns = limits.matrix[active].nonzero()
    for i, column in zip(active[which].tolist(), columns.tolist(), strict=True):
        on.setdefault(problem.fitted[column], []).append(limits.labels[i])
    found = []
    for term in terms:
        name, why = THETA[term - 1], problem.reasons[term - 1]
        if why:
            found.append(_not_excited(name, why))
        elif term in on:
            reason = f"rests on {', '.join(on[term])}"
            at_bound = ParameterStatus.AT_BOUND
            found.append(ParameterValue(name, values[term - 1], at_bound, reason))
        else:
            found.append(ParameterValue(name, values[term - 1]))
    return tuple(found)


@lru_cache(maxsize=256)
def _not_excited(name: str, why: str) -> ParameterValue:
    return ParameterValue(name, math.nan, ParameterStatus.NOT_EXCITED, why)


def _verdict(parameters: tuple[ParameterValue, ...]) -> tuple[EstimateStatus, str]:
    """Status of the whole fit from those of its parameters."""
    missing = [p.name for p in parameters if p.status is ParameterStatus.NOT_EXCITED]
    bound = [p.name for p in parameters if p.status is ParameterStatus.AT_BOUND]
    parts = []
    if missing:
        parts.append(f"not excited: {', '.join(missing)}")
    if bound:
        parts.append(f"at bound: {', '.join(bound)}")
    status = EstimateStatus.PARTIAL if parts else EstimateStatus.ACCEPTED
    return status, "; ".join(parts) or "all parameters free and excited"


def _counts(masks: Masks, used: int) -> MaskCounts:
    """Rows used and samples masked."""
    flags = (masks.seat, masks.stuck, masks.stale, masks.bad, masks.gap)
    return MaskCounts(used, *count_masked(*flags))


def _refused(
    estimator: str, terms: tuple[int, ...], lag: int, counts: MaskCounts, reason: str
) -> EquationErrorFit:
    """Return a fit without values."""
    nothing = float("nan")
    parameters = tuple(
        ParameterValue(THETA[term - 1], nothing, ParameterStatus.REFUSED, reason) for term in terms
    )
    return EquationErrorFit(
        estimator,
        lag,
        parameters,
        EstimateStatus.REFUSED,
        reason,
        np.full(TERMS, nothing),
        nothing,
        nothing,
        counts,
    )
