# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A law as a simulated valve: its parameters are the plant's numbers, which age and scatter."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from valve_twin.core.quantity import check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Plant, Response
from valve_twin.core.simulation.program import CycleProgram

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from valve_twin.core.simulation.plant import Drive
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.kit.law import Law

_SHORT_S = 1e-6  # over which a speed is taken [s]


@dataclass(frozen=True, slots=True)
class Program:
    """What a simulated valve is commanded in a cycle, how it is sampled and measured.

    Attributes
    ----------
    cycle : CycleProgram
        The command of the first input over a cycle; every further input follows it.
    period_s : float
        Sampling time [s].
    measurement : MeasurementConfig
        What the sensor makes of the output.
    """

    cycle: CycleProgram
    period_s: float
    measurement: MeasurementConfig


def steps(
    levels: tuple[float, ...], *, every_s: float, period_s: float, noise: float = 1e-3
) -> Program:
    """Return a program of commands: one level after the other.

    Parameters
    ----------
    levels : tuple of float
        Levels of the command, from 0 to 1 [1].
    every_s : float
        How long each is held [s].
    period_s : float
        Sampling time [s].
    noise : float
        Standard deviation of the measured output [unit of the output].
    """
    count = len(levels)
    cycle = CycleProgram(
        times_s=tuple(n * every_s for n in range(count)),
        kinds=("hold",) * count,
        targets=levels,
        duration_s=count * every_s,
    )
    return Program(cycle, period_s, MeasurementConfig(noise=noise))


class LawPlant(Plant):
    """A plant whose numbers are the parameters of a law; `plant_of` makes the dataclass."""

    law: ClassVar[Law]
    fault_kinds: ClassVar[tuple[str, ...]] = ("sensor_offset", "sensor_gain", "command_loss")

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(cast("DataclassInstance", self))

    @property
    def values(self) -> FloatArray:
        """The (P,) parameters in the order of the law."""
        return np.array([getattr(self, p.name) for p in self.law.parameters])

    def initial_state(self) -> FloatArray:
        """Return the (S + M,) state at rest, all 0: the law's, then the inputs before it."""
        return np.zeros(self.law.states + len(self.inputs))

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples as `Plant.run` says. The commands are the reference itself."""
        out = Response.empty(len(drive.disturbance), len(self.inputs))
        self.law.simulate(
            state, self.values, float(period_s), drive.forcing(len(self.inputs)), out
        )
        return out

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed at mid-stroke under constant inputs (M,) [1/s]."""
        x = np.zeros(self.law.states)
        x[0] = 0.5
        self.law.step(x, inputs, self.values, _SHORT_S)
        return float(x[0] - 0.5) / _SHORT_S


def simulation_of(
    name: str, inputs: tuple[str, ...], law: Law, program: Program
) -> SimulationConfig:
    """Return the default simulation of a law.

    Parameters
    ----------
    name : str
        Name of the valve's model.
    inputs : tuple of str
        Names of the inputs.
    law : Law
        The law of motion.
    program : Program
        What is commanded.
    """
    return SimulationConfig(
        plant=plant_of(name, inputs, law),
        program=program.cycle,
        measurement=program.measurement,
        period_s=program.period_s,
    )


def plant_of(name: str, inputs: tuple[str, ...], law: Law) -> LawPlant:
    """Return a new valve's plant: a frozen dataclass with one quantity a parameter.

    Parameters
    ----------
    name : str
        Name of the valve's model.
    inputs : tuple of str
        Names of the inputs.
    law : Law
        The law of motion.
    """
    numbers = []
    for p in law.parameters:
        one = p.published
        number = quantity(p.value, one.unit, one.description, one.lower, one.upper)
        numbers.append((p.name, float, number))
    kind = make_dataclass(
        f"{name.title().replace('_', '')}Plant",
        numbers,
        bases=(LawPlant,),
        namespace={"inputs": inputs, "law": law},
        frozen=True,
    )
    return cast("LawPlant", kind())
