# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The DAMADICS actuator as a plant that the house simulates: its faults are numbers of it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.quantity import check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, failure_text, whole_ratio
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.damadics.motion import (
    AIR,
    CLOCK,
    COLUMNS,
    FAULTS,
    MOTOR,
    PRESSURE,
    SENSED,
    STEP_S,
    STROKE,
    Line,
    rest,
    run,
)
from valve_twin.core.valves.damadics.record import WHITE, Process, Wave

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


def _fault(text: str, lower: float = 0.0) -> float:
    return quantity(0.0, "1", f"Strength of fault {text}", lower, 1.0)


@dataclass(frozen=True, slots=True)
class DamadicsPlant(Plant):
    """Faults and process of the simulated actuator; every field carries its unit and range."""

    inputs: ClassVar[tuple[str, ...]] = ("command",)

    clogging: float = _fault("f1, valve clogging")
    sedimentation: float = _fault("f2, plug and seat sedimentation")
    erosion: float = _fault("f3, plug and seat erosion")
    bushing_friction: float = _fault("f4, friction of the bushing", -1.0)
    external_leak: float = _fault("f5, external leak")
    internal_leak: float = _fault("f6, internal leak")
    evaporation: float = _fault("f7, evaporation or critical flow")
    twisted_rod: float = _fault("f8, twisted rod")
    housing_leak: float = _fault("f9, leak of the servomotor's housing")
    diaphragm: float = _fault("f10, perforated diaphragm")
    spring: float = _fault("f11, weak spring")
    transducer: float = _fault("f12, electro-pneumatic transducer", -1.0)
    rod_sensor: float = _fault("f13, sensor of the rod", -1.0)
    chamber_sensor: float = _fault("f14, sensor of the chamber pressure: shows nowhere", -1.0)
    feedback: float = _fault("f15, feedback of the positioner")
    supply_drop: float = _fault("f16, drop of the supply pressure")
    pressure_change: float = _fault("f17, change of a pressure: + behind, - before it", -1.0)
    bypass: float = _fault("f18, open bypass")
    flow_sensor: float = _fault("f19, sensor of the flow: shows in no position", -1.0)
    p1: float = quantity(3.5e6, "Pa", "Mean pressure before the valve", 1e5, 4e6)
    p1_ripple: float = quantity(1.75e5, "Pa", "Amplitude of its wave of 0.1 Hz", 0.0, 1e6)
    p2: float = quantity(2.6e6, "Pa", "Mean pressure behind the valve", 0.0, 4e6)
    p2_ripple: float = quantity(2.6e4, "Pa", "Amplitude of its wave of 1 / pi Hz", 0.0, 1e6)
    temperature: float = quantity(43.0, "C", "Temperature of the water", 0.0, 110.0)
    mass_only: float = quantity(
        0.0, "1", "1 = air chamber by its mass alone; 0 = as in the library", 0.0, 1.0, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_quantities(self)

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how many steps of the integration a sample takes."""
        return whole_ratio(period_s, STEP_S, "period_s", "step")

    def initial_state(self) -> FloatArray:
        """Return the state at rest: open, no air in the chamber."""
        return rest()

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`; the command is the reference itself."""
        samples, every = len(drive.disturbance), self.ticks_per_sample(period_s)
        if drive.commands is None:
            command = np.ascontiguousarray(drive.reference, dtype=np.float64)
        else:
            command = np.repeat(drive.commands[:, 0], every)
        time_s = STEP_S * (round(float(state[CLOCK])) + np.arange(len(command), dtype=np.float64))
        process = Process()
        line = Line(
            command=command,
            p1=Wave(self.p1, self.p1_ripple, process.p1.frequency).at(time_s),
            p2=Wave(self.p2, self.p2_ripple, process.p2.frequency).at(time_s),
            temperature=float(self.temperature),
            faults=self._faults(),
            consistent=self.mass_only > 0.5,
            pushed=_pushed(drive, every),
            stuck=bool(drive.stuck),
            frozen=bool(drive.frozen),
        )
        rows = np.empty((samples, COLUMNS))
        run(state, line, every, rows)
        sent = command[::every].reshape(samples, 1)
        return Response(np.clip(rows[:, SENSED], 0.0, 1.0), sent.copy())

    def failure(self, state: FloatArray) -> str:
        """Return when the integration failed, empty if it did not."""
        failed = not np.isfinite(state).all()
        where = f"air {state[AIR]:g} kg, pressure {state[PRESSURE]:g} Pa, rod {state[MOTOR]:g} m"
        return failure_text(failed, STEP_S * float(state[CLOCK]), where)

    def _faults(self) -> FloatArray:
        """Return the faults that are there, in force from the first step on."""
        names = [field.name for field in fields(self)][:FAULTS]
        found = [(k, getattr(self, name)) for k, name in enumerate(names, 1)]
        rows = [[k, value, -1.0, 0.0, np.inf] for k, value in found if value]
        return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _pushed(drive: Drive, every: int) -> FloatArray:
    """Return what moves the servomotor beside the air, (N,) a step [m]."""
    leak = drive.leak_rate * STEP_S * STROKE
    pushed: FloatArray = drive.disturbance * STROKE / every - leak
    return np.ascontiguousarray(pushed)


def default_simulation() -> SimulationConfig:
    """Return a cycle of steps and ramps through most of the stroke, a sample a second."""
    program = CycleProgram(
        times_s=(0.0, 10.0, 40.0, 70.0, 110.0, 140.0, 180.0, 210.0, 250.0),
        kinds=("hold", "step", "step", "ramp", "step", "step", "ramp", "step", "ramp"),
        targets=(0.3, 0.7, 0.65, 0.3, 0.35, 0.8, 0.4, 0.75, 0.3),
        duration_s=300.0,
    )
    measurement = MeasurementConfig(delay=0, noise=float(WHITE))
    return SimulationConfig(
        plant=DamadicsPlant(), program=program, measurement=measurement, period_s=1.0
    )
