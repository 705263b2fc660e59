# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Derive the signatures of faults and the sizes of a campaign from the simulated valve.

Healthy and faulty valve run from the same state with the same random numbers, so that their
difference is the fault alone. One rule gives every size: `small` is what changes the features of
one cycle by four standard deviations (Mahalanobis distance in the scatter of a healthy valve),
medium and large are 3 and 10 times that.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from valve_twin.core.diagnosis.table import (
    BY_NAME,
    FACTORS,
    Signature,
    SignatureTable,
    whitener,
    with_floor,
)
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import Cycle

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import FloatArray, ParameterValue
    from valve_twin.core.valves.interface import Options

DETECTABLE = 4.0
"""Standard deviations of one cycle that a small fault makes [1]."""

_STEPS = 6
"""Secant steps to the size of a small fault."""


class Diagnosable(Protocol):
    """A model whose cycles show features and that knows how faults change them."""

    @property
    def feature_set(self) -> FeatureSet:
        """Return which features, and how they are followed."""
        ...

    def features(self, cycle: Cycle, options: Options) -> tuple[ParameterValue, ...]:
        """Return the features of a cycle."""
        ...

    def signatures(self) -> SignatureTable:
        """Return how faults change the features."""
        ...


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is simulated: seeds, healthy cycles a seed, cycles with a fault a seed."""

    seeds: tuple[int, ...] = field(default=tuple(range(900, 908)))
    healthy: int = 40
    faulty: int = 5


@dataclass(frozen=True, slots=True)
class Rig:
    """A simulated valve and the model that looks at its cycles.

    Attributes
    ----------
    model : Diagnosable
        The valve's model.
    options : mapping
        Its options, complete.
    simulation : SimulationConfig
        The valve.
    """

    model: Diagnosable
    options: Options
    simulation: SimulationConfig

    def run(self, valve: SimulatedValve, cycles: int) -> FloatArray:
        """Run a valve on and return the features of its next cycles, (cycles, F)."""
        followed = self.model.feature_set
        vectors = np.empty((cycles, len(followed.names)))
        period_s = self.simulation.period_s
        for k in range(cycles):
            frames = to_frames(valve.advance(self.simulation.cycle_samples))
            cycle = Cycle(max(valve.cycle, 1), period_s, frames)
            vectors[k] = followed.vector(self.model.features(cycle, self.options))
        return vectors


def derive(
    rig: Rig,
    faults: tuple[str, ...] = (),
    *,
    effort: Effort | None = None,
    advance: Callable[[], None] = lambda: None,
) -> SignatureTable:
    """Return the signatures of faults at small, medium and large size.

    Parameters
    ----------
    rig : Rig
        Valve and model; the valve should not age.
    faults : tuple of str
        Names of the faults; none = all that the features show.
    effort : Effort, optional
        How much is simulated.
    advance : callable
        Called after each fault.

    Returns
    -------
    SignatureTable
        Two-sided faults have signatures of both signs.
    """
    effort = effort or Effort()
    starts = [_started(rig, seed) for seed in effort.seeds]
    covariance = _scatter(rig, starts, effort.healthy)
    followed = rig.model.feature_set
    floor = np.full(len(followed.names), 1e-9)
    for name in followed.shares:
        floor[followed.names.index(name)] = 1.0 / rig.simulation.cycle_samples
    white = whitener(with_floor(covariance, floor))
    healthy = [rig.run(deepcopy(start), effort.faulty + 1)[1:] for start in starts]
    pairs = list(zip(starts, healthy, strict=True))
    signatures: list[Signature] = []
    for name in faults or followed.first_sizes:
        small = _small(rig, pairs, white, name)
        signs = (1.0, -1.0) if BY_NAME[name].two_sided else (1.0,)
        for sign in signs:
            for factor in FACTORS:
                size = sign * min(small * factor, followed.largest.get(name, math.inf))
                change, scatter = _change(rig, pairs, name, size)
                signatures.append(Signature(name, size, _short(change, 4), _short(scatter, 2)))
        advance()
    rows = tuple(_short(row, 5) for row in covariance)
    return SignatureTable(followed.names, rows, tuple(floor.tolist()), tuple(signatures))


def _short(values: FloatArray, digits: int) -> tuple[float, ...]:
    return tuple(float(f"{v:.{digits}g}") for v in values)


def _started(rig: Rig, seed: int) -> SimulatedValve:
    valve = SimulatedValve(rig.simulation, seed)
    valve.advance(rig.simulation.cycle_samples)
    return valve


def _scatter(rig: Rig, starts: list[SimulatedValve], cycles: int) -> FloatArray:
    """Return the (F, F) covariance between healthy cycles."""
    runs = [rig.run(deepcopy(start), cycles) for start in starts]
    off = np.concatenate([run - np.nanmean(run, axis=0) for run in runs])
    off = np.nan_to_num(off)
    return np.asarray(off.T @ off / (len(off) - len(runs)))


def _change(
    rig: Rig, pairs: list[tuple[SimulatedValve, FloatArray]], name: str, severity: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and scatter (F,) of the change by a fault; its first cycle is left out."""
    changes = []
    for start, healthy in pairs:
        valve = deepcopy(start)
        valve.set_fault(name, severity)
        changes.append(rig.run(valve, len(healthy) + 1)[1:] - healthy)
    every = np.concatenate(changes)
    known = np.isfinite(every)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, every, 0.0).sum(axis=0) / count
    square = (np.where(known, every - mean, 0.0) ** 2).sum(axis=0) / count
    return mean, np.sqrt(square)


def _small(
    rig: Rig,
    pairs: list[tuple[SimulatedValve, FloatArray]],
    white: FloatArray,
    name: str,
) -> float:
    """Return the size that makes `DETECTABLE` standard deviations, to two digits."""
    followed = rig.model.feature_set
    size, most = followed.first_sizes[name], followed.largest.get(name, math.inf)
    for _ in range(_STEPS):
        distance = float(np.linalg.norm(white @ _change(rig, pairs, name, size)[0]))
        factor = min(max(DETECTABLE / max(distance, 1e-9), 0.2), 5.0)
        size = min(size * factor, most / FACTORS[-1])
        if abs(factor - 1.0) < 0.02:
            break
    return float(f"{size:.2g}")
