# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A stored reference of features: where they lie, and how they scatter within and between valves.

A product has a centre of its own. The scatter within a valve is that about the valve's own line:
aging is none. What valves of one kind differ by is told by few of them, so that it counts wider
(`spread`), and never less than they scatter themselves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.features import LENGTHS, ROOTS
from valve_twin.core.diagnosis.products import products
from valve_twin.core.estimation.data.robust import MAD_SCALE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

FEATURE_VERSION = 2
"""What the features of a cycle mean: raised when one of them is computed otherwise."""

PREFIX = "reference."
"""With what the names of the parameters of a valve's own first model begin."""

FEWEST = 8
"""Fewest cycles of a valve, of one product, that a reference is made of."""

BLOCK = 4
"""Cycles whose mean is held against that of the next."""

_ALIKE = 0.01
"""Share by which a cycle may last longer or shorter than those of its product, assumed [1]."""

_CLIPPED = 4.0
_TAIL, _TAIL_DEVIATIONS = 0.9, 1.645


@dataclass(frozen=True, slots=True)
class Level:
    """What one valve showed of one product.

    Attributes
    ----------
    valve : str
        Its name.
    first, last, cycles : int
        Numbers of its first and last cycle that was taken, and how many there were.
    values : tuple of float
        (F,) mean of each feature as it is followed; NaN = never shown.
    moved : tuple of float
        (F,) by how much each moved on its line from the first to the last [as followed].
    """

    valve: str
    first: int
    last: int
    cycles: int
    values: tuple[float, ...]
    moved: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Product:
    """What all valves showed of one product.

    Attributes
    ----------
    shortest_s, longest_s : float
        Durations of its cycles [s].
    levels : tuple of Level
        One a valve.
    """

    shortest_s: float
    longest_s: float
    levels: tuple[Level, ...]

    @property
    def centre(self) -> FloatArray:
        """Mean of the valves, (F,); NaN where none shows the feature."""
        return _mean(np.array([x.values for x in self.levels]))

    def makes(self, duration_s: FloatArray) -> BoolArray:
        """Return which cycles are of this product by their durations [s], (N,)."""
        low, high = (1.0 - _ALIKE) * self.shortest_s, (1.0 + _ALIKE) * self.longest_s
        return np.asarray((duration_s >= low) & (duration_s <= high), dtype=np.bool_)


@dataclass(frozen=True, slots=True)
class FeatureReference:
    """A stored reference.

    Attributes
    ----------
    name : str
        The file that it came from.
    model : str
        Name of the valves' model.
    version : int
        As `FEATURE_VERSION`.
    features : tuple of str
        Names of the F features.
    period_s : float
        Sampling time of the position [s].
    within : tuple of tuple of float
        (F, F) covariance of a cycle about the line of its valve [as followed].
    strays : tuple of float
        (F,) standard deviation of the mean of some cycles beyond what they scatter one by one:
        a sensor that wanders, a machine that warms up [as followed].
    products : tuple of Product
        Each with a centre of its own.
    models : tuple of (str, tuple of float)
        Of features of any valve: parameters of the valves' own first models, one a valve.
    span : float
        What lengths among the features are shares of; NaN = not known [unit of the position].
    """

    name: str
    model: str
    version: int
    features: tuple[str, ...]
    period_s: float
    within: tuple[tuple[float, ...], ...]
    strays: tuple[float, ...]
    products: tuple[Product, ...]
    models: tuple[tuple[str, tuple[float, ...]], ...] = ()
    span: float = math.nan

    @property
    def valves(self) -> tuple[str, ...]:
        """Names of the valves."""
        return tuple(dict.fromkeys(x.valve for p in self.products for x in p.levels))

    @property
    def cycles(self) -> int:
        """Cycles that it is made of."""
        return sum(x.cycles for p in self.products for x in p.levels)

    @property
    def text(self) -> str:
        """The file, how many valves and cycles it is made of."""
        return f"the stored reference {self.name} ({self.made_of})"

    @property
    def made_of(self) -> str:
        """How many valves and cycles it is made of."""
        count = len(self.valves)
        valves = "1 valve" if count == 1 else f"{count} valves"
        return f"{valves}, {self.cycles} cycles"

    def offsets(self) -> FloatArray:
        """Return what each valve lies off the centres of its products, (V, F)."""
        off = [np.array([x.values for x in p.levels]) - p.centre for p in self.products]
        names = np.array([x.valve for p in self.products for x in p.levels])
        whole = np.concatenate(off)
        return np.array([_mean(whole[names == v]) for v in self.valves])

    def moved(self) -> FloatArray:
        """Return the root of the mean square by which features moved on their lines, (F,)."""
        each = np.array([x.moved for p in self.products for x in p.levels])
        return np.asarray(np.sqrt(np.nan_to_num(_mean(each**2))))

    def between(self) -> FloatArray:
        """Return the standard deviation between valves, (F,); NaN where no two show a feature."""
        off = self.offsets()
        known = np.count_nonzero(np.isfinite(off), axis=0)
        square = np.nansum(off**2, axis=0) / np.maximum(known - 1, 1)
        return np.where(known > 1, np.sqrt(square), np.nan)

    def over(self, span: float) -> FeatureReference:
        """Return it with lengths as shares of another span, as they are where one is not known.

        Parameters
        ----------
        span : float
            That of a valve [unit of the position].
        """
        scale, shift = _rescaled(self.features, self.span, span)
        within = np.array(self.within) * np.outer(scale, scale)
        products_ = tuple(
            replace(p, levels=tuple(_level_over(x, scale, shift) for x in p.levels))
            for p in self.products
        )
        return replace(
            self,
            within=tuple(tuple(map(float, row)) for row in within),
            strays=tuple(map(float, scale * np.array(self.strays))),
            products=products_,
            span=span,
        )


