# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which parameters a record determines singly, and which only in combination (a ridge).

A fit whose parameters run away together (stiffness and damping of a valve whose record shows
their ratio only) still ends somewhere, with values that mean nothing. The sensitivities at that
place show: in units of the noise and of the size of each parameter, a singular value s says that
the data know its direction within 1/s. What a weak direction carries is refused; what is
orthogonal to it is the combination that the data do determine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_LINKED = 0.05
"""Share of two parameters in the same weak directions that makes them one ridge, assumed."""

_SHOWN = 0.02
"""Exponents below are not written."""

_ROUNDING = 2.0
"""A combination may lose this factor of precision to exponents that are easy to read, assumed."""

_LOST = 0.01
"""And so much of its size [1], assumed."""

_READABLE = (1.0, 2.0, 3.0)
"""Denominators of exponents that are easy to read."""

_ALIKE = 0.99  # shares of a weak direction that count as equal
_TINY = 1e-14  # relative size of what is rounding only
_EXACT = 1e-12  # least noise relative to the sensitivities: exact data are not infinitely sharp
_SMALLEST = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True)
class IdentifiabilityOptions:
    """When a parameter counts as not identified.

    Attributes
    ----------
    max_error : float
        Largest standard error, relative to the size of the parameter [1], assumed.
    """

    max_error: float = 0.5


@dataclass(frozen=True, slots=True)
class Combination:
    """What the data determine of the parameters of a ridge.

    Attributes
    ----------
    names : tuple of str
        Its parameters.
    exponents : tuple of float
        The combination is the product of their powers; where a parameter may be zero or negative
        the sum of their multiples [unit of the first].
    value, relative_error : float
        Its value, and its standard error relative to that [1].
    text : str
        The combination as it is written, such as "stiffness/damping".
    """

    names: tuple[str, ...]
    exponents: tuple[float, ...]
    value: float
    relative_error: float
    text: str


@dataclass(frozen=True, slots=True)
class Identifiability:
    """What a record determines of P parameters.

    Attributes
    ----------
    errors : (P,) array
        Standard error relative to the size of each parameter, all others unknown [1]; infinite
        where it has no effect.
    identified : (P,) bool array
        Whether the parameter may be published.
    reasons : tuple of str
        Why not; empty where it may.
    combinations : tuple of Combination
        What is known of those that may not.
    condition_number : float
        Of the column-scaled sensitivities of the parameters with an effect [1].
    ridges : tuple of tuple of str
        Parameters that cannot be distinguished, ridge by ridge.
    """

    errors: FloatArray
    identified: BoolArray
    reasons: tuple[str, ...]
    combinations: tuple[Combination, ...]
    condition_number: float
    ridges: tuple[tuple[str, ...], ...] = ()

    @property
    def reason(self) -> str:
        """Say in one line what is refused and what is known instead; empty where nothing is."""
        return "; ".join(dict.fromkeys(r for r in self.reasons if r))


