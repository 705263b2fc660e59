# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated servosystem of paper 003: suspension valve, cylinder, lines, load and loops.

The paper prints no value of a parameter: all are assumed, argued as a small actuator of the
20.7 MPa aerospace class. Position 0 = piston in, 1 = out, 0.5 = middle of the stroke.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.physics.hysteresis import mean_reach
from valve_twin.core.quantity import assumed, check_quantities, quantity
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, failure_text
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.servo_system.dynamics import P1, P2, VP, XP, XV
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, rest
from valve_twin.core.valves.servo_system.numbers import COUNT, PHYSICAL, derive
from valve_twin.core.valves.servo_system.plant_kernel import (
    FAILED,
    FIRST,
    INPUTS,
    MEMORY,
    POSITION,
    READ,
    STATE_SIZE,
    STEP,
    TIME,
    Sensors,
    run_plant,
)

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

SLOWEST_PERIOD_S = 4e-3
"""Slowest sampling that shows the modes of structure and fluid, about 100 Hz [s], assumed."""

_SEEDS = 2**30  # of simulations, above the bits of `sensor_seed`


@dataclass(frozen=True, slots=True)
class ServoSystemNumbers:
    """Numbers of the data sheet, which plant and model share: those of `PHYSICAL`, full scales."""

    supply_pressure: float = assumed(20.7e6, "Pa", "Pressure of the supply (P_s)", 1e5, 1e8)
    return_pressure: float = assumed(0.35e6, "Pa", "Pressure of the return (P_r)", 0.0, 1e8)
    density: float = assumed(860.0, "kg/m^3", "Density of the fluid (rho)", 500.0, 2000.0)
    viscosity: float = assumed(0.014, "Pa s", "Viscosity of the fluid (mu)", 1e-4, 10.0)
    bulk_modulus: float = assumed(1e9, "Pa", "Bulk modulus without air (beta)", 1e8, 1e10)
    air_share: float = assumed(0.002, "1", "Entrained air, share at atmosphere", 0.0, 0.2)
    line_bore: float = assumed(4.6e-3, "m", "Bore of all lines (d)", 1e-4, 0.1)
    line_wall: float = assumed(0.9e-3, "m", "Wall of all lines (t_w)", 1e-4, 0.1)
    line_modulus: float = assumed(190e9, "Pa", "Elastic modulus of the lines (E)", 1e6, 1e12)
    supply_length: float = assumed(1.5, "m", "Length of the supply line (l_s)", 0.01, 100.0)
    return_length: float = assumed(1.5, "m", "Length of the return line (l_r)", 0.01, 100.0)
    length_1: float = assumed(0.3, "m", "Line to chamber 1 (l_1)", 1e-3, 10.0)
    length_2: float = assumed(0.3, "m", "Line to chamber 2 (l_2)", 1e-3, 10.0)
    supply_losses: float = assumed(4.0, "1", "Fittings of the supply line (sum k_s)", 0.0, 1e3)
    return_losses: float = assumed(4.0, "1", "Fittings of the return line (sum k_r)", 0.0, 1e3)
    piston_losses: float = assumed(3.0, "1", "Fittings of each chamber's line", 0.0, 1e3)
    area_1: float = assumed(3.14e-4, "m^2", "Piston area of chamber 1 (A_p1)", 1e-6, 1.0)
    area_2: float = assumed(2.36e-4, "m^2", "Piston area of chamber 2 (A_p2)", 1e-6, 1.0)
    stroke: float = assumed(0.08, "m", "Travel of the piston, stands for 1", 1e-3, 10.0)
    dead_length: float = assumed(2e-3, "m", "Room left in a chamber at its end", 1e-5, 1.0)
    piston_mass: float = assumed(0.35, "kg", "Mass of the piston (m_p)", 1e-3, 1e4)
    coulomb_friction: float = assumed(
        25.0, "N", "Friction of the piston's seals in motion", 0.0, 1e5
    )
    static_friction: float = assumed(40.0, "N", "Break-away force of the seals", 0.0, 1e5)
    viscous_friction: float = assumed(60.0, "N s/m", "Viscous friction of the piston", 0.0, 1e6)
    creep_speed: float = assumed(2e-3, "m/s", "Speed over which friction turns", 1e-5, 1.0)
    decay_speed: float = assumed(1e-2, "m/s", "Speed over which break-away falls", 1e-4, 1.0)
    structural_stiffness: float = assumed(1.5e6, "N/m", "Member to the load (k_s)", 1e3, 1e10)
    structural_damping: float = assumed(600.0, "N s/m", "Damping of the member (b_s)", 0.0, 1e6)
    load_inertia: float = assumed(0.15, "kg m^2", "Inertia of the load (I_L)", 1e-4, 1e4)
    arm: float = assumed(0.08, "m", "Lever arm of the load (l_a)", 1e-3, 10.0)
    load_damping: float = assumed(0.6, "N m s/rad", "Damping of the load (b_g)", 0.0, 1e5)
    load_torque: float = assumed(0.0, "N m", "Torque on the load from outside", -1e5, 1e5)
    port_radius: float = assumed(0.35e-3, "m", "Radius of the orifices (r)", 1e-5, 0.05)
    clearance: float = assumed(4e-6, "m", "Clearance at the pipe tip (c)", 1e-7, 1e-3)
    supply_underlap: float = assumed(8e-6, "m", "Underlap of supply orifices (u_s)", 0.0, 0.1)
    return_underlap: float = assumed(12e-6, "m", "Underlap of return orifices (u_r)", 0.0, 0.1)
    valve_travel: float = assumed(220e-6, "m", "Travel of the pipe to a stop", 1e-6, 0.05)
    valve_mass: float = assumed(2e-3, "kg", "Moving mass of the valve (m_v)", 1e-6, 10.0)
    valve_stiffness: float = assumed(3822.0, "N/m", "Pipe and magnet together (k_v)", 1.0, 1e8)
    valve_damping_ratio: float = assumed(
        1.0, "1", "Damping of the valve over critical", 0.01, 10.0
    )
    discharge: float = assumed(0.62, "1", "Discharge of the four orifices (C_d)", 0.05, 1.5)
    leak_discharge: float = assumed(0.55, "1", "Discharge of the leakage (C_dL)", 0.0, 1.5)
    motor_gain: float = assumed(22.0, "N/A", "Force and back EMF constant (B)", 1e-3, 1e5)
    motor_force: float = assumed(1.15, "N", "Force at which the motor saturates", 1e-4, 1e5)
    hysteresis_width: float = assumed(2.4e-3, "A", "Half width of a large loop", 0.0, 10.0)
    hysteresis_reach: float = assumed(0.01, "A", "Way that opens a loop fully", 1e-6, 10.0)
    inductance: float = assumed(0.03, "H", "Of the motor (L_e)", 1e-6, 100.0)
    resistance: float = assumed(20.0, "ohm", "Of the motor (R_e)", 1e-3, 1e5)
    current_gain: float = assumed(150.0, "V/A", "Current loop (k_if)", 0.0, 1e6)
    current_feedback: float = assumed(1.0, "1", "Current loop (k_ib)", 0.0, 100.0)
    current_limit: float = assumed(0.06, "A", "Largest desired current", 1e-5, 100.0)
    flow_force: float = assumed(6.0, "N s/m^2.5", "Flow force (k_Q)", 0.0, 1e4)
    flow_force_offset: float = assumed(2e-5, "m", "Of the flow force (k_1)", 1e-9, 1e-2)
    position_gain: float = assumed(8.0, "A/m", "Position loop (k_p)", 0.0, 1e5)
    velocity_gain: float = assumed(0.02, "A s/m", "Velocity loop (k_vel)", 0.0, 1e4)
    force_gain: float = assumed(1e-6, "A/N", "Force loop (k_f)", 0.0, 1.0)
    nominal_force: float = assumed(1000.0, "N", "Force that scales k_f", 1e-3, 1e7)
    linear_pressure: float = assumed(
        5e3, "Pa", "Pressure drop below which flows are linear", 1.0, 1e6, ages=False
    )
    current_scale: float = assumed(0.06, "A", "Full scale of the current", 1e-5, 1e3, ages=False)
    valve_scale: float = assumed(
        250e-6, "m", "Full scale of valve position", 1e-6, 1.0, ages=False
    )
    pressure_scale: float = assumed(
        25e6, "Pa", "Full scale of supply and chambers", 1e4, 1e9, ages=False
    )
    return_scale: float = assumed(2e6, "Pa", "Full scale of return pressure", 1e4, 1e9, ages=False)
    speed_scale: float = assumed(
        0.25, "m/s", "Full scale of the load's speed", 1e-3, 1e3, ages=False
    )


