# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The plant of paper 002: a water hydraulic two-stage cartridge valve in a press.

Two groups of pilot valves fill (in) and empty (out) the control chamber over the spindle:

    chamber   (V0 + A_B s)/beta dPc/dt = Q_in - Q_out - Q_leak - A_B ds/dt
    flows     Q_in = R1 y_in sqrt(2 (Pz - Pc)/rho), Q_out = R2 y_out sqrt(2 Pc/rho),
              Q_leak = k sqrt(Pc)
    spindle   M d2s/dt2 + B ds/dt = A_B Pc - A_T Pz, with seats that push but do not pull

(paper 002, eqs. (5)-(9)).

Steps are fixed; pressure and speed are solved together, linearly implicit, so the stiff chamber
needs no small step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, quantity
from valve_twin.core.simulation.config import Scatter, SimulationConfig
from valve_twin.core.simulation.faults import PLANT_KINDS
from valve_twin.core.simulation.plant import Drive, Plant, Response, whole_ratio
from valve_twin.core.valves.press_cartridge.orifice import signed_root
from valve_twin.core.valves.press_cartridge.plant_kernel import (
    PressCoefficients,
    opening,
    run_press,
)
from valve_twin.core.valves.press_cartridge.plc import PlcConfig
from valve_twin.core.valves.press_cartridge.plc import initial_state as plc_state

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class PressCartridgePlant(Plant):
    """Numbers of the simulated valve; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = ("v_in", "v_out")
    fault_kinds: ClassVar[tuple[str, ...]] = (
        *PLANT_KINDS,
        "sensor_offset",
        "sensor_gain",
        "command_loss",
    )

    area_in: float = assumed(
        1.27e-5,
        "m^2",
        "Opening of the filling pilot group at full command (R1 of paper 002)",
        1e-8,
        1e-2,
    )
    area_out: float = assumed(
        1.27e-5,
        "m^2",
        "Opening of the emptying pilot group at full command (R2 of paper 002)",
        1e-8,
        1e-2,
    )
    saturation_in: float = assumed(
        0.05,
        "1",
        "Relative loss of filling pilot opening at full command: y ~ v (1 - s v)",
        0.0,
        0.5,
    )
    saturation_out: float = assumed(
        0.30,
        "1",
        "Relative loss of emptying pilot opening at full command: y ~ v (1 - s v)",
        0.0,
        0.5,
    )
    offset_in: float = quantity(
        0.0, "1", "Filling command below which the pilot stays shut (v0)", lower=0.0, upper=0.5
    )
    offset_out: float = quantity(
        0.0, "1", "Emptying command below which the pilot stays shut (v0)", lower=0.0, upper=0.5
    )
    pilot_lag: float = assumed(8e-3, "s", "Time constant of the pilot valves", 1e-4, 1.0)
    leak: float = assumed(
        3.2e-10, "m^3/(s Pa^0.5)", "Chamber leak over the root of the chamber pressure", 0.0, 1e-6
    )
    piston_area: float = assumed(
        2e-3, "m^2", "Area of the spindle in the chamber (A_B)", 1e-6, 1.0
    )
    area_ratio: float = assumed(
        0.96, "1", "Area under supply pressure over the chamber area (A_T/A_B)", 0.05, 0.99
    )
    preload: float = quantity(
        0.0, "N", "Closing force on the spindle beside that of the supply", lower=-1e6, upper=1e6
    )
    resistance_in: float = quantity(
        1.0,
        "1",
        "Resistance of the filling coil over that when new: the command acts divided by it",
        lower=0.1,
        upper=100.0,
    )
    stiction: float = quantity(
        0.0, "1", "Change of command that a sticking pilot does not follow", lower=0.0, upper=0.5
    )
    mass: float = assumed(80.0, "kg", "Mass of the spindle (M)", 0.01, 1e4)
    damping: float = assumed(2500.0, "N s/m", "Viscous damping of the spindle (B)", 0.0, 1e6)
    stroke: float = assumed(0.9, "m", "Stroke of the spindle (x_max)", 1e-4, 10.0)
    supply_pressure: float = assumed(3e7, "Pa", "Supply pressure (Pz)", 1e5, 2e8)
    density: float = assumed(1000.0, "kg/m^3", "Density of the water", 100.0, 2000.0)
    bulk_modulus: float = assumed(
        2.1e9, "Pa", "Bulk modulus of the water (beta_e); 4e8 with air", 1e7, 1e10
    )
    dead_volume: float = assumed(
        1e-3, "m^3", "Chamber volume with the spindle closed (V0)", 1e-6, 1.0
    )
    step: float = quantity(
        1e-4, "s", "Step of the integration", lower=1e-6, upper=1e-3, assumed=True, ages=False
    )
    plc: PlcConfig = field(default_factory=PlcConfig)

    def __post_init__(self) -> None:
        """Refuse values outside their range and periods that do not divide."""
        check_quantities(self)
        whole_ratio(self.plc.period_s, self.step, "plc.period_s", "step")

    def ticks_per_sample(self, period_s: float) -> int:
        """Return how often the controller runs in one sample of `period_s`."""
        return whole_ratio(period_s, self.plc.period_s, "period_s", "plc.period_s")

    def initial_state(self) -> FloatArray:
        """Return the (10,) state: spindle on its closed seat, chamber drained, pilots shut.

        Position [1], speed [m/s], chamber pressure [Pa], pilot openings in and out [1], position
        read by the controller [1], its integral [s] and off latch, commands that the pilots
        follow [1].
        """
        return np.concatenate([np.zeros(6), plc_state(), np.zeros(2)])

    def with_fault(self, kind: str, severity: float) -> PressCartridgePlant:
        """Return the valve with a fault that is other numbers of it.

        Parameters
        ----------
        kind : str
            One of `PLANT_KINDS`.
        severity : float
            As in `simulation.faults.Fault`; gas is compressed isentropically (exponent 1.4) at
            the balance pressure.
        """
        if kind == "stiction":
            return replace(self, stiction=severity)
        if kind == "preload":
            top_force = self.area_ratio * self.piston_area * self.supply_pressure
            return replace(self, preload=self.preload + severity * top_force)
        if kind == "coil_resistance":
            return replace(self, resistance_in=self.resistance_in * (1.0 + severity))
        if kind == "dead_band":
            offset_in, offset_out = (
                min(offset + severity, 0.5) for offset in (self.offset_in, self.offset_out)
            )
            return replace(self, offset_in=offset_in, offset_out=offset_out)
        if kind == "supply_drop":
            return replace(self, supply_pressure=self.supply_pressure * (1.0 - severity))
        gas = severity / (1.4 * self.area_ratio * self.supply_pressure)
        stiff = 1.0 / (1.0 / self.bulk_modulus + gas)
        return replace(self, bulk_modulus=max(stiff, 1e7))

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`."""
        out = Response.empty(len(drive.disturbance), len(self.inputs))
        forcing = drive.forcing(len(self.inputs))
        run_press(
            state,
            self.coefficients()._replace(
                sensor_gain=float(drive.sensor_gain), sensor_offset=float(drive.sensor_offset)
            ),
            self.plc.settings(),
            whole_ratio(self.plc.period_s, self.step, "plc.period_s", "step"),
            self.ticks_per_sample(period_s),
            forcing._replace(
                disturbance=forcing.disturbance * (self.piston_area * self.stroke / period_s),
                leak_rate=self._leak_coefficient(drive.leak_rate),
            ),
            out,
        )
        return out

    def steady_rate(self, inputs: FloatArray) -> float:
        """Return the speed in mid-stroke under constant commands, leak included [1/s].

        Solves A_B v = Q_in - Q_out - Q_leak with the chamber pressure of a spindle that does not
        accelerate, Pc = (A_T Pz + B v)/A_B.

        Parameters
        ----------
        inputs : (2,) array
            Commands v_in, v_out [1].
        """
        root = math.sqrt(2.0 / self.density)
        command_in = float(inputs[0]) / self.resistance_in
        opening_in = opening(command_in, self.offset_in, self.saturation_in)
        opening_out = opening(float(inputs[1]), self.offset_out, self.saturation_out)

        def imbalance(speed: float) -> float:
            pressure = self.area_ratio * self.supply_pressure
            pressure += (self.preload + self.damping * speed) / self.piston_area
            flow = self.area_in * root * opening_in * signed_root(self.supply_pressure - pressure)
            flow -= self.area_out * root * opening_out * signed_root(pressure)
            return flow - self.leak * signed_root(pressure) - self.piston_area * speed

        span = (self.area_in + self.area_out) * root * math.sqrt(self.supply_pressure)
        span = (span + self.leak * math.sqrt(self.supply_pressure)) / self.piston_area
        from scipy.optimize import brentq  # slow to import, only a simulation needs it

        speed = brentq(imbalance, -span, span, xtol=1e-14, rtol=1e-12)
        return float(speed) / self.stroke

    def _leak_coefficient(self, rate: float) -> float:
        """Return the leak coefficient that loses `rate` of stroke a second at balance pressure."""
        balance = self.area_ratio * self.supply_pressure
        return rate * self.piston_area * self.stroke / math.sqrt(balance)

    def coefficients(self) -> PressCoefficients:
        """Return the numbers of the compiled kernel."""
        root = math.sqrt(2.0 / self.density)
        return PressCoefficients(
            conductance_in=self.area_in * root,
            conductance_out=self.area_out * root,
            saturation_in=float(self.saturation_in),
            saturation_out=float(self.saturation_out),
            offset_in=float(self.offset_in),
            offset_out=float(self.offset_out),
            pilot_share=-math.expm1(-self.step / self.pilot_lag),
            leak=float(self.leak),
            piston_area=float(self.piston_area),
            top_force=self.area_ratio * self.piston_area * self.supply_pressure + self.preload,
            mass=float(self.mass),
            damping=float(self.damping),
            stroke=float(self.stroke),
            supply_pressure=float(self.supply_pressure),
            bulk_modulus=float(self.bulk_modulus),
            dead_volume=float(self.dead_volume),
            step_s=float(self.step),
            resistance_in=float(self.resistance_in),
            stick=float(self.stiction),
        )


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "gas in the water, 8e8 Pa": {"plant.bulk_modulus": 8e8},
        "gas in the water, 4e8 Pa": {"plant.bulk_modulus": 4e8},
        "dead volume 3 times": {"plant.dead_volume": 3e-3},
        "dead volume 10 times": {"plant.dead_volume": 1e-2},
        "spindle 50 % heavier": {"plant.mass": 120.0},
        "damping doubled": {"plant.damping": 5000.0},
        "damping halved": {"plant.damping": 1250.0},
        "pilots of 2 ms": {"plant.pilot_lag": 2e-3},
        "pilots of 16 ms": {"plant.pilot_lag": 16e-3},
        "pilots of 40 ms": {"plant.pilot_lag": 40e-3},
        "top area 0.9": {"plant.area_ratio": 0.9},
        "filling pilots saturate by 20 %": {"plant.saturation_in": 0.2},
        "emptying pilots saturate by 45 %": {"plant.saturation_out": 0.45},
        "filling pilots open at 0.01": {"plant.offset_in": 0.01},
        "filling pilots open at 0.03": {"plant.offset_in": 0.03},
        "emptying pilots open at 0.01": {"plant.offset_out": 0.01},
        "pilots stick by 0.01": {"plant.stiction": 0.01},
        "pilots stick by 0.05": {"plant.stiction": 0.05},
        "supply -10 %": {"plant.supply_pressure": 2.7e7},
        "supply scatters by 2 %": {"scatter.supply_pressure": 0.02},
        "controller of 5 ms": {"plant.plc.period_s": 5e-3},
        "controller half as strong": {"plant.plc.gain_in": 3.0, "plant.plc.gain_out": 1.5},
        "noise 3e-3": {"measurement.noise": 3e-3},
        "noise 3e-5": {"measurement.noise": 3e-5},
        "quantised to 0.005": {"measurement.quantum": 0.005},
        "a new value every 2 samples": {"measurement.refresh": 2},
        "a new value every 4 samples": {"measurement.refresh": 4},
        "position three samples late": {"measurement.delay": 3},
        "position offset 0.003": {"measurement.position_offset": 0.003},
        "commands logged 0.003 higher": {"measurement.command_offsets": (0.003, 0.003)},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return the reference experiment: sensor delay 1, noise 1e-3, supply scatter 0.4 %."""
    return SimulationConfig(
        plant=PressCartridgePlant(), rearm_command=1, scatter=(Scatter("supply_pressure", 0.004),)
    )