def _level_over(level: Level, scale: FloatArray, shift: FloatArray) -> Level:
    values = scale * np.array(level.values) + shift
    moved = scale * np.array(level.moved)
    return replace(level, values=tuple(map(float, values)), moved=tuple(map(float, moved)))


def _rescaled(features: Sequence[str], span: float, other: float) -> tuple[FloatArray, FloatArray]:
    """Return what turns shares of a span into those of another, as followed: factor, summand."""
    ratio = span / other
    if not math.isfinite(ratio) or ratio <= 0.0:
        ratio = 1.0
    lengths = [n in LENGTHS and n not in ROOTS for n in features]
    roots = [n in ROOTS for n in features]  # these are followed as logarithms
    return np.where(lengths, ratio, 1.0), np.where(roots, math.log(ratio), 0.0)


@dataclass(frozen=True, slots=True)
class Seen:
    """The cycles of one valve that a reference is made of.

    Attributes
    ----------
    valve : str
        Its name.
    cycles : (N,) int64 array
        Their numbers.
    duration_s : (N,) array
        Their durations [s].
    vectors : (N, F) array
        Their features [as followed].
    span : float
        What lengths among these are shares of; NaN = not known [unit of the position].
    """

    valve: str
    cycles: IntArray
    duration_s: FloatArray
    vectors: FloatArray
    span: float = math.nan


def make_reference(
    seen: Sequence[Seen],
    *,
    name: str,
    model: str,
    features: tuple[str, ...],
    period_s: float,
    models: Sequence[Mapping[str, float]] = (),
) -> FeatureReference:
    """Make a reference of the features of some valves.

    Parameters
    ----------
    seen : sequence of Seen
        A valve each.
    name, model, features
        As of `FeatureReference`.
    period_s : float
        Sampling time of the position [s].
    models : sequence of mapping
        Parameters of the valves' own first models, by name; empty where there are none.

    Raises
    ------
    ValueError
        If no product was made `FEWEST` times by a valve.
    """
    span = next((s.span for s in seen if math.isfinite(s.span)), math.nan)
    seen = [_seen_over(s, features, span) for s in seen]
    of = products(np.concatenate([s.duration_s for s in seen]))
    edges = np.cumsum([0, *(len(s.cycles) for s in seen)])
    duration = np.concatenate([s.duration_s for s in seen])
    made: list[Product] = []
    left: list[FloatArray] = []
    whole: list[FloatArray] = []
    for number in sorted(set(of.tolist()) - {-1}):
        levels = []
        for k, one in enumerate(seen):
            rows = np.flatnonzero(of[edges[k] : edges[k + 1]] == number)
            if len(rows) >= FEWEST:
                level, off = _level(one, rows)
                levels.append(level)
                left.append(off)
                whole.append(one.vectors[rows])
        if levels:
            own = duration[of == number]
            made.append(Product(float(own.min()), float(own.max()), tuple(levels)))
    if not made:
        most = max((len(s.cycles) for s in seen), default=0)
        msg = f"no product was made {FEWEST} times by one valve in the {most} cycles taken"
        raise ValueError(msg)
    freedom = sum(len(off) - 2 for off in left)
    within = _within(np.concatenate(left), freedom)
    strays = tuple(map(float, _strays(whole, np.diag(within))))
    rows_ = tuple(tuple(float(v) for v in row) for row in within)
    names = sorted({n for m in models for n in m})
    kept = tuple((n, tuple(m.get(n, float("nan")) for m in models)) for n in names)
    return FeatureReference(
        name, model, FEATURE_VERSION, features, period_s, rows_, strays, tuple(made), kept, span
    )


