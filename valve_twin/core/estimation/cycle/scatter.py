# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far the estimates of one parameter scatter from cycle to cycle.

Intervals from the residuals of one cycle cover 5-11 % under process noise (equations.md 2.6); what
the same estimator did in earlier cycles covers what it says. A slow change of the parameter must
not count as scatter, and neither must a few outliers: a line is fitted robustly first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import robust_sigma

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
        if not np.isfinite(self.sigma):
            return float("nan")
        from scipy.special import stdtrit  # slow to import

        return float(stdtrit(self.freedom, 0.975)) * self.sigma


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
    n = len(values)
    if n < MIN_CYCLES:
        return NOT_CALIBRATED
    x = np.arange(n, dtype=np.float64)
    i, j = np.triu_indices(n, 1)
    slope = float(np.median((values[j] - values[i]) / (x[j] - x[i])))
    off = values - slope * x
    off = off - np.median(off)
    limit = _OUTLIER_SIGMAS * robust_sigma(off)
    keep = np.abs(off) <= limit if limit > 0.0 else np.ones(n, dtype=np.bool_)
    x, y = x[keep] - x[keep].mean(), values[keep] - values[keep].mean()
    squares = float((y * y).sum() - (x * y).sum() ** 2 / (x * x).sum())
    freedom = len(y) - 2
    return Scatter(float(np.sqrt(max(squares, 0.0) / freedom)), freedom)
