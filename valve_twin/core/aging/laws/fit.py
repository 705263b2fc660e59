# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fit every shape of the laws of aging (`core.aging.laws.shapes`) and weigh it by its evidence."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.laws.ar1 import ar1_forms, ar1_product, shape_weights
from valve_twin.core.aging.laws.shapes import (
    LEAST,
    TEMPER,
    LawFit,
    condense,
    curves,
    grid,
    squares,
    whitened,
)
from valve_twin.core.aging.trend import RESOLUTION, TINY, Base, base_of, pooled_autocorrelation
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, IntArray

_CONCENTRATED = 0.3  # share of a law's evidence in one shape that asks for a finer grid
_BETWEEN, _REFINEMENTS = 9, 4  # shapes put between three neighbours, rounds of it
_ROUNDS = 3  # of the search for the one shape that leaves least
_LAWS = 4


@dataclass(frozen=True, slots=True)
class _Shapes:
    """Shapes with their curves (K, N), their fits as `_squares` returns them, and evidence."""

    law: IntArray
    number: FloatArray
    prior: FloatArray
    curves: FloatArray
    fits: FloatArray
    score: FloatArray

    def part(self, kept: IntArray) -> _Shapes:
        """Return some of the shapes."""
        return _Shapes(*(getattr(self, f.name)[kept] for f in fields(self)))

    def joined(self, other: _Shapes) -> _Shapes:
        """Return the shapes of both."""
        names = [f.name for f in fields(self)]
        return _Shapes(*(np.concatenate([getattr(self, n), getattr(other, n)]) for n in names))

    @property
    def weight(self) -> FloatArray:
        """Return the evidence, which sums to 1, (K,) [1]."""
        return _evidence(self.score)


def _evidence(score: FloatArray) -> FloatArray:
    """Return (K,) scores as evidence that sums to 1 [1]."""
    weight = np.exp(score - score.max())
    return np.asarray(weight / weight.sum())


@dataclass(frozen=True, slots=True)
class _Data:
    """Values (N,) over u (N,), with the autocorrelation and the rounding of their scatter.

    Where a base is fitted beside, it is taken out of the values already.
    """

    u: FloatArray
    y: FloatArray
    rho: float
    floor: float
    base: Base | None = None

    def bare(self, law: IntArray, number: FloatArray) -> FloatArray:
        """Return the curves of shapes as they are fitted, (K, N)."""
        g = curves(law, number, self.u)
        return g if self.base is None else self.base.without(g)

    def shapes(
        self,
        law: IntArray,
        number: FloatArray,
        prior: FloatArray,
        known: tuple[FloatArray, FloatArray] | None = None,
    ) -> _Shapes:
        """Return shapes with their evidence; `known` are their curves and fits."""
        g, fits = known or (self.bare(law, number), None)
        taken = 2 if self.base is None else 1 + self.base.columns.shape[1]
        if fits is None:
            fits = squares(g, self.y, np.empty(len(self.y)))
        white = whitened(g, self.y, fits, self.rho)
        score = np.log(prior) - 0.5 * TEMPER * (
            np.log(white[:, 1]) + (len(self.y) - taken) * np.log(white[:, 0] + self.floor)
        )
        return _Shapes(law, number, prior, g, fits, score)


@lru_cache(maxsize=4)
def _curves_of_grid(laws: tuple[str, ...], places: bytes) -> FloatArray:
    """Return the curves of every shape of some laws (K, N): parameters of a valve share places."""
    law, number, _ = grid(laws)
    return curves(law, number, np.array(np.frombuffer(places)))


@njit(cache=True)
def _sharpest(laws: IntArray, law: int, number: FloatArray, weight: FloatArray) -> IntArray:
    """Return the shape of a law that alone has its evidence, and its neighbours; empty = none."""
    total, count, best = 0.0, 0, -1
    for i in range(len(laws)):
        if laws[i] == law:
            total, count = total + weight[i], count + 1
            if best < 0 or weight[i] > weight[best]:
                best = i
    none = np.empty(0, np.int64)
    if count < 3 or total < LEAST or weight[best] < _CONCENTRATED * total:
        return none
    low, high = -1, -1
    for i in range(len(laws)):
        if laws[i] == law and number[i] < number[best] and (low < 0 or number[i] > number[low]):
            low = i
        if laws[i] == law and number[i] > number[best] and (high < 0 or number[i] < number[high]):
            high = i
    near = np.array([low, best, high])
    return near[near >= 0]


def _refined(shapes: _Shapes, data: _Data) -> _Shapes:
    """Put more shapes between those of a law of which one alone has the evidence."""
    weight = shapes.weight
    for law in range(1, _LAWS):
        for _ in range(_REFINEMENTS):
            near = _sharpest(shapes.law, law, shapes.number, weight)
            if not len(near):
                break
            ends = np.log(shapes.number[near[[0, -1]]])
            number = np.exp(np.linspace(ends[0], ends[1], _BETWEEN))
            prior = np.full(_BETWEEN, shapes.prior[near].sum() / _BETWEEN)
            fresh = data.shapes(np.full(_BETWEEN, law), number, prior)
            others = np.ones(len(shapes.law), np.bool_)
            others[near] = False
            shapes = shapes.part(np.flatnonzero(others)).joined(fresh)
            weight = shapes.weight
    return shapes


