# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The plant of paper 000: a spool between two coils and two springs, in its own position loop.

Position 0 .. 1 is the whole stroke, 0.5 the middle; the setpoint is the valve's command. Voltages
are shares of the supply, currents of the sensors' full scale; both are means over the last control
sample. The paper gives no number: the set is that of equations.md 5.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.control.current_loop import CurrentGains, CurrentSensor
from valve_twin.core.control.nonlinear_pid import PidConfig
from valve_twin.core.control.trajectory_set import TrajectorySetConfig
from valve_twin.core.physics.coenergy import CoenergyMap
from valve_twin.core.physics.coenergy_tables import CoenergyTables, coupling_of, make_tables
from valve_twin.core.physics.curves import flux_of
from valve_twin.core.physics.solenoid_map import (
    FluxCurves,
    MapTables,
    map_from_curves,
    pole_curves,
)
from valve_twin.core.quantity import QuantityError, assumed, check_quantities, compiled, setting
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.simulation.plant import Drive, Plant, Response, failure_text, whole_ratio
from valve_twin.core.simulation.program import CycleProgram
from valve_twin.core.valves.double_solenoid import plant_kernel as at
from valve_twin.core.valves.double_solenoid.control.kernel import (
    CONTROLS,
    N_INPUTS,
    Controller,
    run_valve,
)
from valve_twin.core.valves.double_solenoid.control.observer import KnownNumbers, ObserverConfig
from valve_twin.core.valves.double_solenoid.numbers import DoubleSolenoidNumbers
from valve_twin.core.valves.double_solenoid.plant_kernel import Second, Valve, second_order

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray

INPUTS = ("setpoint", "voltage_a", "voltage_b", "current_a", "current_b")

_FEWEST_NODES = 4  # of a map, along each axis
_ROUNDED = 1e-9  # by which a stop may lie beyond the map [1]
_REACH = 1.0667  # of the end stop: how far the tables go [1]
_LARGEST_FLUX = 1.15  # of the saturation flux: how far the tables go [1]
_LARGEST_CURRENT = 6.0  # how far the tables go, beyond in straight lines [A]


