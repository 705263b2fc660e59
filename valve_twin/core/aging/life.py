# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far a trend still is from its threshold, with limits, and at what date.

A shape of a law (`core.aging.laws`) is linear in level and change. With g its distance beyond the
threshold (negative before) at u = 1, c its change and h how far the shape goes on after r axis
units, the threshold is reached within r with the probability T_nu(Z(r)),

    Z(r) = (g + c h(r))/sqrt(var_g + 2 h cov + h^2 var_c),

the largest so far where Z falls again: for one line these are the limits of Fieller (1954). The
probability of all is the mean over the shapes, weighted with their evidence. Low, median and high
are where it is 2.5 %, 50 % and 97.5 %. Where it never gets that far the limit is infinite, and
that is an answer: the data do not exclude that the threshold is never reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.laws.reach import first_places, reached, student_table

if TYPE_CHECKING:
    from valve_twin.core.aging.laws.shapes import LawFit
    from valve_twin.core.types import FloatArray, IntArray

MAX_STAMP_NS = (2**31 - 1) * 10**9
"""Last date that builtin_interfaces/Time can carry [ns]."""

_GRID = np.concatenate([np.zeros(1), np.geomspace(1e-3, 1e4, 48)])  # in lengths of the history


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


@dataclass(frozen=True, slots=True)
class Approach:
    """What is known of the way of a trend to one threshold, by every law that the data allow.

    `gap` and `change` of a shape are counted positive towards and beyond the threshold.

    Attributes
    ----------
    fit : LawFit
        The shapes and their evidence.
    now : float
        Present axis position [axis unit].
    gap, change : (K,) arrays
        Level at u = 1 minus threshold, and change between u = 0 and 1, of every shape [unit].
    var_gap, cov, var_change : (K,) arrays
        Covariance of (gap, change) [unit^2].
    """

    fit: LawFit
    now: float
    gap: FloatArray
    change: FloatArray
    var_gap: FloatArray
    cov: FloatArray
    var_change: FloatArray

    def before(self, ahead: float) -> float:
        """Return the probability that the threshold is reached within `ahead` axis units [1]."""
        grid = _GRID[_GRID * self.fit.length < ahead] * self.fit.length
        return reached(*self._known, np.append(grid, max(ahead, 0.0)))

    def remaining(self, confidence: float = 0.95) -> Remaining:
        """Return the limits of what remains with a two-sided `confidence`, and the median."""
        tail = 0.5 * (1.0 - confidence)
        shares = np.array([tail, 0.5, 1.0 - tail])
        return Remaining(*first_places(*self._known, _GRID * self.fit.length, shares).tolist())

    @property
    def _known(self) -> tuple[IntArray, FloatArray, FloatArray, float, float]:
        """Return what the kernels read."""
        ways = (self.gap, self.change, self.var_gap, self.cov, self.var_change)
        rows = np.stack([self.fit.number, self.fit.weight, *ways])
        table = student_table(self.fit.freedom)
        return self.fit.law, rows, table, self.now - self.fit.start, self.fit.length


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
