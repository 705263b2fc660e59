# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nonlinear least squares over several curves with shared and local parameters.

What paper 001, section 4.3 does in a plotting program: one function, several measured curves,
parameters that all curves share and others that each curve has for itself, by Levenberg-Marquardt
(eq. (4.2)) or by a trust region with bounds, judged by R-square (eqs. (4.5)-(4.7)).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

CurveFunction = Callable[["FloatArray", "FloatArray"], "FloatArray"]
"""Maps abscissae (N,) or (N, D) and parameters (P,) to ordinates (N,)."""

_DIFFERENCE = np.finfo(np.float64).eps ** 0.2
"""Relative step of the four-point derivative: its error is about eps^0.8."""

_TOLERANCE = 1e-15
_EVALUATIONS = 20_000
_STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))
_SINGULAR = 1e-13


class Method(Enum):
    """How the minimum is searched."""

    LEVENBERG_MARQUARDT = "lm"
    TRUST_REGION = "trf"


class FitStatus(Enum):
    """Whether the parameters may be used."""

    OK = "converged, every parameter inside its bounds"
    AT_BOUND = "a parameter rests on a bound: standard errors are those of the others"
    NOT_IDENTIFIED = "the curves do not determine every parameter"
    NOT_CONVERGED = "no minimum was found"


@dataclass(frozen=True, slots=True)
class FitParameter:
    """One parameter to fit.

    Attributes
    ----------
    name : str
        Its name, unique.
    start : float
        Where the search starts.
    lower, upper : float
        Bounds; infinite where there is none.
    local : bool
        Whether each curve has a value of its own.
    """

    name: str
    start: float
    lower: float = -np.inf
    upper: float = np.inf
    local: bool = False

    def __post_init__(self) -> None:
        """Refuse a start that is no number or lies outside the bounds."""
        if not (np.isfinite(self.start) and self.lower <= self.start <= self.upper):
            message = (
                f"{self.name} starts at {self.start!r}: must be a number from "
                f"{self.lower:g} to {self.upper:g}"
            )
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class Curve:
    """One measured curve.

    Attributes
    ----------
    x : (N,) or (N, D) array
        Abscissae.
    y : (N,) array
        Measured ordinates.
    sigma : float
        Standard deviation of one ordinate, where curves of different worth are fitted together.
    """

    x: FloatArray
    y: FloatArray
    sigma: float = 1.0

    def __post_init__(self) -> None:
        """Refuse curves that cannot be fitted."""
        if len(self.x) != len(self.y) or len(self.y) == 0:
            message = f"a curve has {len(self.x)} abscissae and {len(self.y)} ordinates"
            raise ValueError(message)
        if not (np.isfinite(self.x).all() and np.isfinite(self.y).all()):
            message = "a curve holds values that are not finite"
            raise ValueError(message)
        if not (np.isfinite(self.sigma) and self.sigma > 0.0):
            message = f"sigma = {self.sigma!r}: must be a number above 0"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class CurveFit:
    """Fitted parameters and what is known about them.

    A local parameter `p` of curve 2 is named `p[2]`, counted from 0.

    Attributes
    ----------
    names : tuple of str
        Names of the P values: shared ones first, then the local ones curve by curve.
    values, standard_errors : (P,) arrays
        Estimates; errors are NaN where a parameter rests on a bound or is not identified.
    covariance : (P, P) array
        Covariance scaled with the reduced chi-square.
    residual_sum : float
        Weighted sum of squared residuals.
    reduced_chi_square : float
        `residual_sum` over the degrees of freedom.
    r_square, adjusted_r_square : float
        Share of the scatter about the mean of all curves that is explained (paper 001, eq. (4.7)).
    freedom : int
        Degrees of freedom.
    evaluations : int
        Evaluations of the residuals, derivatives not counted.
    status : FitStatus
        Whether the parameters may be used.
    """

    names: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    covariance: FloatArray
    residual_sum: float
    reduced_chi_square: float
    r_square: float
    adjusted_r_square: float
    freedom: int
    evaluations: int
    status: FitStatus

    def value(self, name: str) -> float:
        """Return a value by its name."""
        return float(self.values[self.names.index(name)])

    def standard_error(self, name: str) -> float:
        """Return a standard error by its name."""
        return float(self.standard_errors[self.names.index(name)])


def fit_curves(
    function: CurveFunction,
    curves: Sequence[Curve],
    parameters: Sequence[FitParameter],
    *,
    method: Method = Method.TRUST_REGION,
) -> CurveFit:
    """Fit one function to several curves at once.

    By SciPy, which scales by the sensitivities on its way: `minimise` ended far higher in 2 of 141
    fits of the tests.

    Parameters
    ----------
    function : callable
        `function(x, p)` with `p` (len(parameters),) in the order of `parameters`.
    curves : sequence of Curve
        At least one.
    parameters : sequence of FitParameter
        Shared and local parameters.
    method : Method
        Levenberg-Marquardt takes no bounds.

    Returns
    -------
    CurveFit
        Never raises for data that do not determine the parameters: see its status.

    Raises
    ------
    ValueError
        If there are fewer ordinates than parameters, a name stands twice, or
        Levenberg-Marquardt is asked to keep bounds.
    """
    problem = _Problem(function, tuple(curves), tuple(parameters))
    problem.check(method)
    from scipy.optimize import least_squares  # slow to import

    lower, upper = problem.bounds()
    found = least_squares(
        problem.residuals,
        problem.start(),
        problem.jacobian,
        bounds=(lower, upper) if method is Method.TRUST_REGION else (-np.inf, np.inf),
        method=method.value,
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_EVALUATIONS,
    )
    return _judged(problem, np.asarray(found.x), int(found.nfev), converged=found.status > 0)


