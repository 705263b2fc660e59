# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the servosystem publishes, and its options: the numbers that are not estimated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import assumed, describe, setting
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import tolerance_section
from valve_twin.core.valves.servo_system.numbers import COUNT, PHYSICAL, ServoSystemNumbers, derive
from valve_twin.core.valves.servo_system.plant import check_numbers
from valve_twin.core.valves.servo_system.plant_kernel import Sensors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

ESTIMATOR = "loop_output_error"

_KNOWN = {d.name: d for d in describe(ServoSystemNumbers)}


def _parameter(name: str, text: str, *, trend: bool) -> Parameter:
    known = _KNOWN[name]
    return Parameter(name, known.unit, text, known.lower, known.upper, trend=trend)


PARAMETERS = (
    _parameter("discharge", "discharge of the four orifices (C_d)", trend=True),
    _parameter("leak_discharge", "discharge of the leakage (C_dL)", trend=True),
    _parameter("bulk_modulus", "bulk modulus of the fluid without air (beta)", trend=True),
    _parameter("viscous_friction", "viscous friction of the piston", trend=True),
    _parameter("coulomb_friction", "friction of the piston's seals in motion", trend=True),
    _parameter("hysteresis_width", "half width of a large loop of the motor", trend=True),
    _parameter("structural_stiffness", "member between piston and load (k_s)", trend=True),
    _parameter("structural_damping", "damping of that member (b_s)", trend=False),
    _parameter("static_friction", "break-away force of the seals", trend=False),
    _parameter("air_share", "air in the fluid, share at atmospheric pressure", trend=False),
    _parameter("supply_pressure", "pressure of the supply, before its line", trend=False),
    _parameter("return_pressure", "pressure of the return, behind its line", trend=False),
)
NAMES = tuple(p.name for p in PARAMETERS)
INDEX = np.array([PHYSICAL.index(name) for name in NAMES], dtype=np.int64)
"""Where the estimated parameters stand among the numbers, (12,)."""

SCALES = {
    "current_scale": "current",
    "valve_scale": "valve",
    "pressure_scale": "pressure",
    "return_scale": "return_pressure",
    "speed_scale": "speed",
}
"""Full scales by their names in `Sensors`."""


ServoSystemTolerances = tolerance_section(
    "ServoSystemTolerances",
    __name__,
    ServoSystemNumbers,
    {
        "density": 0.01,
        "viscosity": 0.1,
        "line_bore": 0.0,
        "line_wall": 0.0,
        "line_modulus": 0.0,
        "supply_length": 0.0,
        "return_length": 0.0,
        "length_1": 0.0,
        "length_2": 0.0,
        "supply_losses": 0.0,
        "return_losses": 0.0,
        "piston_losses": 0.0,
        "area_1": 0.002,
        "area_2": 0.002,
        "stroke": 0.002,
        "dead_length": 0.0,
        "piston_mass": 0.0,
        "creep_speed": 0.0,
        "decay_speed": 0.0,
        "load_inertia": 0.05,
        "arm": 0.002,
        "load_damping": 0.1,
        "port_radius": 0.01,
        "clearance": 0.0,
        "supply_underlap": 0.0,
        "return_underlap": 0.0,
        "valve_mass": 0.0,
        "valve_stiffness": 0.0,
        "valve_damping_ratio": 0.0,
        "motor_gain": 0.0,
        "motor_force": 0.0,
        "hysteresis_reach": 0.0,
        "inductance": 0.0,
        "resistance": 0.0,
        "current_gain": 0.0,
        "current_feedback": 0.0,
        "flow_force": 0.0,
        "flow_force_offset": 0.0,
        "current_scale": 0.0,
        "valve_scale": 0.0,
        "pressure_scale": 0.005,
        "return_scale": 0.0,
        "speed_scale": 0.0,
    },
)
"""Gains and limits of the controllers are numbers in a program: they have none."""

_TOLD = "known constant, inside its tolerance, told once"
_WARM = "viscosity of the fluid: told in every cycle, since it follows the temperature"

CONSTANTS = tuple(
    Parameter(
        d.name,
        _KNOWN[d.name].unit,
        _WARM if d.name == "viscosity" else _TOLD,
        _KNOWN[d.name].lower,
        _KNOWN[d.name].upper,
    )
    for d in describe(ServoSystemTolerances)
)


@dataclass(frozen=True, slots=True)
class ServoSystemOptions(ServoSystemNumbers, ModelOptions):
    """The numbers of the data sheet, and what a cycle must show."""

    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
    max_error: float = assumed(
        0.15,
        "1",
        "a parameter that the cycle tells less well keeps its option and is not published: "
        "relative standard error",
        1e-4,
        1.0,
    )
    max_misfit: float = assumed(
        1.5,
        "1",
        "residual over the noise of the signals above which the cycle is refused",
        1.0,
        100.0,
    )
    min_motion: float = assumed(0.02, "1", "a cycle that moves less is refused", 0.0, 1.0)
    tolerances: object = field(default_factory=ServoSystemTolerances)


def refusal_of(options: ServoSystemOptions) -> str:
    """Return which option contradicts another, empty if none."""
    conflict = check_numbers({name: getattr(options, name) for name in PHYSICAL})
    return Refusal(RefusalCode.OPTIONS, conflict) if conflict else ""


def numbers(options: ServoSystemOptions, values: Mapping[str, float]) -> FloatArray:
    """Return the numbers of the compiled functions: estimated `values`, else the options."""
    p = np.zeros(COUNT)
    for i, name in enumerate(PHYSICAL):
        value = values.get(name, np.nan)
        if not np.isfinite(value):
            value = getattr(options, name)
        p[i] = min(max(value, _KNOWN[name].lower), _KNOWN[name].upper)
    derive(p)
    return p


def sensors(options: ServoSystemOptions) -> Sensors:
    """Return the full scales of the signals."""
    return Sensors(
        options.current_scale,
        options.valve_scale,
        options.pressure_scale,
        options.return_scale,
        options.speed_scale,
        0.0,
        0.0,
        0,
    )