@dataclass(frozen=True, slots=True)
class DoubleSolenoidPlant(DoubleSolenoidNumbers, Plant):
    """Numbers of the simulated valve; every field carries its unit, range and description."""

    inputs: ClassVar[tuple[str, ...]] = INPUTS

    control: str = setting(
        CONTROLS[0],
        "Position controller: pid (the valve's own, nonlinear) or trajectory_set (model "
        "predictive, on what an observer knows)",
        choices=CONTROLS,
    )
    bias_current: float = assumed(1.0, "A", "Of both coils at no output", 0.0, 10.0, ages=False)
    span_current: float = assumed(1.6, "A", "Change at full output", 0.01, 20.0, ages=False)
    largest_current: float = assumed(2.6, "A", "Limit of the references", 0.1, 30.0, ages=False)
    current_gain: float = assumed(20.0, "V/A", "Current controller", 0.0, 1e3, ages=False)
    current_integral: float = assumed(2e4, "V/(A s)", "Current controller", 0.0, 1e7, ages=False)
    current_quantum: float = assumed(
        1.25e-3, "A", "Resolution of current sensors", 0.0, 1.0, ages=False
    )
    pid: PidConfig = field(default_factory=PidConfig)
    trajectory_set: TrajectorySetConfig = field(default_factory=TrajectorySetConfig)
    observer: ObserverConfig = field(default_factory=ObserverConfig)
    known: KnownNumbers = field(default_factory=KnownNumbers)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and numbers that do not fit together."""
        check_quantities(self)
        gap = math.inf if self.map_coenergy else self.gap
        refusal = check_geometry(gap, self.end_stop, self.half_stroke)
        if refusal:
            raise QuantityError(type(self).__name__, refusal)
        self._check_dynamics()

    def ticks_per_sample(self, period_s: float) -> int:
        """Return 1: the setpoint is taken once a sample."""
        _samples(period_s)
        return 1

    def initial_state(self) -> FloatArray:
        """Return valve and observer (2 STATE_SIZE,): in the middle, both coils at their bias."""
        m, bias = self.tables(), float(self.bias_current)
        state = np.zeros(at.STATE_SIZE)
        state[at.POSITION] = 0.5
        state[[at.PSI_A, at.PSI_B]] = _linked(m, bias)
        state[[at.GF_1, at.GF_2] if self.eddies.gain_1 else [at.GA_1, at.GB_1]] = bias
        state[[at.I_A, at.I_B, at.MEAN_A, at.MEAN_B, at.LOG_A, at.LOG_B]] = bias
        state[[at.LEVEL_A, at.LEVEL_B]] = 1.0
        return np.concatenate([state, state])

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples, parameters as `Plant.run`.

        With commands from outside the first column is the setpoint, the others are ignored. A leak
        has no meaning for this valve and changes nothing. Where the integration fails, positions
        are NaN from there on, and `failure` says when and where.
        """
        out = Response.empty(len(drive.disturbance), N_INPUTS)
        run_valve(
            state,
            self.valve(),
            self.tables(),
            self.current_gains(),
            self._controller(drive.seed),
            drive.forcing(N_INPUTS),
            CurrentSensor(float(self.current_scale), float(self.current_quantum)),
            _samples(period_s),
            out,
        )
        return out

    def failure(self, state: FloatArray) -> str:
        """Return when and in what state the integration failed, empty if it did not.

        Parameters
        ----------
        state : (2 STATE_SIZE,) array
            The state that `run` has written.
        """
        if state[at.STATE_SIZE + at.FAILED]:
            where = "the observer; set simulation.plant.known.* and .observer.* nearer the valve"
            return failure_text(1.0, state[at.TIME], where)
        return failure_text(
            state[at.FAILED],
            state[at.TIME],
            f"x = {state[at.X]:g} m, speed = {state[at.SPEED]:g} m/s, flux linkages "
            f"{state[at.PSI_A]:g} and {state[at.PSI_B]:g} Wb, currents {state[at.I_A]:g} and "
            f"{state[at.I_B]:g} A",
        )

    def valve(self) -> Valve:
        """Return the numbers of coils and mechanics for the compiled functions."""
        return compiled(
            Valve,
            self,
            current=self.current_dynamics(),
            force=self.force_dynamics(),
            eddies=self.eddies.numbers(),
            stop=self.end_stop,
            bias=self.bias_current,
            span=self.span_current,
            largest=self.largest_current,
        )

    def _controller(self, seed: int) -> Controller:
        return Controller(
            CONTROLS.index(self.control),
            self.pid.gains(),
            self.trajectory_set.weights(),
            self.known.of(self.valve()),
            self.observer.numbers(float(self.current_quantum), seed),
        )

    def current_dynamics(self) -> Second:
        """Return G_A = G_B, paper 000, eq. (4)."""
        return second_order(self.current_b1, self.current_b2, self.current_a1, self.current_a2)

    def force_dynamics(self) -> Second:
        """Return G_F, paper 000, eq. (4); none where `eddies` make the flux late."""
        if self.eddies.gain_1:
            return at.AT_ONCE
        return second_order(self.force_f1, self.force_f2, self.force_d1, self.force_d2)

    def current_gains(self) -> CurrentGains:
        """Return the numbers of the inner controllers."""
        return CurrentGains(
            proportional=float(self.current_gain),
            integral=self.current_integral * at.SAMPLE_S,
            supply=float(self.supply_voltage),
            resistance=0.5 * (self.resistance_a + self.resistance_b),
        )

    def tables(self) -> Curves:
        """Return the characteristic curves for the compiled functions."""
        if self.map_coenergy:
            if self.map_flux:
                refusal = "map_flux and map_coenergy: write one of them"
                raise QuantityError(type(self).__name__, refusal)
            return coenergy_tables(
                self.map_current, self.map_position, self.map_coenergy, self.end_stop
            )
        return self.pole_tables()

    def pole_tables(self) -> MapTables:
        """Return the curves of a coil alone: of a pole, or of `map_flux`."""
        given = max(len(self.map_current), len(self.map_position), len(self.map_flux)) > 1
        return map_tables(
            given,
            (self.turns, self.pole_area, self.gap, self.saturation_flux, self.coupling),
            self.end_stop,
            (self.map_current, self.map_position, self.map_flux),
            self.map_mutual,
        )

    def _check_dynamics(self) -> None:
        """Refuse dynamics that Euler at 80 kHz cannot follow, and a loop that does not close."""
        for name, (a1, a2) in {
            "current": (self.current_a1, self.current_a2),
            "force": (self.force_d1, self.force_d2),
        }.items():
            fastest = fastest_time(a1, a2)
            if fastest < at.SAMPLE_S / 4.0:
                first, second = ("a1", "a2") if name == "current" else ("d1", "d2")
                refusal = (
                    f"{name}_{first} = {a1!r}, {name}_{second} = {a2!r}: the fastest time is "
                    f"{fastest:.3g} s; must be {at.SAMPLE_S / 4.0:g} s or longer for steps of "
                    "12.5 us"
                )
                raise QuantityError(type(self).__name__, refusal)
        direct, curves = self.current_b2 / self.current_a2, self.tables()
        if self.eddies.gain_1:
            resistance = max(self.resistance_a, self.resistance_b)
            self.eddies.check_resistance(resistance, self.largest_current)
            direct = 1.0
        if isinstance(curves, CoenergyTables):  # currents that magnetise have a common energy
            share = 0.0 if self.eddies.gain_1 else coupling_of(curves)
            if direct * share >= 1.0:
                refusal = (
                    f"current_b2 = {self.current_b2!r}: must be below current_a2/{share:.3g} = "
                    f"{self.current_a2 / share:g} [s^2], the currents of the two coils drive each "
                    "other up otherwise"
                )
                raise QuantityError(type(self).__name__, refusal)
        elif self.map_flux:
            middle = (curves.current.shape[1] - 1) // 2
            own = 1.0 / (float(curves.current[1, middle]) * curves.per_flux)
            if direct * abs(self.map_mutual) >= own:
                refusal = (
                    f"map_mutual = {self.map_mutual!r}: must be within {own / direct:.3g} [H], "
                    "the currents of the two coils drive each other up otherwise"
                )
                raise QuantityError(type(self).__name__, refusal)
        elif direct * self.coupling >= 1.0:
            refusal = (
                f"coupling = {self.coupling!r}: must be below current_a2/current_b2 = "
                f"{1.0 / direct:g} [1], the currents of the two coils drive each other up "
                "otherwise"
            )
            raise QuantityError(type(self).__name__, refusal)


