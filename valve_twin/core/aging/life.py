# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far a line still is from its threshold, with Fieller's limits, and at what date.

With gap g (threshold - level) and slope s, both counted towards the threshold, the line has
covered the gap after r with the confidence P(r) = T_nu(Z(r)),

    Z(r) = (r s - g)/sqrt(r^2 var_s - 2 r cov + var_g).

Low, median and high are the smallest r >= 0 with P = 2.5 %, 50 % and 97.5 %: low and high are the
limits of Fieller (1954), cut at zero. Where Z never gets that far the limit is infinite, and that
is an answer: the data do not exclude that the threshold is never reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import quantile

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

MAX_STAMP_NS = (2**31 - 1) * 10**9
"""Last date that builtin_interfaces/Time can carry [ns]."""


@dataclass(frozen=True, slots=True)
class Remaining:
    """What remains to a threshold, in axis units; infinite = none in sight.

    `low` and `high` are the 95 % limits (or as asked), `high` is infinite where the remaining
    life is unbounded.
    """

    low: float
    median: float
    high: float

    @property
    def unbounded(self) -> bool:
        """Whether there is no upper limit."""
        return self.high == float("inf")


NEVER = Remaining(float("inf"), float("inf"), float("inf"))
"""No threshold, or none in sight."""


def remaining_life(
    gap: float,
    slope: float,
    *,
    var_gap: float,
    cov: float,
    var_slope: float,
    freedom: float,
    confidence: float = 0.95,
) -> Remaining:
    """Return what remains until a line reaches its threshold.

    Parameters
    ----------
    gap : float
        Threshold - level, counted positive before the threshold is reached [unit].
    slope : float
        Slope, counted positive towards the threshold [unit / axis unit].
    var_gap, cov, var_slope : float
        Covariance of (gap, slope) [squares and product of their units].
    freedom : float
        Degrees of freedom of Student's t [1].
    confidence : float
        Of the two-sided interval [1].

    Returns
    -------
    Remaining
        Low, median and high [axis unit].
    """
    t = quantile(freedom, confidence)
    spread = (var_gap, cov, var_slope)
    median = 0.0 if gap <= 0.0 else gap / slope if slope > 0.0 else float("inf")
    return Remaining(
        _first_crossing(gap, slope, spread, -t), median, _first_crossing(gap, slope, spread, t)
    )


def _first_crossing(
    gap: float, slope: float, spread: tuple[float, float, float], z: float
) -> float:
    """Return the smallest r >= 0 with r slope - gap >= z sqrt(variance(r)), else infinity."""
    var_gap, cov, var_slope = spread
    if -gap >= z * var_gap**0.5:
        return 0.0
    lead = slope * slope - z * z * var_slope
    half = slope * gap - z * z * cov
    rest = gap * gap - z * z * var_gap
    square = half * half - lead * rest
    if square < 0.0 or (lead == 0.0 and half == 0.0):
        return float("inf")
    root = half + square**0.5 if half >= 0.0 else half - square**0.5
    places = [root / lead] if lead != 0.0 else []
    places += [rest / root] if root != 0.0 else []
    good = [r for r in places if r > 0.0 and (r * slope - gap) * z >= 0.0]
    return min(good, default=float("inf"))


def axis_rate(axis: FloatArray, stamp_ns: IntArray, newest: int) -> float:
    """Return axis units per second of data time over the `newest` estimates [1/s], or NaN.

    Only those count that came after the clock was last set back.

    Parameters
    ----------
    axis : (N,) array
        Axis positions of the estimates [axis unit].
    stamp_ns : (N,) int64 array
        Their stamps [ns].
    newest : int
        Estimates that count [1].
    """
    a, t = axis[-newest:], stamp_ns[-newest:]
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        a, t = a[back[-1] + 1 :], t[back[-1] + 1 :]
    seconds = float(t[-1] - t[0]) * 1e-9 if len(t) > 1 else 0.0
    return float(a[-1] - a[0]) / seconds if seconds > 0.0 and a[-1] > a[0] else float("nan")


def date_after(stamp_ns: int, remaining: float, rate: float) -> int:
    """Return the stamp at which `remaining` axis units are used up at `rate`; 0 = no date.

    Parameters
    ----------
    stamp_ns : int
        Stamp from which is counted [ns].
    remaining : float
        What remains [axis unit].
    rate : float
        How fast it is used up [axis unit / s].
    """
    if not (rate > 0.0 and remaining < float("inf")):
        return 0
    ahead = remaining / rate * 1e9
    return stamp_ns + round(ahead) if ahead < MAX_STAMP_NS - stamp_ns else 0