@dataclass(frozen=True, slots=True)
class ServoSystemPlant(ServoSystemNumbers, Plant):
    """Numbers of the servosystem; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = INPUTS

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
        state = np.zeros(STATE_SIZE)
        settled = rest(0.0, self.numbers(), state[FIRST:MEMORY], state[MEMORY:STEP])
        state[POSITION] = state[FIRST + XP] / self.stroke + 0.5
        state[READ] = state[FIRST + XP]
        state[STEP] = FIRST_STEP
        state[FAILED] = 0.0 if settled else 1.0
        return state

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`.

        Where the integration fails, positions are NaN from there on, and `failure` says when and
        where.
        """
        out = Response.empty(len(drive.disturbance), len(INPUTS))
        run_plant(
            state,
            self.numbers(),
            self.sensors(drive.seed),
            float(self.tolerance),
            float(period_s),
            drive.forcing(len(INPUTS)),
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
        y = state[FIRST:MEMORY]
        return failure_text(
            state[FAILED],
            state[TIME],
            f"x_p = {y[XP]:g} m, v_p = {y[VP]:g} m/s, x_v = {y[XV]:g} m, P_f1 = {y[P1]:g} Pa, "
            f"P_f2 = {y[P2]:g} Pa, step {state[STEP]:g} s",
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
