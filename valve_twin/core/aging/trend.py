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
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.estimation.data.one_thread import dot

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

MAX_AUTOCORRELATION = 0.95
"""Largest lag-1 autocorrelation that is corrected for [1]; beyond it there is no line."""

RESOLUTION = 1e-9
"""Scatter below this part of the largest value is taken for rounding, not for signal [1]."""


TINY = float(np.finfo(np.float64).tiny)
"""Keeps what is divided by from being zero [1]."""

MAX_FACTOR = 5.0
"""Largest factor, up or down, that a product has on a level [1]."""


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


def quantile(freedom: float, confidence: float) -> float:
    """Return the two-sided quantile of Student's t for `freedom` degrees of freedom [1]."""
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(freedom, 0.5 + 0.5 * confidence))


@njit(cache=True)
def ar1_product(u: FloatArray, v: FloatArray, rho: float) -> float:
    """Return u' R v with R[i, j] = rho^|i - j| in one pass.

    Parameters
    ----------
    u, v : (N,) arrays
        Vectors of any unit [1].
    rho : float
        Autocorrelation between neighbours [1].
    """
    total, behind_u, behind_v = 0.0, 0.0, 0.0
    for i in range(len(u)):
        total += u[i] * v[i] + rho * (u[i] * behind_v + v[i] * behind_u)
        behind_u = u[i] + rho * behind_u
        behind_v = v[i] + rho * behind_v
    return total


@njit(cache=True)
def ar1_products(u: FloatArray, v: FloatArray, rho: float) -> FloatArray:
    """Return u' R v, see `ar1_product`, of every pair of rows, (K,).

    Parameters
    ----------
    u, v : (K, N) arrays
        Vectors of any unit [1]; one with a single row stands for K alike.
    rho : float
        Autocorrelation between neighbours [1].
    """
    out = np.empty(max(len(u), len(v)))
    for k in range(len(out)):
        out[k] = ar1_product(u[min(k, len(u) - 1)], v[min(k, len(v) - 1)], rho)
    return out


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
    n, lines = sum(len(r) for r in parts), len(parts)
    power = sum(dot(r, r) for r in parts)
    if n < 8 * max(lines, 1) or not power > 0.0:
        return 0.0
    raw = sum(dot(r[1:], r[:-1]) for r in parts) / power
    corrected = (n * raw + 2.0 * lines) / (n - 4.0 * lines)
    return float(np.clip(corrected, -MAX_AUTOCORRELATION, MAX_AUTOCORRELATION))


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

    Returns
    -------
    Line
        The fit.

    Raises
    ------
    ValueError
        If there are fewer than 3 values or all axis positions are equal.
    """
    n = len(x)
    center, w_mean, w_slope = line_weights(x, offsets)
    d = x - center if offsets is None else base_of(offsets).without(x - center)
    sxx = dot(d, d)
    if n < 3 or not sxx > 0.0:
        msg = f"a line needs 3 values at different places, got {n} values and a spread of {sxx:g}"
        raise ValueError(msg)
    rest = residuals(x, y, offsets)
    rho = pooled_autocorrelation([rest]) if autocorrelation is None else autocorrelation
    used, extra = max(rho, 0.0), 0 if offsets is None else offsets.shape[1]
    q_mean = ar1_product(w_mean, w_mean, used)
    q_slope = ar1_product(w_slope, w_slope, used)
    rounding = (RESOLUTION * float(np.abs(y).max())) ** 2
    base = n * q_mean if offsets is None else base_of(offsets).share(used)
    variance = max(dot(rest, rest) / max(n - base - sxx * q_slope, 0.5), rounding)
    return Line(
        samples=n,
        center=center,
        mean=float(y.mean()) if offsets is None else dot(w_mean, y),
        slope=dot(w_slope, y),
        sigma=variance**0.5,
        autocorrelation=rho,
        freedom=max(n * (1.0 - used) / (1.0 + used) - 2.0 - extra, 1.0),
        var_mean=variance * q_mean,
        cov=variance * ar1_product(w_mean, w_slope, used),
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
