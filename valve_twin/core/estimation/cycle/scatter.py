# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far the estimates of one parameter scatter from cycle to cycle.

Intervals from the residuals of one cycle cover 5-11 % under process noise (equations.md 2.6); what
the same estimator did in earlier cycles covers what it says. A slow change of the parameter must
not count as scatter, and neither must a few outliers: a line is fitted robustly first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.scatter_kernel import scatter_about_line

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

MIN_CYCLES = 10
"""Fewest earlier cycles that calibrate an interval."""

_OUTLIER_SIGMAS = 4.0
"""A residual above this many robust standard deviations is left out."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviation of one cycle's estimate.

    Attributes
    ----------
    sigma : float
        Standard deviation [unit of the parameter]; NaN = not calibrated.
    freedom : int
        Degrees of freedom behind it.
    """

    sigma: float
    freedom: int

    @property
    def half_width_95(self) -> float:
        """Return the half width of the 95 % interval of one estimate."""
        if not isfinite(self.sigma):
            return nan
        return _student_975(self.freedom) * self.sigma


@cache
def _student_975(freedom: int) -> float:
    """Return the 97.5 % point of Student's distribution; a memory is short, so there are few."""
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(freedom, 0.975))


NOT_CALIBRATED = Scatter(float("nan"), 0)


def scatter_between_cycles(values: FloatArray) -> Scatter:
    """Measure the scatter of consecutive estimates about their robust line.

    Parameters
    ----------
    values : (N,) array
        Usable estimates of one parameter, oldest first.

    Returns
    -------
    Scatter
        `NOT_CALIBRATED` for fewer than `MIN_CYCLES` values.
    """
    if len(values) < MIN_CYCLES:
        return NOT_CALIBRATED
    values = np.ascontiguousarray(values, np.float64)
    return Scatter(*scatter_about_line(values, _OUTLIER_SIGMAS))
