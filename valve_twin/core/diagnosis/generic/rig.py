# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Any simulated valve with the faults of any valve, and the model that looks at its cycles."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.derive import SimulatedBench
from valve_twin.core.diagnosis.generic.faults import FAULTS, Sensed, source
from valve_twin.core.diagnosis.generic.features import Record, cycle_features
from valve_twin.core.diagnosis.generic.moves import find_moves
from valve_twin.core.diagnosis.generic.reference import (
    REFERENCE_CYCLES,
    Reference,
    features_of,
    record_against,
    reference_of,
)
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.types import Cycle, ParameterValue
from valve_twin.core.valves.interface import ValveModel

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.diagnosis.generic.motion import Motion
    from valve_twin.core.simulation.block import SimulationBlock
    from valve_twin.core.simulation.config import SimulationConfig
    from valve_twin.core.types import FloatArray


_SAMPLED = 8
"""Stream of the random numbers of where moves begin between two samples."""


class FaultyValve:
    """A simulated valve whose motion or sensor may have a fault.

    What the plant does does not depend on such a fault: copies share it and simulate it once.

    Parameters
    ----------
    simulation : SimulationConfig
        The valve.
    seed : int
        Of all random numbers.
    """

    def __init__(self, simulation: SimulationConfig, seed: int) -> None:
        self._valve = SimulatedValve(simulation, seed)
        self._blocks: list[SimulationBlock] = []
        self._seed, self._at = seed, 0
        self._fault, self._size = "", 0.0
        self.reference: Reference | None = None

    def __deepcopy__(self, memo: object) -> FaultyValve:
        """Return a valve that goes on from here by itself."""
        del memo
        return copy(self)

    @property
    def cycle(self) -> int:
        """Return the number of the cycle that comes next."""
        return self._at + 1

    def set_fault(self, kind: str, severity: float) -> None:
        """Begin with a fault of `FAULTS` in the cycle that comes next."""
        self._fault, self._size = kind, severity

    def next_cycle(self) -> tuple[SimulationBlock, FloatArray]:
        """Return the next cycle, and its (N,) motion as a perfect sensor shows it."""
        while len(self._blocks) <= self._at:
            self._blocks.append(self._valve.advance(self._valve.config.cycle_samples))
        block = self._blocks[self._at]
        past = self._blocks[max(self._at - 1, 0)]
        late = self._valve.config.measurement.delay
        both = np.concatenate((past.true_position, block.true_position))
        motion = both[len(past) - late : len(both) - late]
        self._at += 1
        if self._fault:
            block = replace(block, position=self._sensed(past, block, late))
        return block, motion

    def _sensed(self, past: SimulationBlock, block: SimulationBlock, late: int) -> FloatArray:
        """Return what is measured under the fault: what it was before a cycle matters, too."""
        motion = np.concatenate((past.true_position, block.true_position))
        motion = np.concatenate((np.full(late, motion[0]), motion))[: len(motion)]
        measured = np.concatenate((past.position, block.position))
        span = float(np.ptp(block.true_position))
        sensed = Sensed(
            motion / span,
            (measured - motion) / span,
            self._valve.config.period_s,
            source(self._seed, self._at),
        )
        shown = span * FAULTS[self._fault](sensed, self._size)[len(past) :]
        step = self._valve.config.measurement.quantum
        return step * np.round(shown / step) if step > 0.0 else shown


class ModelRig(SimulatedBench[ValveModel]):
    """A simulated valve and its model, fitted to the first cycles of each record."""

    __slots__ = ()

    def start(self, seed: int) -> FaultyValve:
        """Return a valve whose first cycles gave the model that it is held against."""
        valve = FaultyValve(self.simulation, seed)
        memory = Memory.empty()
        while valve.reference is None:
            if valve.cycle > 4 * REFERENCE_CYCLES:
                msg = f"{self.model.name}: its simulated cycles give no estimates"
                raise ValueError(msg)
            block, _ = valve.next_cycle()
            cycle = Cycle(valve.cycle, self.simulation.period_s, to_frames(block))
            memory = estimate_cycle(self.model, self.options, cycle, memory)[1]
            valve.reference = reference_of(self.model, memory.estimates)
        return valve

    def run(self, valve: FaultyValve, cycles: int) -> FloatArray:
        """Run a valve on and return the features of its next cycles, (cycles, F)."""
        rows = []
        for _ in range(cycles):
            block, _ = valve.next_cycle()
            cycle = Cycle(valve.cycle, self.simulation.period_s, to_frames(block))
            rows.append(self.row(record_against(self.model, self.options, valve.reference, cycle)))
        return np.array(rows)

    def row(self, record: Record) -> FloatArray:
        """Return what is looked at of a cycle: its features as they are followed, (F,)."""
        return self.feature_set.vector(features_of(self.model, record))


