# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The performance indices of the benchmark, as its definition 1.0 writes them.

Decisions are taken as high from 0.5 on, a sample stands for the time until the next one, and -1
means that an index is not defined.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import BoolArray, FloatArray

_Name = TypeVar("_Name")

UNDEFINED = -1.0


@dataclass(frozen=True, slots=True)
class Zone:
    """Times of a scenario [s]: end of the set-up, start of the fault, end of the indices."""

    on: float
    onset: float
    horizon: float


@dataclass(frozen=True, slots=True)
class DecisionIndices:
    """Indices of one decision: t_dt, f_sd, r_fd, r_td of detection; t_it, f_si, r_fi, r_ti.

    Attributes
    ----------
    time : float
        From the start of the fault to the last rising edge [s].
    first : float
        The same to the first time that it is high; not of the benchmark [s].
    strength : float
        Of the fault at the last rising edge [1].
    false : float
        Part of the time before the fault in which it is high [1].
    true : float
        Part of the time of the fault in which it is high [1].
    high_at_onset : bool
        Whether it is high as the fault starts; not of the benchmark.
    """

    time: float
    first: float
    strength: float
    false: float
    true: float
    high_at_onset: bool


def decision_indices(
    time_s: FloatArray, decision: FloatArray, strength: FloatArray, zone: Zone
) -> DecisionIndices:
    """Return the indices of a decision.

    Parameters
    ----------
    time_s : (N,) array
        Times of the samples, evenly apart [s].
    decision : (N,) array
        Detection decision DD, or PID, which names the right elementary diagnosis [1].
    strength : (N,) array
        Of the fault [1].
    zone : Zone
        Times of the scenario.
    """
    high = decision >= 0.5
    rising = high & ~np.concatenate([[False], high[:-1]])
    before = (time_s >= zone.on) & (time_s < zone.onset)
    during = (time_s >= zone.onset) & (time_s < zone.horizon)
    edges = np.flatnonzero(rising & during)
    seen = np.flatnonzero(high & during)
    onset = np.flatnonzero(time_s >= zone.onset)
    last = int(edges[-1]) if len(edges) else -1
    return DecisionIndices(
        time=float(time_s[last]) - zone.onset if last >= 0 else UNDEFINED,
        first=float(time_s[seen[0]]) - zone.onset if len(seen) else UNDEFINED,
        strength=float(strength[last]) if last >= 0 else UNDEFINED,
        false=_share(high, before),
        true=_share(high, during),
        high_at_onset=bool(len(onset) and onset[0] > 0 and high[onset[0] - 1]),
    )


def misisolation(time_s: FloatArray, others: FloatArray, zone: Zone) -> float:
    """Return r_mi, the mean number of other elementary diagnoses that are named.

    Parameters
    ----------
    time_s : (N,) array
        Times of the samples, evenly apart [s].
    others : (N,) array
        CID, how many others are named [1].
    zone : Zone
        Times of the scenario.
    """
    inside = (time_s >= zone.on) & (time_s < zone.horizon)
    return float(others[inside].mean()) if inside.any() else UNDEFINED


def accuracy(named: Sequence[int]) -> float:
    """Return dacc, 1 / number of the faults that are named in the end; 0 where none is."""
    return 1.0 / len(named) if named else 0.0


def mean_accuracy(diagnoses: Mapping[_Name, Sequence[int]]) -> float:
    """Return dacctm, the mean of 1 / faults over the elementary diagnoses, DGN0 among them."""
    return float(np.mean([accuracy(faults) for faults in diagnoses.values()]))


def _share(high: BoolArray, where: BoolArray) -> float:
    return float(high[where].mean()) if where.any() else UNDEFINED
