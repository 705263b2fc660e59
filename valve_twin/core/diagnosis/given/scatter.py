# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How a sound valve may scatter about a stored reference, and how far that tells a fault."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.given.reference import PREFIX
from valve_twin.core.estimation.data.robust import robust_sigmas

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.diagnosis.given.reference import FeatureReference
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

BESIDE = 3
"""Cycles on either side of an onset that tell this."""

MOST = (8, 4)
"""Cycles before and since beyond which a mean gets no surer: features wander."""

SHOWN = 6.5
"""Standard deviations that are a fault; set on sisters of strangers, seeds 73000-73039 [1]."""

_CHANCE = 1e-6
"""Chance at which the quantiles of few and of many valves are compared [1]."""

_FIRST_CHANCE = 1e-5
"""Chance in one direction that a sound valve differs so from the others that it is called faulty
from its first cycle on; set on sisters of strangers, seeds 73000-73039 [1]."""

_ASSUMED, _SLOPE, _MODEL = 0.02, 0.1, 0.02
"""Least standard deviation between valves, assumed: of a gain, as a share of a slope at rest (a
gap makes it to the third power), of a parameter of the model [1]."""

_PRIOR = 3.0
"""Valves that this assumption counts as [1]."""

_BLOCK = 8
"""Cycles of a reference of the valve itself that count as one look at its level."""

_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Scatter:
    """Covariances as features are followed, (F, F): of a cycle, and of a valve's level.

    Attributes
    ----------
    within, strays : (F, F) arrays
        Of a cycle, and of a mean of some beyond that.
    between : (F, F) array
        Of the level, where cycles before a fault tell it; few valves count wide.
    first : (F, F) array
        The same where none came before: so that `SHOWN` has a chance of `_FIRST_CHANCE`.
    shown : (F,) array
        Features that are judged.
    """

    within: FloatArray
    between: FloatArray
    first: FloatArray
    strays: FloatArray
    shown: BoolArray


def scatter_of(reference: FeatureReference, table: SignatureTable, valve: str = "") -> Scatter:
    """Return how a sound valve may scatter about a reference.

    Few valves tell little of how valves differ: that counts wider, by Student's t, and never for
    less than they scatter from cycle to cycle, or an assumed share. Of a reference of the valve's
    own only what it moved by counts.

    Parameters
    ----------
    reference : FeatureReference
        The reference.
    table : SignatureTable
        Least deviations of its features.
    valve : str
        Name of the valve that is held against it.
    """
    off = reference.offsets()
    shown = np.isfinite(off).any(axis=0)
    within = np.array(reference.within)
    own = np.sqrt(np.diag(within))
    never = ~shown | ((own == 0.0) & (np.array(table.floor) < _ROUNDING))
    least = table.least()
    within = within + np.diag(np.maximum(least**2 - own**2, 0.0) + 1e-4 * own**2 + 1e-24)
    off, valves = np.nan_to_num(off), len(off)
    prior = np.diag(within) + _assumed(table, reference) ** 2 + reference.moved() ** 2 / 3.0
    freedom = valves - 1 + _PRIOR
    between = off.T @ off + _PRIOR * np.diag(prior)
    if reference.valves == (valve,):
        freedom = max(reference.cycles / _BLOCK, _PRIOR)
        between = freedom * np.diag(np.diag(within) / MOST[1] + reference.moved() ** 2 / 3.0)
    between = (1.0 + 1.0 / valves) * between / freedom
    strays = np.diag(np.square(reference.strays))
    first = _first(freedom) ** 2 * between
    return Scatter(within, _wider(freedom) ** 2 * between, first, strays, ~never)


def _wider(freedom: float) -> float:
    """Return how much wider few valves count than many [1]."""
    from scipy.special import stdtrit  # slow to import

    return float(stdtrit(freedom, 1.0 - _CHANCE) / stdtrit(1e6, 1.0 - _CHANCE))


def _first(freedom: float) -> float:
    """Return how much wider valves count so that `SHOWN` has the chance `_FIRST_CHANCE` [1]."""
    from scipy.special import stdtrit  # slow to import

    return max(float(stdtrit(freedom, 1.0 - _FIRST_CHANCE)) / SHOWN, 1.0)


def _assumed(table: SignatureTable, reference: FeatureReference) -> FloatArray:
    """Return what valves are assumed to differ by at least, (F,)."""
    level = np.nan_to_num(np.array([p.centre for p in reference.products]))
    share = {True: _SLOPE * np.abs(level).mean(axis=0), False: np.zeros(len(table.features))}
    return np.array(
        [
            _ASSUMED if n in table.gains else share[n in table.slopes][k]
            for k, n in enumerate(table.features)
        ]
    )


def widened(scatter: Scatter, keep: IntArray, y: FloatArray) -> Scatter:
    """Return the scatter, that of a cycle not less than this valve's own from step to step.

    Parameters
    ----------
    scatter : Scatter
        By the reference.
    keep : (K,) int64 array
        Features that are shown.
    y : (N, K) array
        What they are off the centre in some cycles [as followed].
    """
    within = scatter.within[np.ix_(keep, keep)]
    between, first, strays = (
        part[np.ix_(keep, keep)] for part in (scatter.between, scatter.first, scatter.strays)
    )
    if len(y) > BESIDE:
        own = robust_sigmas(np.diff(y, axis=0)) / np.sqrt(2.0)
        more = np.maximum(own / np.sqrt(np.diag(within)), 1.0)
        within = within * np.outer(more, more)
    return Scatter(within, between, first, strays, scatter.shown[keep])


def departs_by(
    reference: FeatureReference, own: Mapping[str, float], valve: str
) -> tuple[float, str]:
    """Return how far a valve's own first model lies off others', and in what; "" = in nothing.

    Parameters
    ----------
    reference : FeatureReference
        The reference.
    own : mapping
        Parameters of its own first model, by name.
    valve : str
        Its name.
    """
    largest, where = 0.0, ""
    for name, values in reference.models:
        known = np.array([v for v in values if np.isfinite(v)])
        if not len(known) or name not in own or reference.valves == (valve,):
            continue
        if np.ptp(known) == 0.0 and (len(known) > 1 or known[0] == 0.0):
            continue  # a count or a bound: no scatter tells how far is far
        freedom = len(known) - 1 + _PRIOR
        least = _MODEL * abs(float(known.mean()))
        square = float(np.sum((known - known.mean()) ** 2)) + _PRIOR * least**2
        deviation = np.sqrt(square / freedom * (1.0 + 1.0 / len(known)))
        far = abs(own[name] - float(known.mean())) / float(deviation * _wider(freedom))
        if far > max(SHOWN, largest):
            largest, where = float(far), name.removeprefix(PREFIX)
    return largest, where
