# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Laws of aging: a line, an exponential, a power and a saturating law, and what speaks for each.

Every law is y = level + change (g(u) - g(1)) with a shape g that runs from g(0) = 0 to g(1) = 1
over the history, u = 0 one cycle before its first value and u = 1 at its last:

    line          u
    exponential   (e^(k u) - 1)/(e^k - 1)
    power         u^p
    saturating    (1 - e^(-k u))/(1 - e^(-k))

Given the shape a law is linear in level and change, so that everything known of a line (least
squares, covariance under AR(1) scatter, Fieller's limits) holds for each. k and p are taken from a
grid: a law is as many shapes. The evidence of a shape is its marginal likelihood with level,
change and scatter integrated out under flat priors, the scatter being AR(1) with the
autocorrelation of the best shape,

    log w = log prior - s/2 (log |G' R^-1 G| + (n - 2) log S),

S the whitened residual sum of squares. s < 1 tempers the evidence, since the autocorrelation is
itself estimated. `PRIOR` and `TEMPER` were set with `core.aging.laws.study`, seeds 8000 and 8001.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.config import Law
from valve_twin.core.aging.laws.ar1 import ar1_forms, ar1_product
from valve_twin.core.aging.trend import Line
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, IntArray


PRIOR = {Law.LINE: 0.35, Law.EXPONENTIAL: 0.3, Law.POWER: 0.2, Law.SATURATING: 0.15}
"""Probability of each law before any value is seen, those of its shapes are alike [1]."""

TEMPER = 0.8
"""Power of the likelihood [1]; below 1 the estimated autocorrelation is allowed for."""

BENDS = 0.05
"""A trend bends where the line is less probable than this [1]."""

MOST = 500
"""Values that laws are fitted to; of more, means of equal blocks of neighbours are."""

_RATES = (0.25, 0.5, 0.8, 1.2, 1.7, 2.4, 3.2, 4.5, 6.5, 9.0)
_EXPONENTS = (0.3, 0.4, 0.5, 0.6, 0.75, 0.88, 1.2, 1.4, 1.7, 2.1, 2.6, 3.3, 4.2, 5.5)
_GRID = {
    Law.LINE: (0.0,),
    Law.EXPONENTIAL: _RATES,
    Law.POWER: _EXPONENTS,
    Law.SATURATING: _RATES,
}
_ORDER = tuple(Law)
LEAST = 3e-3
"""Evidence of all shapes that are left out together, of a law that is not refined [1]."""


@dataclass(frozen=True, slots=True)
class LawFit:
    """Shapes that the data allow, each fitted to one undisturbed stretch of a history.

    Attributes
    ----------
    start, length : float
        Axis position of u = 0 and length to u = 1 [axis unit].
    law : (K,) int64 array
        Place of each shape's law in `Law`.
    number : (K,) array
        Rate k or exponent p of each shape [1].
    weight : (K,) array
        Evidence, sums to 1 [1].
    level, change : (K,) arrays
        Value at u = 1 and difference between u = 1 and u = 0 [unit].
    level_weights, change_weights : (K, N) arrays
        Level and change are these times the values.
    values : (N,) array
        What was fitted to [unit].
    sigma : (K,) array
        Standard deviation of a single value about each shape [unit].
    autocorrelation, freedom : float
        Of the scatter about the best shape; degrees of freedom of Student's t [1].
    line : float
        Probability of the line [1].
    forms : (3, K) array, optional
        Variance of the level, its covariance with the change and the variance of that, in those
        of a single value [1].
    """

    start: float
    length: float
    law: IntArray
    number: FloatArray
    weight: FloatArray
    level: FloatArray
    change: FloatArray
    level_weights: FloatArray
    change_weights: FloatArray
    values: FloatArray
    sigma: FloatArray
    autocorrelation: float
    freedom: float
    line: float
    forms: FloatArray | None = None

    @property
    def best(self) -> int:
        """Return the place of the shape with the most evidence."""
        return int(np.argmax(self.weight))

    @property
    def bends(self) -> bool:
        """Whether the line is all but excluded."""
        return self.line < BENDS

    def probable(self) -> tuple[Law, float]:
        """Return the most probable law and its probability [1]."""
        each = np.bincount(self.law, self.weight, len(_ORDER))
        return _ORDER[int(np.argmax(each))], float(each.max())

    def alternatives(self, least: float) -> list[tuple[Law, float, int]]:
        """Return each law of `least` probability or more, with its probability and best shape."""
        found = []
        for place, law in enumerate(_ORDER):
            own = np.flatnonzero(self.law == place)
            share = float(self.weight[own].sum())
            if len(own) and share >= least:
                found.append((law, share, int(own[np.argmax(self.weight[own])])))
        return found

    def beyond(self, places: FloatArray) -> FloatArray:
        """Return g(u) - 1 of every shape at (M,) axis positions, (K, M)."""
        u = np.maximum((places - self.start) / self.length, 0.0)
        return np.asarray(curves(self.law, self.number, u) - 1.0)

    def covariances(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return var(level), cov(level, change) and var(change) of every shape, (K,) each."""
        forms = self.forms
        if forms is None:
            rho = max(self.autocorrelation, 0.0)
            forms = ar1_forms(self.level_weights, self.change_weights, rho)
        low, cross, high = self.sigma**2 * forms
        return low, cross, high

    def curve(self, places: FloatArray, shape: int) -> FloatArray:
        """Return one shape at (N,) axis positions [unit]."""
        return np.asarray(self.level[shape] + self.change[shape] * self.beyond(places)[shape])

    def average(self, place: float) -> FloatArray:
        """Return (N,) weights that give the mean of all shapes at a place, from the values."""
        each = self.level_weights + self.beyond(np.array([place])) * self.change_weights
        return np.asarray(self.weight @ each)

    def tangent(self, place: float, *, samples: int, sigma: float) -> Line:
        """Return the mean of all shapes near a place as a line, their differences as variance.

        Parameters
        ----------
        place : float
            Axis position [axis unit].
        samples : int
            Estimates in the stretch [1].
        sigma : float
            Standard deviation of a single estimate [unit].
        """
        rho, step = max(self.autocorrelation, 0.0), 1e-3 * self.length
        h = self.beyond(np.array([place - step, place]))
        level = self.level + self.change * h[:, 1]
        slope = self.change * (h[:, 1] - h[:, 0]) / step
        here = self.average(place)
        rise = (here - self.average(place - step)) / step
        mean, mean_slope = float(self.weight @ level), float(self.weight @ slope)
        d, e = level - mean, slope - mean_slope
        variance = self.variance
        return Line(
            samples=samples,
            center=place,
            mean=mean,
            slope=mean_slope,
            sigma=sigma,
            autocorrelation=self.autocorrelation,
            freedom=self.freedom,
            var_mean=variance * ar1_product(here, here, rho) + float(self.weight @ d**2),
            cov=variance * ar1_product(here, rise, rho) + float(self.weight @ (d * e)),
            var_slope=variance * ar1_product(rise, rise, rho) + float(self.weight @ e**2),
        )

    @property
    def variance(self) -> float:
        """Return the variance of a value about the shapes, their mean [unit^2]."""
        return float(self.weight @ self.sigma**2)


@njit(cache=True)
def curves(law: IntArray, number: FloatArray, u: FloatArray) -> FloatArray:
    """Return g of every shape at u, (K, N).

    Parameters
    ----------
    law : (K,) int64 array
        Places of the laws in `Law`.
    number : (K,) array
        Rate or exponent of each shape [1].
    u : (N,) array
        Places along the history [1].
    """
    out = np.empty((len(law), len(u)))
    logs = np.log(u)
    for i in range(len(law)):
        k = number[i]
        if law[i] == 0:
            out[i] = u
        elif law[i] == 2:
            for j in range(len(u)):
                out[i, j] = np.exp(k * logs[j])
        else:
            k = k if law[i] == 1 else -k
            whole = np.expm1(k)
            for j in range(len(u)):
                out[i, j] = (np.exp(min(k * u[j], 60.0)) - 1.0) / whole
    return out


@njit(cache=True)
def squares(g: FloatArray, y: FloatArray, rest: FloatArray) -> FloatArray:
    """Fit y by every row of g; return mean and square sum of g, change, residual square sum.

    Parameters
    ----------
    g : (K, N) array
        Shapes [1].
    y : (N,) array
        Values [unit].
    rest : (N,) array
        Takes the residuals of the best row [unit].
    """
    count, n = g.shape
    out = np.empty((count, 4))
    middle, low = y.mean(), np.inf
    for i in range(count):
        mean, square, product = g[i].mean(), 0.0, 0.0
        for j in range(n):
            d = g[i, j] - mean
            square += d * d
            product += d * (y[j] - middle)
        change = product / square
        power = 0.0
        for j in range(n):
            r = y[j] - middle - change * (g[i, j] - mean)
            power += r * r
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = mean, square, change, power
        if power < low:
            low = power
            for j in range(n):
                rest[j] = y[j] - middle - change * (g[i, j] - mean)
    return out


@njit(cache=True)
def whitened(g: FloatArray, y: FloatArray, fits: FloatArray, rho: float) -> FloatArray:
    """Return the whitened square sums of residual and shape of every row, (K, 2).

    Parameters
    ----------
    g : (K, N) array
        Shapes [1].
    y : (N,) array
        Values [unit].
    fits : (K, 4) array
        What `squares` returned.
    rho : float
        Lag-1 autocorrelation of the scatter [1].
    """
    count, n = g.shape
    out = np.empty((count, 2))
    middle, first = y.mean(), 1.0 - rho * rho
    for i in range(count):
        mean, change = fits[i, 0], fits[i, 2]
        d = g[i, 0] - mean
        r = y[0] - middle - change * d
        power, square = first * r * r, first * d * d
        for j in range(1, n):
            d_next = g[i, j] - mean
            r_next = y[j] - middle - change * d_next
            power += (r_next - rho * r) ** 2
            square += (d_next - rho * d) ** 2
            d, r = d_next, r_next
        out[i, 0], out[i, 1] = power, square
    return out


def grid(laws: Sequence[str]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return law, number and prior probability of every shape of the laws named, (K,) each."""
    return _grid(tuple(laws))


@cache
def _grid(laws: tuple[str, ...]) -> tuple[IntArray, FloatArray, FloatArray]:
    chosen = [law for law in _ORDER if law.value in laws or not laws]
    total = sum(PRIOR[law] for law in chosen)
    rows = [
        (_ORDER.index(law), number, PRIOR[law] / total / len(_GRID[law]))
        for law in chosen
        for number in _GRID[law]
    ]
    law, number, prior = zip(*rows, strict=True)
    return np.array(law, np.int64), np.array(number), np.array(prior)


def condense(x: FloatArray, y: FloatArray, most: int = MOST) -> tuple[FloatArray, FloatArray]:
    """Return means of equal blocks of neighbours; the values themselves where few enough.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit].
    most : int
        Blocks at most [1]; the oldest values that fill no block are left out.
    """
    size = -(-len(x) // most)
    if size < 2:
        return x, y
    count = len(x) // size
    part = slice(len(x) - count * size, None)
    return x[part].reshape(count, size).mean(axis=1), y[part].reshape(count, size).mean(axis=1)