def _seen_over(one: Seen, features: Sequence[str], span: float) -> Seen:
    """Return the cycles of a valve with lengths as shares of another span."""
    scale, shift = _rescaled(features, one.span, span)
    return replace(one, vectors=scale * one.vectors + shift)


def _level(one: Seen, rows: IntArray) -> tuple[Level, FloatArray]:
    """Return the level of a valve in some of its cycles, and what these are off its line."""
    y = one.vectors[rows]
    t = rows - rows.mean()
    off, moved = np.full(y.shape, np.nan), np.full(y.shape[1], np.nan)
    for j in range(y.shape[1]):
        known = np.isfinite(y[:, j])
        if np.count_nonzero(known) >= FEWEST // 2:
            slope, at = np.polyfit(t[known], y[known, j], 1)
            off[known, j] = y[known, j] - at - slope * t[known]
            moved[j] = slope * (t[-1] - t[0])
    values = np.where(np.isfinite(moved), _mean(y), np.nan)
    number = one.cycles[rows]
    return (
        Level(
            one.valve,
            int(number[0]),
            int(number[-1]),
            len(rows),
            tuple(map(float, values)),
            tuple(map(float, moved)),
        ),
        off,
    )


def _within(off: FloatArray, freedom: int) -> FloatArray:
    """Return the (F, F) covariance of what cycles are off by, single outliers cut."""
    size = np.abs(off)
    with np.errstate(invalid="ignore"):
        spread = MAD_SCALE * np.nanmedian(
            np.where(np.isfinite(size).any(axis=0), size, 0.0), axis=0
        )
        tail = np.nanquantile(np.where(np.isfinite(size).any(axis=0), size, 0.0), _TAIL, axis=0)
    spread = np.maximum(spread, tail / _TAIL_DEVIATIONS)
    off = np.where(spread > 0.0, np.clip(off, -_CLIPPED * spread, _CLIPPED * spread), off)
    share = np.isfinite(off).mean(axis=0)
    full = np.nan_to_num(off)
    scale = np.sqrt(np.maximum(share, 1e-12))
    return np.asarray(full.T @ full / np.outer(scale, scale) / freedom, dtype=np.float64)


def _strays(parts: Sequence[FloatArray], variance: FloatArray) -> FloatArray:
    """Return by how much means of neighbouring cycles differ beyond their scatter, (F,)."""
    steps = []
    for y in parts:
        means = [_mean(y[k : k + BLOCK]) for k in range(0, len(y) - BLOCK + 1, BLOCK)]
        steps += [b - a for a, b in pairwise(means)]
    square = np.nan_to_num(_mean(np.array(steps) ** 2)) / 2.0
    return np.asarray(np.sqrt(np.maximum(square - variance / BLOCK, 0.0)))


def _mean(rows: FloatArray) -> FloatArray:
    """Return the mean of what (N, F) rows show, (F,); NaN where none shows it."""
    known = np.isfinite(rows)
    count = np.count_nonzero(known, axis=0)
    total = np.where(known, rows, 0.0).sum(axis=0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