def fit_laws(
    x: FloatArray,
    y: FloatArray,
    laws: Sequence[str] = (),
    *,
    autocorrelation: float | None = None,
    offsets: FloatArray | None = None,
) -> LawFit:
    """Fit all shapes to one undisturbed stretch and keep those that the data allow.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit], strictly increasing, and values [unit]; N >= 4. More than
        `MOST` should be condensed before.
    laws : sequence of str
        Values of `Law` that are allowed; empty = all.
    autocorrelation : float, optional
        Lag-1 autocorrelation of the scatter [1]; of the best shape's residuals where not given.
    offsets : (N, Z) array, optional
        Columns that are fitted beside every shape; the level is the one without them [1].

    Returns
    -------
    LawFit
        Evidence and fit of every shape that counts.
    """
    n = len(x)
    law, number, prior = grid(laws)
    step = (x[-1] - x[0]) / (n - 1)
    start, length = float(x[0] - step), float(x[-1] - x[0] + step)
    u = (x - start) / length
    base = None if offsets is None else base_of(offsets)
    extra = 0 if offsets is None else offsets.shape[1]
    free = y if base is None else base.without(y)
    floor = n * (RESOLUTION * float(np.abs(y).max())) ** 2 + TINY
    data, rest = _Data(u, free, 0.0, floor, base), np.empty(n)
    bare = _curves_of_grid(tuple(laws), u.tobytes())
    bare = bare if base is None else base.without(bare)
    fitted = squares(bare, free, rest)
    if autocorrelation is None:
        autocorrelation = pooled_autocorrelation([rest])
    used = max(autocorrelation, 0.0)
    data = replace(data, rho=used)
    shapes = _refined(data.shapes(law, number, prior, (bare, fitted)), data)
    weight = shapes.weight
    line = float(weight[shapes.law == 0].sum())
    rising = np.argsort(weight, kind="stable")
    kept = np.sort(rising[np.cumsum(weight[rising]) > LEAST])
    law, number, fits = shapes.law[kept], shapes.number[kept], shapes.fits[kept]
    if base is None:
        level_weights, change_weights = np.empty((2, len(kept), n))
        forms = shape_weights(shapes.curves, kept, fits, used, level_weights, change_weights)
        one = np.full(n, 1.0 / n)
        taken = n * ar1_product(one, one, used)
    else:
        change_weights = (shapes.curves[kept] - fits[:, :1]) / fits[:, 1:2]
        shape = curves(law, number, u)
        level_weights = base.level + (shape[:, -1:] - shape @ base.level[:, None]) * change_weights
        taken = base.share(used)
        forms = ar1_forms(level_weights, change_weights, used)
    lost = taken + fits[:, 1] * forms[2]
    variance = (fits[:, 3] + floor) / np.maximum(n - lost, 0.5)
    return LawFit(
        start=start,
        length=length,
        law=law,
        number=number,
        weight=_evidence(shapes.score[kept]),
        level=level_weights @ y,
        change=fits[:, 2],
        level_weights=level_weights,
        change_weights=change_weights,
        values=y,
        sigma=np.sqrt(variance),
        autocorrelation=autocorrelation,
        freedom=max(n * (1.0 - used) / (1.0 + used) - 2.0 - extra, 1.0),
        line=line,
        forms=forms,
    )


def law_shape(x: FloatArray, y: FloatArray, laws: Sequence[str] = ()) -> tuple[FloatArray, bool]:
    """Return the shape that leaves least, and whether it is another than the line.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit], strictly increasing, and values [unit].
    laws : sequence of str
        Values of `Law` that are allowed; empty = all.

    Returns
    -------
    (N,) array
        The shape at x [1].
    bool
        Whether it bends.
    """
    law, number, _ = grid(laws)
    place, values = condense(x, y)
    step = (x[-1] - x[0]) / (len(x) - 1)
    start, length = x[0] - step, x[-1] - x[0] + step
    u, rest = (place - start) / length, np.empty(len(place))
    best = int(np.argmin(squares(curves(law, number, u), values, rest)[:, 3]))
    one = law[best : best + 1]
    if one[0] == 0:
        return (x - start) / length, False
    near = number[law == one[0]]
    at = int(np.flatnonzero(near == number[best])[0])
    for _ in range(_ROUNDS):
        ends = np.log([near[max(at - 1, 0)], near[min(at + 1, len(near) - 1)]])
        near = np.exp(np.linspace(ends[0], ends[1], _BETWEEN))
        every = np.repeat(one, _BETWEEN)
        at = int(np.argmin(squares(curves(every, near, u), values, rest)[:, 3]))
    return curves(one, near[at : at + 1], (x - start) / length)[0], True
