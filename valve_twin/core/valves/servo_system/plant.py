# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated servosystem of paper 003: suspension valve, cylinder, lines, load and loops.

The paper prints no value of a parameter: all are assumed, argued as a small actuator of the
20.7 MPa aerospace class. Position 0 = piston in, 1 = out, 0.5 = middle of the stroke.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.physics.hysteresis import mean_reach
from valve_twin.core.quantity import assumed, check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, failure_text
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import plant_kernel as at
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, rest
from valve_twin.core.valves.servo_system.numbers import COUNT, PHYSICAL, ServoSystemNumbers, derive
from valve_twin.core.valves.servo_system.plant_kernel import Sensors, run_plant

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

SLOWEST_PERIOD_S = 4e-3
"""Slowest sampling that shows the modes of structure and fluid, about 100 Hz [s], assumed."""

_SEEDS = 2**30  # of simulations, above the bits of `sensor_seed`


@dataclass(frozen=True, slots=True)
class ServoSystemPlant(ServoSystemNumbers, Plant):
    """Numbers of the servosystem; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = at.INPUTS

    sensor_noise: float = assumed(
        1e-3, "1", "Noise of every signal but the position, of full scale", 0.0, 0.1, ages=False
    )
    sensor_quantum: float = assumed(
        2.0**-11,
        "1",
        "Steps of every signal but the position, of full scale",
        0.0,
        0.1,
        ages=False,
    )
    sensor_seed: int = quantity(
        0, "1", "Seed of the sensors' noise, beside that of the simulation", 0, 2**31
    )
    tolerance: float = assumed(
        1e-5, "1", "Allowed relative error of an integration step", 1e-10, 1e-2, ages=False
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range and those that contradict each other."""
        check_quantities(self)
        refusal = check_numbers({name: float(getattr(self, name)) for name in PHYSICAL})
        if refusal:
            message = f"ServoSystemPlant.{refusal}"
            raise ValueError(message)

    def ticks_per_sample(self, period_s: float) -> int:
        """Return 1: the loops are continuous, the reference is held for a sample."""
        if period_s > SLOWEST_PERIOD_S:
            message = (
                f"period_s = {period_s!r}: must be a number from 0 to {SLOWEST_PERIOD_S:g} [s], "
                "the modes of structure and fluid lie at about 100 Hz"
            )
            raise ValueError(message)
        return 1

    def initial_state(self) -> FloatArray:
        """Return the state (STATE_SIZE,): at rest about the middle, the motor demagnetised."""
        state = np.zeros(at.STATE_SIZE)
        settled = rest(
            0.0, self.numbers(), state[at.FIRST : at.MEMORY], state[at.MEMORY : at.STEP]
        )
        state[at.POSITION] = state[at.FIRST + dyn.XP] / self.stroke + 0.5
        state[at.READ] = state[at.FIRST + dyn.XP]
        state[at.STEP] = FIRST_STEP
        state[at.FAILED] = 0.0 if settled else 1.0
        return state

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`.

        Where the integration fails, positions are NaN from there on, and `failure` says when and
        where.
        """
        out = Response.empty(len(drive.disturbance), len(at.INPUTS))
        run_plant(
            state,
            self.numbers(),
            self.sensors(drive.seed),
            float(self.tolerance),
            float(period_s),
            drive.forcing(len(at.INPUTS)),
            out,
        )
        return out

    def failure(self, state: FloatArray) -> str:
        """Return when and in what state the integration failed, empty if it did not.

        Parameters
        ----------
        state : (STATE_SIZE,) array
            The state that `run` has written.
        """
        y = state[at.FIRST : at.MEMORY]
        return failure_text(
            state[at.FAILED],
            state[at.TIME],
            f"x_p = {y[dyn.XP]:g} m, v_p = {y[dyn.VP]:g} m/s, x_v = {y[dyn.XV]:g} m, "
            f"P_f1 = {y[dyn.P1]:g} Pa, P_f2 = {y[dyn.P2]:g} Pa, step {state[at.STEP]:g} s",
        )

    def numbers(self) -> FloatArray:
        """Return the numbers for the compiled functions, (COUNT,)."""
        p = np.zeros(COUNT)
        p[: len(PHYSICAL)] = [float(getattr(self, name)) for name in PHYSICAL]
        derive(p)
        return p

    def sensors(self, seed: int = 0) -> Sensors:
        """Return the numbers of the sensors; their noise differs with the simulation's `seed`."""
        return Sensors(
            current=float(self.current_scale),
            valve=float(self.valve_scale),
            pressure=float(self.pressure_scale),
            return_pressure=float(self.return_scale),
            speed=float(self.speed_scale),
            noise=float(self.sensor_noise),
            quantum=float(self.sensor_quantum),
            seed=int(self.sensor_seed) + (seed % _SEEDS << 32),
        )


def check_numbers(n: dict[str, float]) -> str:
    """Return which number contradicts another, its value and allowed range, empty if none.

    Parameters
    ----------
    n : dict
        Numbers by the names of `PHYSICAL`.
    """
    port = 2.0 * n["port_radius"]
    reach = mean_reach(n["hysteresis_reach"])
    upper = {
        "return_pressure": (n["supply_pressure"], "supply_pressure"),
        "supply_underlap": (port, "the port, 2 port_radius"),
        "return_underlap": (port, "the port, 2 port_radius"),
        "valve_travel": (port, "the port, 2 port_radius"),
        "coulomb_friction": (n["static_friction"], "static_friction"),
        "hysteresis_width": (0.9 * reach, "0.9 of the mean reach of the plays"),
        "area_2": (n["area_1"] * 10.0, "10 area_1"),
        "stroke": (1.8 * n["arm"], "1.8 arm: the load must not turn by a quarter"),
    }
    for name, (most, what) in upper.items():
        if n[name] > most:
            return f"{name} = {n[name]!r}: must be a number from 0 to {most:g}, {what}"
    return ""


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "piston area 1 +0.2 %": {"plant.area_1": 0.000314628},
        "piston area 2 -0.2 %": {"plant.area_2": 0.00023552799999999999},
        "viscosity +10 %": {"plant.viscosity": 0.0154},
        "load inertia +5 %": {"plant.load_inertia": 0.1575},
        "density +1 %": {"plant.density": 868.6},
        "load damping +10 %": {"plant.load_damping": 0.66},
        "load inertia +10 %": {"plant.load_inertia": 0.165},
        "piston mass +20 %": {"plant.piston_mass": 0.42},
        "stroke +0.2 %": {"plant.stroke": 0.08016},
        "lever arm +0.2 %": {"plant.arm": 0.08016},
        "valve stiffness +2 %": {"plant.valve_stiffness": 3898.44},
        "motor gain +2 %": {"plant.motor_gain": 22.44},
        "clearance +10 %": {"plant.clearance": 4.4e-06},
        "supply underlap +10 %": {"plant.supply_underlap": 8.8e-06},
        "orifices +1 %": {"plant.port_radius": 0.0003535},
        "flow force +20 %": {"plant.flow_force": 7.2},
        "pressure sensors +0.5 %": {"plant.pressure_scale": 25125000.0},
        "supply line 5 % longer": {"plant.supply_length": 1.575},
        "dead length +50 %": {"plant.dead_length": 0.003},
        "friction turns over twice the speed": {"plant.creep_speed": 0.004},
        "5 N m on the load": {"plant.load_torque": 5.0},
        "sensors three times as noisy": {"plant.sensor_noise": 0.003},
        "hysteresis opens over 10 % more": {"plant.hysteresis_reach": 0.011},
        "bore of the lines +2 %": {"plant.line_bore": 0.004692},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return a cycle of moves of several lengths and speeds in 4 s, sampled every ms."""
    program = CycleProgram(
        times_s=(0.0, 0.4, 0.8, 1.0, 1.15, 1.45, 1.7, 2.0, 2.25, 3.0),
        kinds=("step", "step", "step", "step", "step", "step", "step", "step", "ramp", "step"),
        targets=(0.8, 0.3, 0.4, 0.35, 0.55, 0.15, 0.45, 0.25, 0.65, 0.5),
        duration_s=4.0,
        step_time_s=0.0,
    )
    return SimulationConfig(
        plant=ServoSystemPlant(),
        program=program,
        measurement=MeasurementConfig(delay=0, noise=1e-3, quantum=2.0**-11),
        period_s=1e-3,
    )
