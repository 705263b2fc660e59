# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bounded nonlinear least squares by Levenberg-Marquardt, and the scaling that its steps need.

Columns of the sensitivities J differ by many orders (seconds, metres, counts), so every matrix is
scaled to a unit diagonal before it is solved or judged.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import BoolArray, FloatArray

    Limits: TypeAlias = tuple[FloatArray, FloatArray]

_SMALL = 1e-10  # relative change of parameters or cost that ends a search [1]
_DAMPING, _DAMPING_UP, _DAMPING_DOWN, _DAMPING_MAX = 1e-3, 4.0, 0.25, 1e12
_TINY = 1e-300


class Minimum(NamedTuple):
    """Where a search ended: parameters (P,), sum of squared residuals and J^T J (P, P) there."""

    parameters: FloatArray
    cost: float
    gram: FloatArray


def minimise(
    normal_equations: Callable[[FloatArray], tuple[float, FloatArray, FloatArray]],
    start: FloatArray,
    limits: Limits,
    *,
    iterations: int,
) -> Minimum:
    """Find the least sum of squared residuals r = measured - simulated inside bounds.

    What rests on a bound and pulls outwards is held there; a parameter without any effect keeps
    its value.

    Parameters
    ----------
    normal_equations : callable
        Of the parameters (P,): the sum of squares, J^T r (P,) and J^T J (P, P) with the
        derivative J of what is simulated.
    start : (P,) array
        Where the search begins, clipped to the bounds [units of the caller].
    limits : tuple of (P,) arrays
        Lower and upper bounds.
    iterations : int
        Most steps tried.
    """
    p = np.clip(start, *limits)
    cost, gradient, gram = normal_equations(p)
    damping = _DAMPING
    for _ in range(iterations):
        on = np.flatnonzero(free_inside(p, gradient, limits) & (np.diag(gram) > 0.0))
        step = np.zeros(len(p))
        step[on] = damped_step(gram[np.ix_(on, on)], gradient[on], damping)
        trial = np.clip(p + step, *limits)
        if np.all(np.abs(trial - p) <= _SMALL * (np.abs(p) + _SMALL)):
            break
        there = normal_equations(trial)
        if there[0] < cost:
            gained = cost - there[0]
            p, (cost, gradient, gram), damping = trial, there, damping * _DAMPING_DOWN
            if gained <= _SMALL * cost:
                break
        else:
            damping *= _DAMPING_UP
            if damping > _DAMPING_MAX:
                break
    return Minimum(p, cost, gram)


def minimise_residuals(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    limits: Limits,
    *,
    steps: FloatArray,
    iterations: int,
) -> Minimum:
    """Find the least sum of squared residuals whose derivatives are differences.

    Parameters
    ----------
    residuals : callable
        Of the parameters (P,): simulated - measured or the reverse (N,).
    start : (P,) array
        Where the search begins, clipped to the bounds [units of the caller].
    limits : tuple of (P,) arrays
        Lower and upper bounds.
    steps : (P,) array
        Of the differences [units of the caller].
    iterations : int
        Most steps tried.
    """

    def normal_equations(p: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        r, j = sensitivities(residuals, p, limits, steps)
        return float(r @ r), -(j.T @ r), j.T @ j

    return minimise(normal_equations, start, limits, iterations=iterations)


def sensitivities(
    residuals: Callable[[FloatArray], FloatArray], p: FloatArray, limits: Limits, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return residuals (N,) and their derivatives (N, P), differences that stay inside the bounds.

    Parameters
    ----------
    residuals : callable
        Of the parameters (P,): simulated - measured or the reverse (N,).
    p : (P,) array
        Where [units of the caller].
    limits : tuple of (P,) arrays
        Lower and upper bounds.
    steps : (P,) array
        Of the differences [units of the caller].
    """
    at, columns = residuals(p), []
    for i, step in enumerate(steps):
        moved = p.copy()
        inside = step if p[i] + step <= limits[1][i] else -step
        moved[i] += inside
        columns.append((residuals(moved) - at) / inside)
    return at, np.stack(columns, axis=1)


def free_inside(p: FloatArray, gradient: FloatArray, limits: Limits) -> BoolArray:
    """Return which parameters (P,) no bound holds.

    Parameters
    ----------
    p, gradient : (P,) arrays
        Parameters [units of the caller] and J^T r there, along which the cost falls [any].
    limits : tuple of (P,) arrays
        Lower and upper bounds.
    """
    held = ((p <= limits[0]) & (gradient < 0.0)) | ((p >= limits[1]) & (gradient > 0.0))
    return np.asarray(~held)


def damped_step(gram: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    """Return the step (P,) of Levenberg and Marquardt.

    Parameters
    ----------
    gram, gradient : (P, P), (P,) arrays
        J^T J and J^T r [any, of the same residual].
    damping : float
        Added to the unit diagonal of the scaled matrix [1].
    """
    scaled, root = unit_diagonal(gram)
    step = np.linalg.solve(scaled + damping * np.eye(len(root)), gradient / root) / root
    return np.asarray(step)


def unit_diagonal(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return J^T J (P, P) scaled to a unit diagonal, and the norms of the columns of J (P,)."""
    root = np.sqrt(np.maximum(np.diag(gram), _TINY))
    return gram / np.outer(root, root), root


def gram_condition(gram: FloatArray) -> float:
    """Return the condition number of the column-scaled sensitivities from J^T J (P, P) [1].

    What has no effect at all is left out; NaN where nothing has. It saturates near 1e8.
    """
    seen = np.diag(gram) > 0.0
    if not seen.any():
        return float("nan")
    return float(np.sqrt(np.linalg.cond(unit_diagonal(gram[np.ix_(seen, seen)])[0])))


def column_condition(jacobian: FloatArray, without_effect: float = np.inf) -> float:
    """Return the condition number of column-scaled sensitivities (N, P) [1].

    `without_effect` where a parameter has none.
    """
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    return float(np.linalg.cond(jacobian / scale)) if (scale > 0.0).all() else without_effect