def _linked(m: Curves, bias: float) -> tuple[float, float]:
    """Return the flux linkages of both coils at their bias in the middle [Wb]."""
    if isinstance(m, CoenergyTables):
        return flux_of(m, 0, bias, bias, 0.0), flux_of(m, 1, bias, bias, 0.0)
    middle = m.current[:, (m.current.shape[1] - 1) // 2]
    nodes = np.arange(len(middle)) / m.per_flux
    flux = float(np.interp(bias, middle, nodes)) + m.mutual * bias
    return flux, flux


def _samples(period_s: float) -> int:
    """Return how many control samples of the valve a sample takes."""
    return whole_ratio(period_s, at.SAMPLE_S, "period_s", "the controllers' sample")


def check_geometry(gap: float, end_stop: float, half_stroke: float) -> str:
    """Return why gap, end stop and stroke do not fit together, empty if they do.

    Parameters
    ----------
    gap, end_stop, half_stroke : float
        Gap of a solenoid in the middle, largest position, half of the stroke [m].
    """
    if not end_stop >= half_stroke:
        return f"end_stop = {end_stop!r}: must be half_stroke = {half_stroke!r} or more [m]"
    if not gap >= 1.1 * end_stop:
        return f"gap = {gap!r}: must be 1.1 end_stop = {1.1 * end_stop:g} or more [m]"
    return ""


def fastest_time(a1: float, a2: float) -> float:
    """Return the fastest time constant of 1 + a1 s + a2 s^2 [s]."""
    return float(1.0 / np.abs(np.roots([a2, a1, 1.0])).max())


@lru_cache(maxsize=64)
def map_tables(
    given: bool,
    pole: tuple[float, float, float, float, float],
    end_stop: float,
    curves: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]],
    mutual: float,
) -> MapTables:
    """Return the characteristic curves of a coil, computed once.

    Parameters
    ----------
    given : bool
        Whether `curves` hold a computed field.
    pole : tuple of float
        Turns [1], area [m^2], gap [m], saturation flux [Wb], coupling [1].
    end_stop : float
        Largest position [m].
    curves : tuple of tuple of float
        Currents [A], positions [m], flux linkages [Wb], the positions of a current together.
    mutual : float
        Mutual inductance that goes with `curves` [H].

    Raises
    ------
    ValueError
        If the curves are none of a solenoid or end before the stop.
    """
    if given:
        current, position, flux = (np.array(c, dtype=np.float64) for c in curves)
        shape = (len(current), len(position))
        if flux.size == shape[0] * shape[1]:
            flux = flux.reshape(shape)
        if len(position) and not position[-1] >= end_stop:
            message = (
                f"map_position ends at {position[-1]:g} m: must reach end_stop = {end_stop:g} m"
            )
            raise ValueError(message)
        return map_from_curves(FluxCurves(current, position, flux, mutual))
    turns, area, gap, saturation, coupling = (float(p) for p in pole)
    inductance = 4e-7 * np.pi * turns**2 * area / gap
    return pole_curves(
        turns,
        area,
        gap,
        saturation,
        mutual=coupling * inductance,
        reach=min(_REACH * end_stop, 0.5 * (gap + end_stop)),
        largest_flux=_LARGEST_FLUX * saturation,
        largest_current=_LARGEST_CURRENT,
    )