def assess_identifiability(
    names: Sequence[str],
    values: FloatArray,
    sensitivity: FloatArray,
    sigma: float,
    *,
    sizes: FloatArray | None = None,
    options: IdentifiabilityOptions | None = None,
) -> Identifiability:
    """Tell identified parameters from those of which only a combination is known.

    Parameters
    ----------
    names : sequence of str
        P names.
    values : (P,) array
        Where the fit ended [unit of each].
    sensitivity : (N, P) array
        Derivative of the N residuals by each parameter there; or a root of their information,
        `information_root`.
    sigma : float
        Standard deviation of one residual [unit of the residuals]; larger where residuals are
        autocorrelated.
    sizes : (P,) array, optional
        What counts as the size of each parameter [its unit]; |value| where omitted. To be given
        where a parameter may be zero.
    options : IdentifiabilityOptions, optional
        Limits.
    """
    limit = (options or IdentifiabilityOptions()).max_error
    size = np.abs(values) if sizes is None else np.asarray(sizes, np.float64)
    raw = sensitivity * size
    if not np.isfinite(raw).all():
        raw = np.nan_to_num(raw)
    scaled = raw / max(sigma, _EXACT * float(np.max(np.abs(raw), initial=0.0)), _SMALLEST)
    alone = np.sqrt(np.sum(scaled**2, axis=0))
    excited = np.flatnonzero(alone * limit > 1.0)
    errors = 1.0 / np.maximum(alone, _SMALLEST)
    errors[excited] = _errors(scaled[:, excited])
    errors[alone == 0.0] = np.inf
    seen = set(excited.tolist())
    reasons = [
        "" if k in seen else f"{name} has no effect above the noise"
        for k, name in enumerate(names)
    ]
    powers = sizes is None and bool(np.all(values[excited] > 0.0))
    fit = _Fit(tuple(names), values, size, scaled, excited, limit, powers)
    combinations: list[Combination] = []
    ridges: list[tuple[str, ...]] = []
    for group in _ridges(fit, excited[errors[excited] > limit]):
        if len(group) == 1:
            reasons[group[0]] = f"{names[group[0]]} is known to {errors[group[0]]:.0%} only"
            continue
        own = fit.combinations(group)
        combinations.extend(own)
        known = ", ".join(_described(c) for c in own) or "no combination either"
        ridges.append(tuple(names[k] for k in group))
        listed = " and ".join(ridges[-1])
        for k in group:
            reasons[k] = f"{listed} are not told apart; known: {known}"
    return Identifiability(
        errors,
        np.array([not r for r in reasons]),
        tuple(reasons),
        tuple(combinations),
        _condition(scaled[:, excited] / alone[excited]),
        tuple(ridges),
    )


def information_root(information: FloatArray) -> FloatArray:
    """Return a (P, P) array whose columns have the (P, P) scalar products `information`.

    It stands for the sensitivities where only their normal equations were summed up. Columns are
    scaled first, so that a weak parameter does not drown in the rounding of a strong one.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    safe = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(safe, safe))
    root: FloatArray = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * scale
    return root


@dataclass(frozen=True, slots=True)
class _Fit:
    """One fit in units of its noise and of the size of each parameter."""

    names: tuple[str, ...]
    values: FloatArray
    size: FloatArray
    scaled: FloatArray
    excited: IntArray
    limit: float
    powers: bool

    def split(self, members: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the (R, G) root of the information of G members, all others unknown, too.

        And their (W, G) weak directions, which the data do not determine.
        """
        others = np.setdiff1d(self.excited, members)
        ordered = self.scaled[:, np.concatenate([others, members])]
        padding = np.zeros((max(ordered.shape[1] - len(ordered), 0), ordered.shape[1]))
        full = _triangle(np.vstack([ordered, padding]))
        root = full[len(others) :, len(others) :]
        _, singular, directions = np.linalg.svd(root)
        return root, directions[singular * self.limit <= 1.0]

    def combinations(self, group: IntArray) -> list[Combination]:
        """Return what is known of the parameters of one ridge."""
        root, weak = self.split(group)
        return [
            self.combination(group, exponents, _error_of(root, exponents))
            for exponents in _known(root, weak, self.limit)
        ]

    def combination(self, group: IntArray, exponents: FloatArray, error: float) -> Combination:
        """Return one combination with its value and its text."""
        kept = np.abs(exponents) >= _SHOWN
        index, exponents = group[kept], exponents[kept]
        names = [self.names[k] for k in index]
        if self.powers:
            value = float(np.exp(exponents @ np.log(self.values[index])))
            text = _product(names, exponents)
        else:
            weights = exponents * (self.size[index[0]] / self.size[index])
            value = float(weights @ self.values[index])
            error *= float(self.size[index[0]]) / max(abs(value), _SMALLEST)
            text = _sum(names, weights)
            exponents = weights
        return Combination(tuple(names), tuple(exponents.tolist()), value, error, text)


def _errors(scaled: FloatArray) -> FloatArray:
    """Return the standard error of each of P scaled parameters, all of them unknown."""
    if not scaled.shape[1]:
        return np.zeros(0)
    _, singular, directions = np.linalg.svd(_triangle(scaled))
    if len(singular) < len(directions):
        singular = np.append(singular, np.zeros(len(directions) - len(singular)))
    floor = np.maximum(singular, _TINY * singular[0])
    return np.asarray(np.sqrt(np.sum((directions / floor[:, None]) ** 2, axis=0)))