@dataclass(frozen=True, slots=True)
class IdealRig:
    """A simulated valve held against its own true motion: a model without error.

    Attributes
    ----------
    simulation : SimulationConfig
        The valve.
    feature_set : FeatureSet
        Which features, and how they are followed.
    """

    simulation: SimulationConfig
    feature_set: FeatureSet

    @property
    def cycle_samples(self) -> int:
        """Return the number of samples of a cycle."""
        return self.simulation.cycle_samples

    def start(self, seed: int) -> FaultyValve:
        """Return a valve behind its first cycle."""
        valve = FaultyValve(self.simulation, seed)
        valve.next_cycle()
        return valve

    def run(self, valve: FaultyValve, cycles: int) -> FloatArray:
        """Run a valve on and return the features of its next cycles, (cycles, F)."""
        rows = []
        for _ in range(cycles):
            block, motion = valve.next_cycle()
            none = np.zeros((len(block), 0))
            record = Record(block.position, motion, self.simulation.period_s, none)
            found = cycle_features(record)
            rows.append(self.feature_set.vector(ParameterValue(n, v) for n, v in found.items()))
        return np.array(rows)


@dataclass(slots=True)
class MovedValve:
    """A valve that makes the same motion in each cycle; only its faults and chances differ."""

    seed: int
    cycle: int = 0
    fault: str = ""
    size: float = 0.0

    def set_fault(self, kind: str, severity: float) -> None:
        """Begin with a fault of `FAULTS` in the cycle that comes next."""
        self.fault, self.size = kind, severity


@dataclass(frozen=True, slots=True)
class MotionRig:
    """A motion that was made, held against itself.

    Attributes
    ----------
    motion : Motion
        The valve's own.
    positions : (N,) array
        What it gives at each sample over the span [1].
    feature_set : FeatureSet
        Which features, and how they are followed.
    """

    motion: Motion
    positions: FloatArray
    feature_set: FeatureSet

    @property
    def cycle_samples(self) -> int:
        """Return the number of samples of a cycle."""
        return len(self.positions)

    def start(self, seed: int) -> MovedValve:
        """Return a valve before its first cycle."""
        return MovedValve(seed)

    def run(self, valve: MovedValve, cycles: int) -> FloatArray:
        """Run a valve on and return the features of its next cycles, (cycles, F)."""
        rows, own, period_s = [], self.positions, self.motion.period_s
        for _ in range(cycles):
            valve.cycle += 1
            chance = np.random.default_rng([valve.seed, valve.cycle])
            noise = self.motion.sigma * chance.standard_normal(len(own))
            sensed = Sensed(own, noise, period_s, source(valve.seed, valve.cycle))
            y = FAULTS[valve.fault](sensed, valve.size) if valve.fault else own + noise
            rows.append(self._row(y))
        return np.array(rows)

    def sampled(self, seed: int, cycles: int) -> FloatArray:
        """Return the features of cycles whose moves begin up to a sample earlier or later.

        A logger does not resolve more: two strokes that differ by a sample are alike to it.

        Parameters
        ----------
        seed : int
            Of all random numbers.
        cycles : int
            How many [1].

        Returns
        -------
        (cycles, F) array
            As they are followed [unit by feature].
        """
        own, rows = self.positions, []
        moves = find_moves(own)[0]
        for cycle in range(cycles):
            chance = np.random.default_rng([seed, cycle, _SAMPLED])
            y = own.copy()
            for move, late in zip(
                moves, chance.triangular(-1.0, 0.0, 1.0, len(moves)), strict=True
            ):
                part = own[move.first : move.next]
                t = np.arange(len(part), dtype=np.float64)
                y[move.first : move.next] = np.interp(t - late, t, part)
            rows.append(self._row(y + self.motion.sigma * chance.standard_normal(len(y))))
        return np.array(rows)

    def _row(self, position: FloatArray) -> FloatArray:
        """Return the features of a cycle (N,) as they are followed, (F,)."""
        step, none = self.motion.step, np.zeros((len(position), 0))
        y = step * np.round(position / step) if step else position
        found = cycle_features(Record(y, self.positions, self.motion.period_s, none, span=1.0))
        return self.feature_set.vector(ParameterValue(n, v) for n, v in found.items())
