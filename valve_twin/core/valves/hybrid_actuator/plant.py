# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The plant of paper 001: an engine valve thrown to and fro by springs, caught by two solenoids.

Opening: the closing solenoid gets an inverse pulse that weakens its magnet, the springs throw the
armature across, the opening solenoid catches it and its magnet holds it. Closing is the mirror
image. Position 0 = closed, 1 = open; voltages are shares of the supply, currents of the sensors'
full scale.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.control.current_loop import CurrentSensor
from valve_twin.core.quantity import assumed, check_quantities, compiled, quantity, setting
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, failure_text, whole_ratio
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.hybrid_actuator import plant_kernel as at
from valve_twin.core.valves.hybrid_actuator.landing import loop
from valve_twin.core.valves.hybrid_actuator.landing.loop import run_landing
from valve_twin.core.valves.hybrid_actuator.landing.numbers import LandingNumbers
from valve_twin.core.valves.hybrid_actuator.magnetics import (
    FIT,
    KERNELS,
    REGULAR,
    Magnetics,
    magnet_flux,
)
from valve_twin.core.valves.hybrid_actuator.plant_kernel import (
    Armature,
    Bridge,
    Clock,
    run_actuator,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

INPUTS = ("opener_voltage", "closer_voltage", "opener_current", "closer_current")

CONTROLS = ("sequence", "soft_landing")
"""What drives the bridges: pulses of fixed length, or a controller of the seating speed."""

SMALLEST_FIT_GAP = 1e-4
"""Smallest gap of the reading "fit" [m]; its pole lies at C2, 0.0604 mm in the paper."""

LONGEST_PERIOD_S = 2.5e-4
"""Slowest sampling that shows pulses of 1.5 ms and flights of 8 ms [s], assumed."""

_LONG_AGO = 3600.0  # time since the last command at rest [s]
_ABOVE_POLE = 4e-5  # the same distance to the pole for another C2 [m]


def check_gap(kernel: str, residual_gap: float, c2: float) -> str:
    """Return why a residual gap cannot be used with a kernel, empty if it can.

    Parameters
    ----------
    kernel : str
        One of `KERNELS`.
    residual_gap : float
        Smallest gap that the armature reaches [m].
    c2 : float
        C2 of the saturating kernel [m].
    """
    least = max(SMALLEST_FIT_GAP, c2 + _ABOVE_POLE)
    if kernel != KERNELS[FIT] or residual_gap >= least:
        return ""
    return (
        f"residual_gap = {residual_gap!r}: must be a number from {least:g} to 0.005 [m] with "
        f"kernel '{kernel}', which has a pole at c2 = {c2:g} m; use kernel 'saturating'"
    )


def check_period(period_s: float) -> str:
    """Return why a sampling time is too slow for this valve [s], empty if it is not."""
    if period_s <= LONGEST_PERIOD_S:
        return ""
    return (
        f"period_s = {period_s:g}: must be at most {LONGEST_PERIOD_S:g} [s] to show pulses of "
        "1.5 ms and flights of 8 ms"
    )


@dataclass(frozen=True, slots=True)
class HybridActuatorNumbers:
    """Numbers of the data sheet, which plant and model share."""

    kernel: str = setting(
        KERNELS[REGULAR],
        "linear, saturating (regular reading) or saturating_fit (the reading that reproduces the "
        "paper, not below a gap of 0.1 mm)",
        choices=KERNELS,
    )
    mass: float = quantity(
        0.12983, "kg", "Moving mass, from the printed c = xi sqrt(m k)", 1e-3, 10.0
    )
    spring_rate: float = quantity(18820.0, "N/m", "Both springs together (k)", 10.0, 1e7)
    damping: float = quantity(3.559, "N s/m", "Viscous damping (c)", 0.0, 1e4)
    coulomb_friction: float = assumed(0.0, "N", "Coulomb friction of the armature", 0.0, 1e3)
    half_travel: float = quantity(
        4e-3, "m", "Travel from the neutral position to a seat", 1e-4, 0.05
    )
    residual_gap: float = assumed(0.5e-3, "m", "Gap that is left when seated", 1e-6, 5e-3)
    restitution: float = assumed(0.3, "1", "Speed after over speed before an impact", 0.0, 0.99)
    resistance_opener: float = quantity(0.34, "ohm", "Coil of the opening solenoid", 1e-3, 100.0)
    resistance_closer: float = quantity(0.37, "ohm", "Coil of the closing solenoid", 1e-3, 100.0)
    beta: float = quantity(2.8e-7, "N m^2/A^2", "Force constant of the linear kernel", 1e-10, 1e-3)
    kappa: float = quantity(1.04e-6, "m", "Gap offset of the linear kernel", 0.0, 1e-4)
    saturation_flux: float = quantity(
        0.046, "Wb", "Flux linkage of the saturated circuit (lambda_s)", 1e-4, 10.0
    )
    c1: float = quantity(7.0e-6, "m/A", "C1 of the saturating kernel", 1e-9, 1e-2)
    c2: float = quantity(6.04e-5, "m", "C2 of the saturating kernel", 0.0, 1e-3)
    c3: float = quantity(2.18e-4, "1/A", "C3 of the saturating kernel", 0.0, 0.1)
    magnet_force: float = quantity(
        128.0, "N", "Force of a permanent magnet at a gap of 0.5 mm", 0.0, 1e4
    )
    magnet_length: float = quantity(
        7.34e-4,
        "m",
        "How fast the magnet's force falls with the gap: 8.7 N are left at 4 mm",
        1e-4,
        0.05,
    )
    magnet_coupling: float = assumed(
        0.8,
        "1",
        "How far the coil weakens the magnet: 0 = not at all, 1 = forces add as fluxes",
        0.0,
        1.0,
    )
    gas_force: float = assumed(
        0.0, "N", "Force of the gas on the closed valve, against opening", -2e3, 2e3
    )
    gas_length: float = assumed(1e-3, "m", "Lift over which the gas force falls to 1/e", 1e-5, 1.0)
    supply_voltage: float = quantity(24.0, "V", "Supply of the bridges", 1.0, 100.0, ages=False)
    current_scale: float = quantity(
        50.0, "A", "Full scale of the current sensors", 1.0, 1e4, ages=False
    )

    def armature(self, known: Mapping[str, float] = MappingProxyType({})) -> Armature:
        """Return the moving parts for the compiled functions, with `known` numbers in place."""
        return compiled(
            Armature,
            self,
            spring=known.get("spring_rate", self.spring_rate),
            damping=known.get("damping", self.damping),
            travel=self.half_travel,
            resistance_opener=known.get("resistance_opener", self.resistance_opener),
            resistance_closer=known.get("resistance_closer", self.resistance_closer),
            blocks=True,
            coulomb=known.get("coulomb_friction", self.coulomb_friction),
        )

    def magnetics(self, known: Mapping[str, float] = MappingProxyType({})) -> Magnetics:
        """Return a solenoid for the compiled functions, with `known` numbers in place."""
        return compiled(
            Magnetics,
            self,
            kernel=KERNELS.index(self.kernel),
            magnet_force=known.get("magnet_force", self.magnet_force),
            coupling=self.magnet_coupling,
        )


@dataclass(frozen=True, slots=True)
class HybridActuatorPlant(HybridActuatorNumbers, Plant):
    """Numbers of the simulated actuator; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = INPUTS
    command_range: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    release_share: float = assumed(
        1.0, "1", "Inverse voltage of the release over the supply", 0.0, 1.0, ages=False
    )
    release_s: float = assumed(6e-4, "s", "Length of the release pulse", 0.0, 0.1, ages=False)
    catch_share: float = assumed(
        0.2, "1", "Voltage of the catching pulse over the supply", 0.0, 1.0, ages=False
    )
    catch_start_s: float = assumed(
        6e-3, "s", "Start of the catching pulse after the command", 0.0, 1.0, ages=False
    )
    catch_s: float = assumed(8e-3, "s", "Length of the catching pulse", 0.0, 1.0, ages=False)
    current_quantum: float = quantity(
        0.256, "A", "Resolution of the current sensors: 168.67 A/V, 1.52 mV", 0.0, 10.0, ages=False
    )
    step: float = assumed(1e-5, "s", "Step of the integration", 1e-7, 1e-4, ages=False)
    control: str = setting(
        CONTROLS[0],
        "What drives the bridges: sequence (pulses of fixed length) or soft_landing (a controller "
        "of position and currents)",
        choices=CONTROLS,
    )
    landing: LandingNumbers = field(default_factory=LandingNumbers)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a gap at the pole of the kernel."""
        check_quantities(self)
        refusal = check_gap(self.kernel, self.residual_gap, self.c2)
        if refusal:
            message = f"HybridActuatorPlant.{refusal}"
            raise ValueError(message)

    def ticks_per_sample(self, period_s: float) -> int:
        """Return 1: the command of the valve timing is taken once a sample."""
        self._steps(period_s)
        if self._lands():
            self._landing_drive(period_s, 0)
        return 1

    def initial_state(self) -> FloatArray:
        """Return the state: seated on the closed side, no current.

        (STATE_SIZE,) under the sequence, (LANDING_SIZE,) under the controller of the landing.
        """
        state = np.zeros(at.STATE_SIZE)
        state[at.X] = -self.half_travel
        m = self.magnetics()
        state[at.FLUX_OPENER] = magnet_flux(m, 2.0 * self.half_travel + self.residual_gap)
        state[at.FLUX_CLOSER] = magnet_flux(m, self.residual_gap)
        state[at.OPEN_OPENER] = state[at.OPEN_CLOSER] = 1.0
        state[at.SINCE] = _LONG_AGO
        if not self._lands():
            return state
        known = replace(self, coulomb_friction=0.0, gas_force=0.0,
                        damping=self.landing.known_damping or self.damping)  # fmt: skip
        supply = float(self.landing.known_supply or self.supply_voltage)
        return loop.at_rest(state, known.armature(), m, supply)

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`.

        A leak has no meaning for this valve and changes nothing. Where the integration fails,
        positions are NaN from there on, and `failure` says when and where.
        """
        out = Response.empty(len(drive.disturbance), len(INPUTS))
        if self._lands() and drive.commands is None:
            armature, magnetics, supply = loop.data_sheet(state)
            run_landing(
                state,
                (self.armature(), self.magnetics()),
                (armature, magnetics),
                self.landing.gains(supply),
                self._landing_drive(period_s, drive.seed),
                drive.forcing(len(INPUTS)),
                self._sensor(),
                out,
            )
            return out
        run_actuator(
            state,
            self.armature(),
            self.magnetics(),
            self.magnetics(),
            self._bridge(),
            Clock(self._steps(period_s), float(self.step)),
            drive.forcing(len(INPUTS)),
            self._sensor(),
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
        return failure_text(
            state[at.FAILED],
            state[at.TIME],
            f"x = {state[at.X]:g} m, speed = {state[at.SPEED]:g} m/s, flux linkages "
            f"{state[at.FLUX_OPENER]:g} and {state[at.FLUX_CLOSER]:g} Wb; take a smaller step "
            f"than {self.step:g} s",
        )

    def _lands(self) -> bool:
        """Return whether the controller of the landing drives the bridges."""
        return self.control == CONTROLS[1]

    def _sensor(self) -> CurrentSensor:
        return CurrentSensor(float(self.current_scale), float(self.current_quantum))

    def _landing_drive(self, period_s: float, seed: int) -> loop.Drive:
        """Return the numbers of the drive under the controller of the landing."""
        of = self.landing
        return loop.Drive(
            whole_ratio(period_s, of.period, "period_s", "landing.period"),
            whole_ratio(of.period, self.step, "landing.period", "step"),
            float(self.step),
            float(self.supply_voltage),
            float(of.position_noise),
            float(of.lasts),
            int(seed),
        )

    def _bridge(self) -> Bridge:
        volts = self.supply_voltage
        return compiled(
            Bridge,
            self,
            supply=volts,
            release=self.release_share * volts,
            catch=self.catch_share * volts,
        )

    def _steps(self, period_s: float) -> int:
        """Return how many steps a sample takes."""
        refusal = check_period(period_s)
        if refusal:
            raise ValueError(refusal)
        return whole_ratio(period_s, self.step, "period_s", "step")


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "Coulomb friction 0.5 N": {"plant.coulomb_friction": 0.5},
        "Coulomb friction 1 N": {"plant.coulomb_friction": 1.0},
        "Coulomb friction 2 N": {"plant.coulomb_friction": 2.0},
        "Coulomb friction 4 N": {"plant.coulomb_friction": 4.0},
        "mass +1 %": {"plant.mass": 0.1311283},
        "mass +3 %": {"plant.mass": 0.1337249},
        "travel +0.5 %": {"plant.half_travel": 0.00402},
        "travel +2 %": {"plant.half_travel": 0.00408},
        "residual gap +5 %": {"plant.residual_gap": 0.000525},
        "residual gap +20 %": {"plant.residual_gap": 0.0006},
        "coupling of magnet and coil 0.6": {"plant.magnet_coupling": 0.6},
        "magnet length +2 %": {"plant.magnet_length": 0.0007486799999999999},
        "magnet length +10 %": {"plant.magnet_length": 0.0008074},
        "20 N of gas": {"plant.gas_force": 20.0},
        "current sensors +0.5 %": {"plant.current_scale": 50.25},
        "current sensors +2 %": {"plant.current_scale": 51.0},
        "supply +1 %": {"plant.supply_voltage": 24.24},
        "supply +5 %": {"plant.supply_voltage": 25.2},
        "C1 +2 %": {"plant.c1": 7.14e-06},
        "saturation +10 %": {"plant.saturation_flux": 0.0506},
        "current steps of 0.5 A": {"plant.current_quantum": 0.5},
        "position three times as noisy": {"measurement.noise": 0.001125},
        "restitution 0.5": {"plant.restitution": 0.5},
        "C2 +2 %": {"plant.c2": 6.1608e-05},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return one opening and closing in 0.2 s, sampled every 0.1 ms; position noise 3 um."""
    program = CycleProgram(
        times_s=(0.0, 2e-3, 0.1),
        kinds=("hold", "hold", "hold"),
        targets=(0.0, 1.0, 0.0),
        duration_s=0.2,
    )
    return SimulationConfig(
        plant=HybridActuatorPlant(),
        program=program,
        measurement=MeasurementConfig(delay=0, noise=3.75e-4),
        period_s=1e-4,
    )
