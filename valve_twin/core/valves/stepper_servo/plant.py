# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated stepper valve of paper 004: drive, lead screw, backlash, flow, sensor, control."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import exp
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.control.stepper import StepperConfig
from valve_twin.core.quantity import assumed, check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, whole_ratio
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.stepper_servo import plant_kernel as at
from valve_twin.core.valves.stepper_servo.plant_kernel import Valve, run_plant

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray


LONGEST_PERIOD_S = 0.2
"""Slowest sampling at which the backlash is found within 5 % and the edges within 0.01 mm [s]."""

_EDGES = ("full_lower", "band_lower", "band_upper", "full_upper", "stroke")


def check_period(period_s: float) -> str:
    """Return why a sampling time is too slow for this valve [s], empty if it is not."""
    if period_s <= LONGEST_PERIOD_S:
        return ""
    return (
        f"period_s = {period_s:g}: must be at most {LONGEST_PERIOD_S:g} [s] to tell a flank of "
        "the thread from the other"
    )


@dataclass(frozen=True, slots=True)
class StepperServoPlant(Plant):
    """Numbers of the stepper valve; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = ("motor_position", "flow")
    constants: ClassVar[Mapping[str, str]] = MappingProxyType({"step_size": "count_scale"})

    stroke: float = assumed(2.1e-3, "m", "Spool travel that stands for 1", 1e-5, 1.0)
    steps_per_turn: int = quantity(20, "1", "Full steps a turn: 18 degrees", 2, 10000)
    lead: float = quantity(0.2e-3, "m", "Travel a turn of the screw", 1e-6, 0.1)
    backlash: float = quantity(0.1e-3, "m", "Backlash of screw and cylinder: 10 steps", 0.0, 1e-2)
    lost_share: float = assumed(0.0, "1", "Share of the upward steps that slip", 0.0, 0.9)
    band_lower: float = quantity(0.45e-3, "m", "Lower edge of the dead band", 0.0, 1.0)
    band_upper: float = quantity(1.70e-3, "m", "Upper edge of the dead band", 0.0, 1.0)
    full_lower: float = quantity(
        0.2e-3, "m", "Below this the flow is saturated", 0.0, 1.0, ages=False
    )
    full_upper: float = quantity(
        1.9e-3, "m", "Above this the flow is saturated", 0.0, 1.0, ages=False
    )
    flow_full: float = quantity(
        1.0, "1", "Saturated flow in parts of the meter's range", 0.0, 10.0
    )
    flow_lag: float = assumed(0.05, "s", "Time constant of the flow meter", 0.0, 10.0)
    edge_power: float = assumed(
        1.0, "1", "Power of the opening that flows: 1 = sharp edges, above = soft", 0.5, 3.0
    )
    backlash_taper: float = assumed(
        0.0, "1", "Change of the backlash from end to end of the screw", -1.0, 1.0
    )
    count_scale: float = assumed(
        1.0, "1", "Travel of a counted step as published over the true one", 0.5, 2.0
    )
    window: int = assumed(8, "ticks", "Moving average of the position sensor", 1, at.MAX_WINDOW)
    controller: StepperConfig = field(default_factory=StepperConfig)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and edges in the wrong order."""
        check_quantities(self)
        for name, after in pairwise(_EDGES):
            mine, limit = getattr(self, name), getattr(self, after)
            if mine >= limit:
                message = (
                    f"StepperServoPlant.{name} = {mine!r}: must be below {after} = {limit!r} [m]"
                )
                raise ValueError(message)
        if self.step_size > 0.5 * self.stroke:
            message = (
                f"StepperServoPlant.lead = {self.lead!r}: must be at most "
                f"{0.5 * self.stroke * self.steps_per_turn:g} [m], so that a step of "
                "lead / steps_per_turn fits into half the stroke"
            )
            raise ValueError(message)

    @property
    def step_size(self) -> float:
        """Travel of a full step [m]."""
        return self.lead / self.steps_per_turn

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how many base samples of the controller a sample takes."""
        refusal = check_period(period_s)
        if refusal:
            raise ValueError(refusal)
        return whole_ratio(period_s, self.controller.period_s, "period_s", "controller.period_s")

    def initial_state(self) -> FloatArray:
        """Return the state at rest in the middle of the dead band, counter and rotor agreeing."""
        state = np.zeros(at.STATE_SIZE)
        middle = 0.5 * (self.band_lower + self.band_upper)
        steps = round(middle / self.step_size)
        state[at.COUNT] = state[at.ROTOR] = steps
        state[at.SENSED] = state[at.SPOOL] = steps * self.step_size / self.stroke
        state[at.LINE :] = state[at.SPOOL]
        return state

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`. The position is the sensor's average."""
        out = Response.empty(len(drive.disturbance), len(self.inputs))
        run_plant(
            state,
            self._numbers(),
            self.controller.settings(),
            float(self.controller.period_s),
            self.ticks_per_sample(period_s),
            drive.forcing(len(self.inputs)),
            out,
        )
        return out

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed at mid-stroke towards a motor position from outside [1/s]."""
        away = float(inputs[0]) - 0.5
        step = self.step_size / self.stroke
        return float(np.sign(away)) * step / self.controller.period_s if abs(away) > step else 0.0

    def _numbers(self) -> Valve:
        unit = 1.0 / self.stroke
        tick = self.controller.period_s
        return Valve(
            step=self.step_size * unit,
            counted=self.step_size * unit * self.count_scale,
            backlash=self.backlash * unit,
            lost_share=float(self.lost_share),
            band_lower=self.band_lower * unit,
            band_upper=self.band_upper * unit,
            full_lower=self.full_lower * unit,
            full_upper=self.full_upper * unit,
            flow_full=float(self.flow_full),
            flow_share=1.0 - exp(-tick / self.flow_lag) if self.flow_lag > 0.0 else 1.0,
            volts=self.stroke * self.controller.volts_per_metre,
            window=int(self.window),
            edge_power=float(self.edge_power),
            backlash_taper=float(self.backlash_taper),
        )


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "edges of power 1.03": {"plant.edge_power": 1.03},
        "edges of power 1.1": {"plant.edge_power": 1.1},
        "edges of power 1.2": {"plant.edge_power": 1.2},
        "edges of power 1.5": {"plant.edge_power": 1.5},
        "edges of power 0.9": {"plant.edge_power": 0.9},
        "backlash varies by 5 %": {"plant.backlash_taper": 0.05},
        "backlash varies by 10 %": {"plant.backlash_taper": 0.1},
        "backlash varies by 30 %": {"plant.backlash_taper": 0.3},
        "backlash varies by -50 %": {"plant.backlash_taper": -0.5},
        "1 % of the steps slip": {"plant.lost_share": 0.01},
        "meter of 0.15 s": {"plant.flow_lag": 0.15},
        "meter of 0.01 s": {"plant.flow_lag": 0.01},
        "average of 4 ms": {"plant.window": 4},
        "average of 32 ms": {"plant.window": 32},
        "lower slope half as wide": {"plant.full_lower": 0.000325},
        "screw 2 % steeper": {"plant.lead": 0.000204},
        "noise 6.3 um": {"measurement.noise": 0.003},
        "quantised to 10.5 um": {"measurement.quantum": 0.005},
        "backlash 0.02 mm": {"plant.backlash": 2e-05},
        "backlash 0.3 mm": {"plant.backlash": 0.0003},
        "three samples late": {"measurement.delay": 3},
        "stroke 2 % longer": {"plant.stroke": 0.002142},
        "counted steps 0.1 % longer": {"plant.count_scale": 1.001},
        "counted steps 0.5 % longer": {"plant.count_scale": 1.005},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return a cycle through both openings, fast and slowly, sampled every 10 ms."""
    program = CycleProgram(
        times_s=(0.0, 1.0, 3.0, 5.0, 9.0, 10.5, 12.5, 16.5, 18.0),
        kinds=("hold", "step", "step", "ramp", "step", "step", "ramp", "step", "step"),
        targets=(0.5, 0.93, 0.86, 0.78, 0.5, 0.1, 0.24, 0.6, 0.5),
        duration_s=20.0,
        step_time_s=0.2,
    )
    return SimulationConfig(plant=StepperServoPlant(), program=program, period_s=0.01)
