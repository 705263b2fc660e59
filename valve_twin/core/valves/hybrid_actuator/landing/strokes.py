# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Strokes of the actuator: under the open sequence of its bridges, and under the controller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.control.current_loop import CurrentSensor
from valve_twin.core.valves.hybrid_actuator import plant_kernel as at
from valve_twin.core.valves.hybrid_actuator.landing.kernel import fly, throw
from valve_twin.core.valves.hybrid_actuator.landing.numbers import LandingNumbers
from valve_twin.core.valves.hybrid_actuator.magnetics import magnet_flux

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.hybrid_actuator.plant import (
        HybridActuatorNumbers,
        HybridActuatorPlant,
    )

_LASTS_S = 0.04  # a stroke is followed so long [s]
_AT_REST = 20e-6  # nearer to its seat the armature rests [m]


@dataclass(frozen=True, slots=True)
class Stroke:
    """What a stroke did.

    Attributes
    ----------
    speed : float
        At the first contact with the seat [m/s]; NaN = never.
    contact_s, rest_s : float
        From the command to the first contact, and to rest on the seat [s]; NaN = never.
    heat : float
        Lost in both coils [J].
    """

    speed: float
    contact_s: float
    rest_s: float
    heat: float


def soft_stroke(
    plant: HybridActuatorPlant,
    known: HybridActuatorNumbers,
    opens: bool,
    noise: FloatArray,
    numbers: LandingNumbers | None = None,
) -> tuple[Stroke, FloatArray]:
    """Run one stroke under the controller.

    Parameters
    ----------
    plant : HybridActuatorPlant
        The valve as it is.
    known : HybridActuatorNumbers
        Its data sheet: all that the controller knows beside position and currents.
    opens : bool
        Whether it opens, else it closes.
    noise : (N,) array
        Of the position sensor in standard deviations, one a sample [1].
    numbers : LandingNumbers, optional
        Settings, default as they are.

    Returns
    -------
    stroke : Stroke
        What it did.
    course : (N, 4) array
        Place towards the seat [m], speed [m/s], currents of the coil that catches and of the
        other [A], a sample each.

    Raises
    ------
    ValueError
        If the sampling time is no multiple of the plant's step.
    """
    of = numbers or LandingNumbers()
    steps = round(of.period / plant.step)
    if steps < 1 or abs(steps * plant.step - of.period) > 1e-9 * of.period:
        message = f"period = {of.period:g}: must be a multiple of step = {plant.step:g} [s]"
        raise ValueError(message)
    state, course = _seated(plant, opens), np.empty((len(noise), 4))
    speed, contact = fly(
        state,
        (plant.armature(), plant.magnetics(), float(plant.supply_voltage)),
        (known.armature(), known.magnetics()),
        of.gains(float(known.supply_voltage)),
        of.position_noise * noise,
        CurrentSensor(float(plant.current_scale), float(plant.current_quantum)),
        steps,
        opens,
        course,
    )
    return _told(plant, (speed, contact), course[:, 0], of.period, state), course


def samples_of() -> int:
    """Return how many samples a stroke is followed."""
    return round(_LASTS_S / LandingNumbers().period)


def open_stroke(plant: HybridActuatorPlant, opens: bool) -> tuple[Stroke, FloatArray]:
    """Run one stroke under the open sequence of pulses that the plant's settings say.

    Parameters
    ----------
    plant : HybridActuatorPlant
        The valve as it is.
    opens : bool
        Whether it opens, else it closes.

    Returns
    -------
    stroke : Stroke
        What it did.
    course : (N,) array
        Place towards the seat before each step of the plant [m].
    """
    time = plant.step * np.arange(round(_LASTS_S / plant.step))
    middle = time + 0.25 * plant.step
    volts = np.zeros((len(time), 2))
    volts[middle < plant.release_s, 1] = -plant.release_share * plant.supply_voltage
    caught = (middle >= plant.catch_start_s) & (middle < plant.catch_start_s + plant.catch_s)
    volts[caught, 0] = plant.catch_share * plant.supply_voltage
    state, course = _seated(plant, opens), np.empty(len(time))
    true = plant.armature(), plant.magnetics()
    speed, contact = throw(state, true, volts, float(plant.step), opens, course)
    return _told(plant, (speed, contact), course, plant.step, state), course


def varied(
    plant: HybridActuatorPlant, friction: float, supply: float, gas: float
) -> HybridActuatorPlant:
    """Return a valve with friction (viscous and Coulomb), supply and gas force scaled.

    Parameters
    ----------
    plant : HybridActuatorPlant
        The valve.
    friction, supply, gas : float
        Factors [1].
    """
    return replace(
        plant,
        damping=friction * plant.damping,
        coulomb_friction=friction * plant.coulomb_friction,
        supply_voltage=supply * plant.supply_voltage,
        gas_force=gas * plant.gas_force,
    )


def _seated(plant: HybridActuatorPlant, opens: bool) -> FloatArray:
    """Return the plant's state on the seat that is left, without current."""
    state = plant.initial_state()
    if not opens:
        m = plant.magnetics()
        state[at.X], state[at.POSITION] = plant.half_travel, 1.0
        state[at.FLUX_OPENER] = magnet_flux(m, plant.residual_gap)
        state[at.FLUX_CLOSER] = magnet_flux(m, 2.0 * plant.half_travel + plant.residual_gap)
    return state


def _told(
    plant: HybridActuatorPlant,
    contact: tuple[float, float],
    place: FloatArray,
    period: float,
    state: FloatArray,
) -> Stroke:
    """Return what a stroke did; one that ends away from its seat, or failed, never rests."""
    seated = place >= plant.half_travel - _AT_REST  # a place that is not finite is none
    away = int(np.flatnonzero(~seated)[-1])
    rest = max(period * (away + 1), contact[1]) if seated[-1] else float("nan")
    if not np.isfinite(contact[1]):  # it hovers before the seat
        rest = float("nan")
    return Stroke(*contact, rest, float(state[at.JOULE]))