@lru_cache(maxsize=16)
def coenergy_tables(
    current: tuple[float, ...],
    position: tuple[float, ...],
    coefficients: tuple[float, ...],
    end_stop: float,
) -> CoenergyTables:
    """Return the characteristic curves of both coils from a computed coenergy, computed once.

    Parameters
    ----------
    current, position : tuple of float
        Nodes, currents from 0 [A], positions symmetric about 0 [m].
    coefficients : tuple of float
        Of the spline, the last axis together [J].
    end_stop : float
        Largest position [m].

    Raises
    ------
    ValueError
        If the lists are no map or end before the stop.
    """
    for name, values in (("map_current", current), ("map_position", position)):
        if len(values) < _FEWEST_NODES or not (np.diff(values) > 0.0).all():
            message = f"{name}: {len(values)} values; must be {_FEWEST_NODES} or more, rising"
            raise ValueError(message)
    if current[0] != 0.0:
        message = f"map_current[0] = {current[0]:g}: must be 0 [A]"
        raise ValueError(message)
    shape = (2 * len(current), 2 * len(current), 2 * len(position))
    if len(coefficients) != shape[0] * shape[1] * shape[2]:
        message = (
            f"map_coenergy: {len(coefficients)} values; {len(current)} currents and "
            f"{len(position)} positions need {shape[0] * shape[1] * shape[2]}"
        )
        raise ValueError(message)
    if not position[-1] >= end_stop * (1.0 - _ROUNDED):
        message = f"map_position ends at {position[-1]:g} m: must reach end_stop = {end_stop:g} m"
        raise ValueError(message)
    nodes = np.array(current, dtype=np.float64), np.array(position, dtype=np.float64)
    table = np.array(coefficients, dtype=np.float64).reshape(shape)
    return make_tables(CoenergyMap(("A", "B"), *nodes, table, {}))


STRANGERS: Mapping[str, Mapping[str, object]] = MappingProxyType(
    {
        "springs +2 %": {"plant.spring_1": 5100.0, "plant.spring_2": 5100.0},
        "springs +5 %": {"plant.spring_1": 5250.0, "plant.spring_2": 5250.0},
        "spring 1 +2 %": {"plant.spring_1": 5100.0},
        "gap +30 um": {"plant.gap": 0.00173},
        "gap +100 um": {"plant.gap": 0.0018},
        "mass +1 %": {"plant.mass": 0.07575},
        "mass +5 %": {"plant.mass": 0.07875},
        "turns +1 %": {"plant.turns": 353.5},
        "turns -3 %": {"plant.turns": 339.5},
        "damping +5 %": {"plant.beta": 18.9},
        "damping +30 %": {"plant.beta": 23.4},
        "friction 10 % steeper": {"plant.alpha": 880.0},
        "friction 50 % steeper": {"plant.alpha": 1200.0},
        "coupling +10 %": {"plant.coupling": 0.066},
        "poles +2 %": {"plant.pole_area": 0.0001224},
        "saturation +2 %": {"plant.saturation_flux": 0.0408},
        "saturation +10 %": {"plant.saturation_flux": 0.044},
        "preload 2 +2 %": {"plant.preload_2": 20.4},
        "preload 2 +10 %": {"plant.preload_2": 22.0},
        "half stroke +0.5 %": {"plant.half_stroke": 0.000804},
        "force 10 % later": {"plant.force_d1": 0.000825},
        "current sensors +0.5 %": {"plant.current_scale": 5.025},
        "supply +1 %": {"plant.supply_voltage": 24.24},
        "position three times as noisy": {"measurement.noise": 0.0009},
    }
)
"""Valves that are not as the options say, by how they differ."""


def default_simulation() -> SimulationConfig:
    """Return steps of all sizes in 0.36 s, sampled every 0.1 ms; position noise 0.16 um."""
    program = CycleProgram(
        times_s=(0.0, 0.005, 0.045, 0.085, 0.125, 0.165, 0.205, 0.245, 0.285, 0.325),
        kinds=("hold",) * 10,
        targets=(0.5, 0.9, 0.1, 0.75, 0.25, 0.5, 0.625, 0.575, 0.5, 0.475),
        duration_s=0.36,
    )
    return SimulationConfig(
        plant=DoubleSolenoidPlant(),
        program=program,
        measurement=MeasurementConfig(delay=0, noise=1e-4),
        period_s=1e-4,
    )
