# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which dimension of a solenoid has drifted, by how much, and what fits as well.

All sizes of a cycle are fitted together (`fit`); combinations that the signals hardly show scatter
widely there, and the covariance of the fit says which. The mean of the newest cycles less that of
the first ones is therefore weighed by that covariance and explained by one cause at a time; wear
has one direction. What the best one leaves is the measure of its interval (Student's t, as in any
regression whose noise is not known), so that curves that are not those of the valve widen it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.trend import quantile
from valve_twin.core.valves.double_solenoid.dimensions.published import COMPANIONS, FREE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.dimensions.published import Cause

REFERENCE_CYCLES = 8
"""First cycles that everything is compared with, and newest ones that are, assumed."""

SURE = 1e-4
"""Chance below which a change is none, shared by all causes, assumed [1]."""

UNLIKE = 0.3
"""Share of a change that may be unlike its cause, as in `DetectionConfig.unlike` [1]."""

AS_WELL, AS_WELL_SHARE = 3.4, 0.01
"""A cause that leaves less than this ratio of what the best one leaves (the 95 % quantile of F for
8 and 8 degrees of freedom), or than this share of the change, fits as well, the second assumed."""

SIGNATURE = 0.03
"""Standard error of a signature: mesh, straight line through a curve, assumed [1]."""

_FREE = tuple(COMPANIONS.index(n) for n in FREE)

_TWICE = 2.0  # standard errors of the signatures of friction and supply that a change exceeds

NONE, UNKNOWN = "none", "unknown"


@dataclass(frozen=True, slots=True)
class Drift:
    """A named change.

    Attributes
    ----------
    name : str
        Of its cause; `NONE` = nothing has changed, `UNKNOWN` = like no cause.
    size, lower, upper : float
        And its 95 % limits [unit of the cause]; NaN without a cause.
    rivals : tuple of str
        Other causes that fit as well.
    left : float
        Share of the change that the cause leaves [1].
    """

    name: str
    size: float = np.nan
    lower: float = np.nan
    upper: float = np.nan
    rivals: tuple[str, ...] = ()
    left: float = np.nan


def weights_of(covariance: FloatArray) -> FloatArray:
    """Return W (P, P) with unit scatter of W d: a root of the inverse covariance.

    Combinations that the cycle does not show count nothing.

    Parameters
    ----------
    covariance : (P, P) array
        Of the fitted values [products of their units].
    """
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    shown = values > 1e-12 * values[-1]
    roots = np.where(shown, 1.0 / np.sqrt(np.where(shown, values, 1.0)), 0.0)
    found: FloatArray = roots[:, None] * vectors.T / scale
    return found


def _judged(covariance: FloatArray) -> FloatArray:
    """Return the weights (P, P) without what friction and supply may have changed."""
    white = weights_of(covariance)
    own = np.linalg.qr(white[:, _FREE])[0]
    found: FloatArray = white - own @ (own.T @ white)
    return found


def judge(
    before: FloatArray, newest: FloatArray, covariance: FloatArray, causes: Sequence[Cause]
) -> Drift:
    """Name the cause of the difference between two groups of cycles.

    Parameters
    ----------
    before : (P,) array
        Mean of the first cycles' fitted values [their units].
    newest : (M, P) array
        Those of the newest cycles [their units].
    covariance : (P, P) array
        Of the newest fit [products of the units of the fitted values].
    causes : sequence of Cause
        What can have changed.
    """
    white = _judged(covariance)
    off = (newest - before) @ white.T
    change = off.mean(axis=0)
    all_of_it = weights_of(covariance) @ (newest.mean(axis=0) - before)
    beside = SIGNATURE * float(np.linalg.norm(all_of_it - change))  # of friction and supply
    whole, freedom = float(change @ change), len(change) - len(FREE) - 1
    found: dict[str, tuple[float, float, float, bool]] = {}
    for cause in causes:
        ray = white[:, cause.place]
        length = float(ray @ ray)
        if length == 0.0:
            continue
        sizes = off @ ray / length
        size = float(sizes.mean())
        if cause.sign * size < 0.0:
            continue
        left = whole - size**2 * length
        counts = 1.0 / len(sizes) + 1.0 / REFERENCE_CYCLES
        scatter, known = float(sizes.std(ddof=1)) * counts**0.5, beside / length**0.5
        limit = quantile(len(sizes) - 1, 1.0 - SURE / len(causes))
        parts = scatter**2 + known**2 + left / (freedom * length) + (SIGNATURE * size) ** 2
        error = float(np.sqrt(parts))
        found[cause.name] = (left, size, error, abs(size) > limit * scatter + _TWICE * known)
    if not any(sure for *_, sure in found.values()):
        return Drift(NONE)
    ordered = sorted(found, key=lambda name: found[name][0])
    best = ordered[0]
    left, size, error, _ = found[best]
    if left > UNLIKE * whole:
        return Drift(UNKNOWN, left=left / whole)
    limit = max(AS_WELL * left, AS_WELL_SHARE * whole)
    rivals = tuple(name for name in ordered[1:] if found[name][0] < limit)
    half = quantile(freedom, 0.95) * error
    sign = next(c.sign for c in causes if c.name == best)
    size = abs(size) if sign else size
    lower = max(size - half, 0.0) if sign else size - half
    return Drift(best, size, lower, size + half, rivals, left / whole)


def leftovers(covariance: FloatArray, causes: Sequence[Cause]) -> FloatArray:
    """Return which share of the change by cause k (row) cause j leaves, (K, K) [1].

    Parameters
    ----------
    covariance : (P, P) array
        Of the fitted values [products of their units].
    causes : sequence of Cause
        What can have changed; two that only differ in direction leave all of each other.
    """
    white = _judged(covariance)
    out = np.ones((len(causes), len(causes)))
    for k, one in enumerate(causes):
        for j, other in enumerate(causes):
            ray, toward = (white[:, c.place] * (c.sign or 1.0) for c in (one, other))
            cosine = float(ray @ toward / np.sqrt((ray @ ray) * (toward @ toward)))
            if cosine > 0.0 or not (one.sign and other.sign):
                out[k, j] = max(1.0 - cosine**2, 0.0)
    return out
