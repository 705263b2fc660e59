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
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import numpy as np

from valve_twin.core.diagnosis.table import (
    BY_NAME,
    FACTORS,
    Signature,
    SignatureTable,
    held_correlations,
    whitener,
    with_floor,
)
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import Cycle

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.simulation.aging_laws import AgingRule
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import FloatArray, ParameterValue
    from valve_twin.core.valves.interface import Options

DETECTABLE = 4.0
"""Standard deviations of one cycle that a small fault makes [1]."""

_STEPS = 6
"""Secant steps to the size of a small fault."""


class Followed(Protocol):
    """What has features to follow."""

    @property
    def feature_set(self) -> FeatureSet:
        """Return which features, and how they are followed."""
        ...


class Diagnosable(Followed, Protocol):
    """A model whose cycles show features and that knows how faults change them."""

    def features(self, cycle: Cycle, options: Options) -> tuple[ParameterValue, ...]:
        """Return the features of a cycle."""
        ...

    def signatures(self) -> SignatureTable:
        """Return how faults change the features."""
        ...


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is simulated: seeds, healthy cycles a seed, cycles with a fault a seed.

    `factors` are the sizes over the small one; those beyond the greatest of a fault are left out.
    """

    seeds: tuple[int, ...] = field(default=tuple(range(900, 908)))
    healthy: int = 40
    faulty: int = 5
    factors: tuple[float, ...] = FACTORS


class Faulty(Protocol):
    """A valve that takes faults; a copy of it goes on by itself."""

    def set_fault(self, kind: str, severity: float) -> object:
        """Begin with a fault."""
        ...


V = TypeVar("V", bound=Faulty)
M = TypeVar("M", bound=Followed)
S = TypeVar("S", bound="SimulatedBench[Any]")


class Bench(Followed, Protocol[V]):
    """What a campaign needs: valves that take faults, and the features of their cycles."""

    @property
    def cycle_samples(self) -> int:
        """Return the number of samples of a cycle."""
        ...

    def start(self, seed: int) -> V:
        """Return a new valve."""
        ...

    def run(self, valve: V, cycles: int) -> FloatArray:
        """Run a valve on and return the features of its next cycles, (cycles, F)."""
        ...


class AgingBench(Bench[V], Protocol[V]):
    """A bench whose valves may age."""

    def aged(self, rules: tuple[AgingRule, ...]) -> Bench[V]:
        """Return the bench with valves that age."""
        ...


@dataclass(frozen=True, slots=True)
class SimulatedBench(Generic[M]):
    """A simulated valve and the model that looks at its cycles.

    Attributes
    ----------
    model : Followed
        The valve's model.
    options : mapping
        Its options, complete.
    simulation : SimulationConfig
        The valve.
    """

    model: M
    options: Options
    simulation: SimulationConfig

    @property
    def feature_set(self) -> FeatureSet:
        """Return which features, and how they are followed."""
        return self.model.feature_set

    @property
    def cycle_samples(self) -> int:
        """Return the number of samples of a cycle."""
        return self.simulation.cycle_samples

    def aged(self: S, rules: tuple[AgingRule, ...]) -> S:
        """Return the bench with valves that age."""
        return replace(self, simulation=replace(self.simulation, aging=rules))


class Rig(SimulatedBench[Diagnosable]):
    """A simulated valve and a model that knows its faults."""

    __slots__ = ()

    def start(self, seed: int) -> SimulatedValve:
        """Return a new valve."""
        return SimulatedValve(self.simulation, seed)

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
    rig: Bench[V],
    faults: tuple[str, ...] = (),
    *,
    small: Mapping[str, float] | None = None,
    correlations: SignatureTable | None = None,
    apart: float = 0.0,
    effort: Effort | None = None,
    advance: Callable[[], None] = lambda: None,
) -> SignatureTable:
    """Return the signatures of faults at small, medium and large size.

    Parameters
    ----------
    rig : Bench
        Valve and model; the valve should not age.
    faults : tuple of str
        Names of the faults; none = all that the features show.
    small : mapping of str to float, optional
        Small sizes that are set and not searched, by fault [unit of the fault].
    correlations : SignatureTable, optional
        Table whose correlations count beside the scatter of each feature; none = its own.
    apart : float
        Share of the scatter beyond that of the table which they do not count for [1].
    effort : Effort, optional
        How much is simulated.
    advance : callable
        Called after each fault.

    Returns
    -------
    SignatureTable
        Two-sided faults have signatures of both signs.
    """
    effort, set_sizes = effort or Effort(), small or {}
    starts = [_started(rig, seed) for seed in effort.seeds]
    covariance = _scatter(rig, starts, effort.healthy)
    if correlations is not None:
        covariance = _correlated(np.sqrt(np.diag(covariance)), correlations, apart)
    followed = rig.feature_set
    floor = np.full(len(followed.names), 1e-9)
    for name in followed.shares:
        floor[followed.names.index(name)] = 1.0 / rig.cycle_samples
    for name, least in followed.least.items():
        floor[followed.names.index(name)] = least
    white = whitener(with_floor(covariance, floor))
    healthy = [rig.run(deepcopy(start), effort.faulty + 1)[1:] for start in starts]
    pairs = list(zip(starts, healthy, strict=True))
    signatures: list[Signature] = []
    for name in faults or followed.first_sizes:
        start = set_sizes.get(name) or _small(rig, pairs, white, name)
        signs = (1.0, -1.0) if BY_NAME[name].two_sided else (1.0,)
        for sign in signs:
            for size in _sizes(start, effort.factors, followed.largest.get(name, math.inf)):
                change, scatter = _change(rig, pairs, name, sign * size)
                signatures.append(
                    Signature(name, sign * size, _short(change, 4), _short(scatter, 2))
                )
        advance()
    rows = tuple(_short(row, 5) for row in covariance)
    return SignatureTable(
        followed.names,
        rows,
        tuple(floor.tolist()),
        tuple(signatures),
        gains=followed.gains,
        slopes=followed.slopes,
    )


def _sizes(small: float, factors: tuple[float, ...], most: float) -> list[float]:
    """Return the sizes of a fault: the usual ones up to the greatest, more only below it."""
    usual = [min(small * factor, most) for factor in factors if factor in FACTORS]
    return [*usual, *(s for f in factors if f not in FACTORS and (s := small * f) <= most)]


def _short(values: FloatArray, digits: int) -> tuple[float, ...]:
    return tuple(float(f"{v:.{digits}g}") for v in values)


def _started(rig: Bench[V], seed: int) -> V:
    valve = rig.start(seed)
    rig.run(valve, 1)
    return valve


def _scatter(rig: Bench[V], starts: list[V], cycles: int) -> FloatArray:
    """Return the (F, F) covariance between healthy cycles."""
    runs = [rig.run(deepcopy(start), cycles) for start in starts]
    off = np.concatenate([np.nan_to_num(run - _mean(run)) for run in runs])
    return np.asarray(off.T @ off / (len(off) - len(runs)))


def _correlated(deviation: FloatArray, table: SignatureTable, apart: float) -> FloatArray:
    """Return the (F, F) covariance of features of these deviations with a table's correlations."""
    known = with_floor(np.array(table.covariance), np.maximum(np.array(table.floor), 1e-9))
    own = np.sqrt(np.diag(known))
    held = held_correlations(own, np.maximum(deviation, 1e-9), apart)
    return np.asarray(held * known / np.outer(own, own) * np.outer(deviation, deviation))


def _mean(run: FloatArray) -> FloatArray:
    """Return the mean of what is known of each column, (F,)."""
    known = np.isfinite(run)
    total = np.where(known, run, 0.0).sum(axis=0)
    return np.asarray(total / np.maximum(known.sum(axis=0), 1))


def _change(
    rig: Bench[V], pairs: list[tuple[V, FloatArray]], name: str, severity: float
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
    rig: Bench[V],
    pairs: list[tuple[V, FloatArray]],
    white: FloatArray,
    name: str,
) -> float:
    """Return the size that makes `DETECTABLE` standard deviations, to two digits."""
    followed = rig.feature_set
    size, most = followed.first_sizes[name], followed.largest.get(name, math.inf)
    for _ in range(_STEPS):
        distance = float(np.linalg.norm(white @ _change(rig, pairs, name, size)[0]))
        factor = min(max(DETECTABLE / max(distance, 1e-9), 0.2), 5.0)
        size = min(size * factor, most / FACTORS[-1])
        if abs(factor - 1.0) < 0.02:
            break
    return float(f"{size:.2g}")
