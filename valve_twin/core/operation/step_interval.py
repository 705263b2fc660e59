# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The interval of a time that began with a sample, or anywhere since the one before."""

from __future__ import annotations

import math
from functools import cache
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_NORMAL = NormalDist()
_COVERED = 0.95
_FAR = _NORMAL.inv_cdf(1.0 - _COVERED)  # -1.645: lower limit where the upper one is far
_FARTHEST = 7.0  # upper limit beyond which the normal error alone has no share
_POINTS = 121  # of the table
_NOTHING = 0.01  # unseen time by standard error below which it is as nothing
_SHARPEST = 1e3  # unseen time by standard error beyond which the noise is nothing


def interval_after(error: float, unseen: float) -> tuple[float, float]:
    """Return the limits of what a measured time lacks.

    Where clocks of command and position are one, it lacks a normal error only. Where they are
    not, the command may have come at any time since the sample before, which adds an equally
    distributed time from 0 to `unseen`. Nothing in the samples tells which: the interval is the
    one that covers 95 % of both.

    Parameters
    ----------
    error : float
        Standard error by the noise [s].
    unseen : float
        Time between the two samples [s].

    Returns
    -------
    (float, float)
        Lower and upper limit, to be added to the time [s].
    """
    if not error > unseen / _SHARPEST:
        return _FAR * error, _COVERED * unseen
    ratio = unseen / error
    if ratio < _NOTHING:
        return -NORMAL_975 * error, NORMAL_975 * error + 0.5 * unseen
    ratios, lower, beyond = _table()
    at = math.log(ratio)
    low = float(np.interp(at, ratios, lower))
    high = float(np.interp(at, ratios, beyond)) + _COVERED * ratio
    return low * error, high * error


@cache
def _table() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return logarithms of ratios, lower limits, and upper ones beyond 95 % of the ratio."""
    ratios = np.geomspace(_NOTHING, _SHARPEST, _POINTS)
    lower, upper = np.array([_limits(r) for r in ratios.tolist()]).T
    return np.log(ratios), lower, upper - _COVERED * ratios


def _limits(ratio: float) -> tuple[float, float]:
    """Return the limits for an error of 1 and an unseen time of `ratio`."""
    low, high = -8.0, _FAR
    for _ in range(60):
        lower = 0.5 * (low + high)
        if _spread(_upper(lower), ratio) - _spread(lower, ratio) > _COVERED:
            high = lower
        else:
            low = lower
    lower = 0.5 * (low + high)
    upper = _upper(lower)
    if upper < _FARTHEST:
        return lower, upper
    low, high = 0.0, ratio + _FARTHEST
    for _ in range(60):
        upper = 0.5 * (low + high)
        if _spread(upper, ratio) - _spread(_FAR, ratio) > _COVERED:
            high = upper
        else:
            low = upper
    return _FAR, upper


def _upper(lower: float) -> float:
    """Return the upper limit with which the normal error alone is covered."""
    return _NORMAL.inv_cdf(min(_COVERED + _NORMAL.cdf(lower), 1.0 - 1e-15))


def _spread(x: float, ratio: float) -> float:
    """Return the distribution of a normal error plus an equal one from 0 to `ratio`."""
    return (_total(x) - _total(x - ratio)) / ratio


def _total(x: float) -> float:
    """Return the integral of the normal distribution up to x."""
    return x * _NORMAL.cdf(x) + math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