def _triangle(matrix: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(matrix, mode="r"), np.float64)


def _ridges(fit: _Fit, refused: IntArray) -> list[IntArray]:
    """Return the parameters of each ridge: those that share weak directions."""
    if not len(refused):
        return []
    weak = fit.split(refused)[1]
    share = np.abs(weak.T @ weak)
    own = np.sqrt(np.maximum(np.diag(share), _SMALLEST))
    linked = share > _LINKED * np.outer(own, own)
    linked |= np.eye(len(refused), dtype=np.bool_)
    for _ in refused:
        linked = linked @ linked
    return [refused[list(row)] for row in dict.fromkeys(tuple(row) for row in linked)]


def _known(root: FloatArray, weak: FloatArray, limit: float) -> list[FloatArray]:
    """Return exponents (G,) of independent combinations that the data determine, easy to read.

    Each has a parameter of its own with exponent 1 and as many further ones as there are weak
    directions; where such a one is too uncertain, the directions of the information itself.
    """
    size = root.shape[1]
    if not len(weak) or len(weak) == size:
        return []
    pivots = _pivots(weak)
    found = []
    for k in np.setdiff1d(np.arange(size), pivots):
        exponents = np.zeros(size)
        exponents[k] = 1.0
        exponents[pivots] = -np.linalg.solve(weak[:, pivots], weak[:, k])
        found.append(_rounded(root, exponents, limit))
    if all(_error_of(root, e) <= limit for e in found):
        return found
    _, singular, directions = np.linalg.svd(root)
    strong = directions[singular * limit > 1.0]
    return [_rounded(root, d / d[np.argmax(np.abs(d))], limit) for d in strong]


def _pivots(weak: FloatArray) -> IntArray:
    """Return the parameters that carry the (W, G) weak directions; of equal ones the last."""
    left, pivots = weak.copy(), []
    for _ in range(len(weak)):
        carried = np.sum(left**2, axis=0)
        k = int(np.flatnonzero(carried > _ALIKE * np.max(carried))[-1])
        pivots.append(k)
        unit = left[:, k] / np.linalg.norm(left[:, k])
        left = left - np.outer(unit, unit @ left)
    return np.array(sorted(pivots))


def _rounded(root: FloatArray, exponents: FloatArray, limit: float) -> FloatArray:
    """Return exponents that are easy to read where that costs little precision."""
    error = _error_of(root, exponents)
    for steps in _READABLE:
        near = np.round(exponents * steps) / steps
        if near.any() and _error_of(root, near) <= min(_ROUNDING * error + _LOST, limit):
            return np.asarray(near)
    return exponents


def _error_of(root: FloatArray, exponents: FloatArray) -> float:
    """Return the standard error of a combination of scaled parameters; root is (R, G)."""
    _, singular, directions = np.linalg.svd(root)
    along = directions @ exponents
    if not singular[0] > 0.0:
        return float("inf")
    along[np.abs(along) < _TINY * np.max(np.abs(exponents))] = 0.0
    return float(np.linalg.norm(along / np.maximum(singular, _TINY * singular[0])))


def _product(names: Sequence[str], exponents: FloatArray) -> str:
    over = [_power(n, e) for n, e in zip(names, exponents, strict=True) if e > 0.0]
    under = [_power(n, -e) for n, e in zip(names, exponents, strict=True) if e < 0.0]
    below = f"({'*'.join(under)})" if len(under) > 1 else "".join(under)
    return f"{'*'.join(over) or '1'}/{below}" if under else "*".join(over)


def _power(name: str, exponent: float) -> str:
    return name if exponent == 1.0 else f"{name}^{exponent:.3g}"


def _sum(names: Sequence[str], weights: FloatArray) -> str:
    terms = (f"{w:+.3g}*{n}" for n, w in zip(names, weights, strict=True))
    return " ".join(terms).lstrip("+")


def _described(c: Combination) -> str:
    return f"{c.text} = {c.value:.4g} +- {c.relative_error:.1%}"


def _condition(columns: FloatArray) -> float:
    if not columns.shape[1]:
        return float("nan")
    singular = np.linalg.svd(columns, compute_uv=False)
    return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")
