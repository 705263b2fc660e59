# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A cheap function in place of the field computation, and how well it tells unseen designs.

Candidates are polynomials of first and second order by least squares, and radial basis functions
(scipy's RBFInterpolator, thin plates with a linear part, smoothed); the one with the smallest
cross-validated error is taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray, IntArray

    Model = Callable[[FloatArray], FloatArray]

_PARTS = 10  # of the designs, each left out once
_SMOOTHING = 1e-2  # of values with a scatter of 1: figures come in steps of a control sample [1]
_SPARE = 1.3  # designs over the coefficients that a polynomial needs at least [1]


@dataclass(frozen=True, slots=True)
class Surrogate:
    """A model of one figure.

    Attributes
    ----------
    kind : str
        Which.
    model : callable
        Takes (N, D) points in the unit cube, returns (N,) values.
    parts : tuple of callable
        The same fitted without a part of the designs each.
    error : float
        Root mean square of what it misses of designs left out [unit of the figure].
    told : float
        Share of the variance of designs left out that it tells, 1 = all [1].
    """

    kind: str
    model: Model
    parts: tuple[Model, ...]
    error: float
    told: float


def fit_surrogate(points: FloatArray, values: FloatArray, seed: int = 0) -> Surrogate:
    """Fit the model that tells designs left out best.

    Parameters
    ----------
    points : (N, D) array
        In the unit cube [1].
    values : (N,) array
        Of a figure, not all the same [its unit].
    seed : int
        Of the parts that are left out.
    """
    count, wide = points.shape
    kinds: dict[str, Callable[[FloatArray, FloatArray], Model]] = {"linear": _linear}
    smallest = count - -(-count // _PARTS)
    if smallest >= _SPARE * (wide + 1) * (wide + 2) / 2:
        kinds["quadratic"] = _quadratic
    if smallest > wide + 1:
        kinds["radial basis"] = _radial
    order = np.random.default_rng(seed).permutation(count)
    parts = np.array_split(order, min(_PARTS, count))
    tried = [_validated(kind, fit, points, values, parts) for kind, fit in kinds.items()]
    return min(tried, key=lambda of: of.error)


def _validated(
    kind: str,
    fit: Callable[[FloatArray, FloatArray], Model],
    points: FloatArray,
    values: FloatArray,
    parts: list[IntArray],
) -> Surrogate:
    missed, models = np.empty(len(values)), []
    for part in parts:
        kept = np.ones(len(values), dtype=np.bool_)
        kept[part] = False
        model = fit(points[kept], values[kept])
        missed[part] = values[part] - model(points[part])
        models.append(model)
    square = float(np.mean(missed**2))
    told = 1.0 - square / float(np.var(values))
    return Surrogate(kind, fit(points, values), tuple(models), square**0.5, told)


def _linear(points: FloatArray, values: FloatArray) -> Model:
    return _polynomial(points, values, _first_order)


def _quadratic(points: FloatArray, values: FloatArray) -> Model:
    return _polynomial(points, values, _second_order)


def _polynomial(
    points: FloatArray, values: FloatArray, terms: Callable[[FloatArray], FloatArray]
) -> Model:
    best = np.linalg.lstsq(terms(points), values, rcond=None)[0]

    def model(at: FloatArray) -> FloatArray:
        found: FloatArray = terms(at) @ best
        return found

    return model


def _first_order(points: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(points)), 2.0 * points - 1.0])


def _second_order(points: FloatArray) -> FloatArray:
    x = 2.0 * points - 1.0
    one, two = np.triu_indices(points.shape[1])
    return np.column_stack([np.ones(len(points)), x, x[:, one] * x[:, two]])


def _radial(points: FloatArray, values: FloatArray) -> Model:
    from scipy.interpolate import RBFInterpolator

    middle, scatter = float(values.mean()), float(values.std()) or 1.0
    found = RBFInterpolator(
        points, (values - middle) / scatter, smoothing=_SMOOTHING, kernel="thin_plate_spline",
        degree=1,
    )  # fmt: skip

    def model(at: FloatArray) -> FloatArray:
        told: FloatArray = middle + scatter * found(at)
        return told

    return model