@dataclass(frozen=True, slots=True)
class _Problem:
    """Residuals of all curves as a function of one vector: shared values, then local ones."""

    function: CurveFunction
    curves: tuple[Curve, ...]
    parameters: tuple[FitParameter, ...]

    def check(self, method: Method) -> None:
        names = [p.name for p in self.parameters]
        if len(set(names)) != len(names) or not names:
            message = f"parameters {', '.join(names)}: each name must stand once, at least one"
            raise ValueError(message)
        ordinates = sum(len(c.y) for c in self.curves)
        if ordinates < len(self.names()):
            message = f"{ordinates} ordinates cannot determine {len(self.names())} parameters"
            raise ValueError(message)
        bounded = any(np.isfinite([p.lower, p.upper]).any() for p in self.parameters)
        if method is Method.LEVENBERG_MARQUARDT and bounded:
            message = "Levenberg-Marquardt keeps no bounds: fit with Method.TRUST_REGION"
            raise ValueError(message)

    def _order(self) -> list[tuple[FitParameter, int]]:
        shared = [(p, -1) for p in self.parameters if not p.local]
        local = [(p, k) for k in range(len(self.curves)) for p in self.parameters if p.local]
        return shared + local

    def names(self) -> tuple[str, ...]:
        return tuple(p.name if k < 0 else f"{p.name}[{k}]" for p, k in self._order())

    def start(self) -> FloatArray:
        return np.array([p.start for p, _ in self._order()])

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        order = self._order()
        return np.array([p.lower for p, _ in order]), np.array([p.upper for p, _ in order])

    def columns(self, curve: int) -> list[int]:
        """Return where each parameter of a curve stands in the vector."""
        names = self.names()
        return [names.index(f"{p.name}[{curve}]" if p.local else p.name) for p in self.parameters]

    def residuals(self, vector: FloatArray) -> FloatArray:
        parts = [
            (c.y - self.function(c.x, vector[self.columns(k)])) / c.sigma
            for k, c in enumerate(self.curves)
        ]
        return np.concatenate(parts)

    def jacobian(self, vector: FloatArray) -> FloatArray:
        """Return the derivative of the residuals by four-point differences inside the bounds."""
        lower, upper = self.bounds()
        columns = []
        for j, value in enumerate(vector):
            step = _DIFFERENCE * max(abs(value), _DIFFERENCE)
            room = min(value - lower[j], upper[j] - value)
            if room < 2.0 * step:
                columns.append(self._one_sided(vector, j, step, value - lower[j] <= step * 2.0))
                continue
            total = np.zeros(0)
            for place, weight in _STENCIL:
                moved = vector.copy()
                moved[j] = value + place * step
                part = weight * self.residuals(moved)
                total = part if len(total) == 0 else total + part
            columns.append(total / (12.0 * step))
        return np.column_stack(columns)

    def _one_sided(self, vector: FloatArray, j: int, step: float, upwards: bool) -> FloatArray:
        sign = step if upwards else -step
        near, far = vector.copy(), vector.copy()
        near[j] += sign
        far[j] += 2.0 * sign
        here = self.residuals(vector)
        slope: FloatArray = (4.0 * self.residuals(near) - self.residuals(far) - 3.0 * here) / (
            2.0 * sign
        )
        return slope


def _judged(
    problem: _Problem, vector: FloatArray, evaluations: int, *, converged: bool
) -> CurveFit:
    residuals = problem.residuals(vector)
    count, size = len(residuals), len(vector)
    freedom = count - size
    total = float(residuals @ residuals)
    chi_square = total / freedom if freedom > 0 else float("nan")
    lower, upper = problem.bounds()
    free = (vector > lower) & (vector < upper)
    covariance, identified = _covariance(problem.jacobian(vector), free, chi_square)
    weighted = np.concatenate([c.y / c.sigma for c in problem.curves])
    ones = np.concatenate([np.full(len(c.y), 1.0 / c.sigma) for c in problem.curves])
    mean = float(weighted @ ones / (ones @ ones))
    scatter = float(np.sum((weighted - mean * ones) ** 2))
    r_square = 1.0 - total / scatter if scatter > 0.0 else float("nan")
    adjusted = 1.0 - chi_square / (scatter / (count - 1)) if scatter > 0.0 else float("nan")
    status = FitStatus.OK if free.all() else FitStatus.AT_BOUND
    if not identified:
        status = FitStatus.NOT_IDENTIFIED
    if not converged:
        status = FitStatus.NOT_CONVERGED
    return CurveFit(
        names=problem.names(),
        values=vector,
        standard_errors=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        residual_sum=total,
        reduced_chi_square=chi_square,
        r_square=r_square,
        adjusted_r_square=adjusted,
        freedom=freedom,
        evaluations=evaluations,
        status=status,
    )


def _covariance(
    jacobian: FloatArray, free: np.typing.NDArray[np.bool_], chi_square: float
) -> tuple[FloatArray, bool]:
    """Return the covariance, NaN where nothing is known, and whether all of it is known."""
    size = jacobian.shape[1]
    covariance = np.full((size, size), np.nan)
    columns = jacobian[:, free]
    scale = np.sqrt(np.sum(columns**2, axis=0))
    if columns.shape[1] == 0:
        return covariance, True
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        return covariance, False
    _, singular, rows = np.linalg.svd(columns / scale, full_matrices=False)
    if singular[-1] <= _SINGULAR * singular[0]:
        return covariance, False
    root = rows.T / singular
    covariance[np.ix_(free, free)] = chi_square * (root @ root.T) / np.outer(scale, scale)
    return covariance, True
