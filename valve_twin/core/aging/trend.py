# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A line through estimates of many cycles, with intervals that hold under autocorrelation.

The line is ordinary least squares: unbiased, and nearly efficient under AR(1) scatter. Its
covariance is sigma^2 (X'X)^-1 X' R X (X'X)^-1 with R[i, j] = rho^|i - j|. rho comes from the
residuals, corrected for the bias that detrending causes (Kendall 1954, Marriott and Pope 1954:
E[rho_hat] = rho - (2 + 4 rho)/n for one line), sigma^2 from the residual sum of squares divided
by its exact expectation for that rho. Student's t is taken with n_eff - 2 degrees of freedom,
n_eff = n (1 - rho)/(1 + rho). A negative rho is reported but not used: it would narrow the
intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.aging.laws.ar1 import ar1_product
from valve_twin.core.estimation.data.one_thread import dot
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

MAX_AUTOCORRELATION = 0.95
"""Largest lag-1 autocorrelation that is corrected for [1]; beyond it there is no line."""

RESOLUTION = 1e-9
"""Scatter below this part of the largest value is taken for rounding, not for signal [1]."""


TINY = float(np.finfo(np.float64).tiny)
"""Keeps what is divided by from being zero [1]."""

MAX_FACTOR = 100.0
"""Largest factor, up or down, that a product has on a level [1]: a leak was told 22 times as large
in one of two."""


@dataclass(frozen=True, slots=True)
class Base:
    """What is fitted beside a shape: a level, and offsets of unknown size.

    Attributes
    ----------
    columns : (N, B) array
        Orthonormal [1].
    level : (N,) array
        Weights of the values that give the level without the offsets [1].
    """

    columns: FloatArray
    level: FloatArray

    def without(self, values: FloatArray) -> FloatArray:
        """Return what is left of (..., N) values."""
        return np.asarray(values - (values @ self.columns) @ self.columns.T)

    def share(self, rho: float) -> float:
        """Return the variance, in those of a single value, that the fit of it takes away [1]."""
        return float(sum(ar1_product(c, c, rho) for c in np.ascontiguousarray(self.columns.T)))


def base_of(offsets: FloatArray) -> Base:
    """Return level and offsets (N, Z) as one base."""
    matrix = np.column_stack([np.ones(len(offsets)), offsets])
    columns = np.linalg.qr(matrix)[0]
    return Base(np.asarray(columns), np.ascontiguousarray(np.linalg.pinv(matrix)[0]))


@dataclass(frozen=True, slots=True)
class Line:
    """A fitted line and what is known about it.

    Attributes
    ----------
    samples : int
        Estimates in the fit.
    center : float
        Mean of the axis values [axis unit].
    mean, slope : float
        Fitted value at `center` [unit] and slope [unit / axis unit].
    sigma : float
        Standard deviation of a single estimate about the line [unit].
    autocorrelation : float
        Lag-1 autocorrelation of the residuals, bias corrected [1].
    freedom : float
        Degrees of freedom of Student's t, corrected for autocorrelation [1].
    var_mean, cov, var_slope : float
        Covariance of (mean, slope).
    """

    samples: int
    center: float
    mean: float
    slope: float
    sigma: float
    autocorrelation: float
    freedom: float
    var_mean: float
    cov: float
    var_slope: float

    def level(self, x: float) -> float:
        """Return the fitted value at axis position `x` [unit]."""
        return self.mean + self.slope * (x - self.center)

    def level_variance(self, x: float) -> float:
        """Return the variance of the fitted value at `x` [unit^2]."""
        d = x - self.center
        return max(self.var_mean + 2.0 * d * self.cov + d * d * self.var_slope, 0.0)

    def mean_interval(self, x: float, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval of the fitted value at `x` [unit]."""
        return self._around(self.level(x), self.level_variance(x), confidence)

    def prediction_interval(self, x: float, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval for one more estimate at `x` [unit]."""
        return self._around(self.level(x), self.level_variance(x) + self.sigma**2, confidence)

    def slope_interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval of the slope [unit / axis unit]."""
        return self._around(self.slope, self.var_slope, confidence)

    @property
    def p_value(self) -> float:
        """Two-sided probability of so steep a slope without any drift [1]."""
        if not self.var_slope > 0.0:
            return 1.0 if self.slope == 0.0 else 0.0
        from scipy.special import stdtr  # slow to import

        return float(2.0 * stdtr(self.freedom, -abs(self.slope) / self.var_slope**0.5))

    def _around(self, value: float, variance: float, confidence: float) -> tuple[float, float]:
        half = quantile(self.freedom, confidence) * max(variance, 0.0) ** 0.5
        return value - half, value + half


@lru_cache(maxsize=256)
def quantile(freedom: float, confidence: float) -> float:
    """Return the two-sided quantile of Student's t for `freedom` degrees of freedom [1]."""
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(freedom, 0.5 + 0.5 * confidence))


def residuals(x: FloatArray, y: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
    """Return the residuals of the least-squares line, (N,) [unit].

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit].
    offsets : (N, Z) array, optional
        Columns that are fitted beside it [1].
    """
    if offsets is None:
        d = x - x.mean()
        e = y - y.mean()
    else:
        base = base_of(offsets)
        d, e = base.without(x - x.mean()), base.without(y)
    sxx = dot(d, d)
    rest: FloatArray = e - d * (dot(d, e) / sxx) if sxx > 0.0 else e
    return rest


def pooled_autocorrelation(parts: list[FloatArray]) -> float:
    """Return the lag-1 autocorrelation of residuals of lines, corrected for detrending [1].

    Parameters
    ----------
    parts : list of (N_k,) arrays
        Residuals of one line each, in the order of time. The scatter is taken to be the same
        process in all of them.

    Returns
    -------
    float
        In [-0.95, 0.95]; 0 where fewer than 8 residuals a line are there on average.
    """
    power = sum(dot(r, r) for r in parts)
    product = sum(dot(r[1:], r[:-1]) for r in parts)
    return autocorrelation_of(sum(len(r) for r in parts), len(parts), power, product)


def autocorrelation_of(n: int, lines: int, power: float, product: float) -> float:
    """Return the lag-1 autocorrelation of residuals, see `pooled_autocorrelation` [1].

    Parameters
    ----------
    n, lines : int
        Residuals, and lines that they are of [1].
    power, product : float
        Sums of their squares and of their lag-1 products [unit^2].
    """
    if n < 8 * max(lines, 1) or not power > 0.0:
        return 0.0
    corrected = (n * product / power + 2.0 * lines) / (n - 4.0 * lines)
    return min(max(corrected, -MAX_AUTOCORRELATION), MAX_AUTOCORRELATION)


class LineSums(NamedTuple):
    """What a least-squares line through N values and its residuals come to.

    Attributes
    ----------
    center, mean : float
        Means of the axis positions [axis unit] and of the values [unit].
    square, slope : float
        Sum of the squares about the center [axis unit^2], and the slope [unit / axis unit].
    power, product, most : float
        Sums of squares and of lag-1 products of the residuals [unit^2], and the largest value
        without its sign [unit].
    """

    center: float
    mean: float
    square: float
    slope: float
    power: float
    product: float
    most: float


def line_sums(x: FloatArray, y: FloatArray) -> LineSums:
    """Return the sums of the line through (N,) values [unit] at (N,) places [axis unit]."""
    return LineSums(*_line_sums(x, y))


@njit(cache=True)
def _line_sums(x: FloatArray, y: FloatArray) -> tuple[float, ...]:
    n = len(x)
    if n == 0:
        return np.nan, np.nan, 0.0, 0.0, 0.0, 0.0, 0.0
    center, mean, most = 0.0, 0.0, 0.0
    for i in range(n):
        center += x[i] - x[0]
        mean += y[i] - y[0]
        most = max(most, abs(y[i]))
    center, mean = x[0] + center / n, y[0] + mean / n
    square, cross = 0.0, 0.0
    for i in range(n):
        d = x[i] - center
        square += d * d
        cross += d * (y[i] - mean)
    slope = cross / square if square > 0.0 else 0.0
    power, product, before = 0.0, 0.0, 0.0
    for i in range(n):
        rest = y[i] - mean - slope * (x[i] - center)
        power += rest * rest
        product += rest * before
        before = rest
    return center, mean, square, slope, power, product, most


@njit(cache=True)
def _line_spread(x: FloatArray, center: float, rho: float) -> tuple[float, float, float]:
    """Return u' R u, u' R d and d' R d of ones u and distances d from the center, in one pass."""
    one, cross, square, ones, far = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(x)):
        d = x[i] - center
        one += 1.0 + 2.0 * rho * ones
        cross += d + rho * (far + d * ones)
        square += d * d + 2.0 * rho * d * far
        ones, far = 1.0 + rho * ones, d + rho * far
    return one, cross, square


def line_weights(
    x: FloatArray, offsets: FloatArray | None = None
) -> tuple[float, FloatArray, FloatArray]:
    """Return the place of a line's center, and the weights that give its level there and slope.

    Parameters
    ----------
    x : (N,) array
        Axis positions [axis unit].
    offsets : (N, Z) array, optional
        Columns that are fitted beside it [1].
    """
    if offsets is None:
        center = float(x.mean())
        d, level = x - center, np.full(len(x), 1.0 / len(x))
    else:
        base = base_of(offsets)
        level, d = base.level, base.without(x - x.mean())
        center = dot(level, x)
    sxx = dot(d, d)
    return center, level, d / sxx if sxx > 0.0 else d


def fit_line(
    x: FloatArray,
    y: FloatArray,
    autocorrelation: float | None = None,
    *,
    offsets: FloatArray | None = None,
    sums: LineSums | None = None,
) -> Line:
    """Fit a line by least squares with the covariance of AR(1) scatter.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit], not all equal, and values [unit], in the order of
        time; N >= 3.
    autocorrelation : float, optional
        Lag-1 autocorrelation of the scatter [1]; from the residuals of this line where not given.
    offsets : (N, Z) array, optional
        Columns that are fitted beside it; the line is the one without them [1].
    sums : LineSums, optional
        Those of x and y, where they are known.

    Returns
    -------
    Line
        The fit.

    Raises
    ------
    ValueError
        If there are fewer than 3 values or all axis positions are equal.
    """
    n, extra = len(x), 0 if offsets is None else offsets.shape[1]
    sums = sums or line_sums(x, y)
    center, mean, slope, power = sums.center, sums.mean, sums.slope, sums.power
    sxx, rho = sums.square, autocorrelation
    if offsets is not None:
        d = base_of(offsets).without(x - center)
        sxx = dot(d, d)
    if n < 3 or not sxx > 0.0:
        msg = f"a line needs 3 values at different places, got {n} values and a spread of {sxx:g}"
        raise ValueError(msg)
    if offsets is not None:
        rest = residuals(x, y, offsets)
        power = dot(rest, rest)
        rho = pooled_autocorrelation([rest]) if rho is None else rho
    elif rho is None:
        rho = autocorrelation_of(n, 1, power, sums.product)
    used = max(rho, 0.0)
    if offsets is None:
        one, cross, square = _line_spread(x, center, used)
        q_mean, q_cross, q_slope = one / n**2, cross / (n * sxx), square / sxx**2
        base = n * q_mean
    else:
        center, w_mean, w_slope = line_weights(x, offsets)
        q_mean, q_slope = (ar1_product(w, w, used) for w in (w_mean, w_slope))
        q_cross, base = ar1_product(w_mean, w_slope, used), base_of(offsets).share(used)
        mean, slope = dot(w_mean, y), dot(w_slope, y)
    rounding = (RESOLUTION * sums.most) ** 2
    variance = max(power / max(n - base - sxx * q_slope, 0.5), rounding)
    return Line(
        samples=n,
        center=center,
        mean=mean,
        slope=slope,
        sigma=variance**0.5,
        autocorrelation=rho,
        freedom=max(n * (1.0 - used) / (1.0 + used) - 2.0 - extra, 1.0),
        var_mean=variance * q_mean,
        cov=variance * q_cross,
        var_slope=variance * q_slope,
    )


def ratio_interval(
    a: float, b: float, *, var_a: float, cov: float, var_b: float, t: float
) -> tuple[float, float]:
    """Return Fieller's limits of a/b; NaN where b does not differ from zero.

    The set of all R with (a - R b)^2 <= t^2 (var_a - 2 R cov + R^2 var_b) is bounded
    only where b differs from zero.

    Parameters
    ----------
    a, b : float
        Numerator and denominator [same unit].
    var_a, cov, var_b : float
        Their covariance [unit^2].
    t : float
        Quantile of Student's t [1].
    """
    lead = b * b - t * t * var_b
    if not lead > 0.0:
        return float("nan"), float("nan")
    half = a * b - t * t * cov
    root = max(half * half - lead * (a * a - t * t * var_a), 0.0) ** 0.5
    return (half - root) / lead, (half + root) / lead
