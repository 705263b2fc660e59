# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the servosystem publishes, and its options: the numbers that are not estimated."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import Option, Options, number
from valve_twin.core.valves.servo_system.numbers import COUNT, PHYSICAL, derive
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant, check_numbers
from valve_twin.core.valves.servo_system.plant_kernel import Sensors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray

ESTIMATOR = "loop_output_error"

_KNOWN = {f.name: f for f in fields(ServoSystemPlant) if "lower" in f.metadata}


def _parameter(name: str, text: str, *, trend: bool) -> Parameter:
    meta = _KNOWN[name].metadata
    return Parameter(name, meta["unit"], text, meta["lower"], meta["upper"], trend=trend)


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

_SCALES = ("current_scale", "valve_scale", "pressure_scale", "return_scale", "speed_scale")


def _options() -> tuple[Option, ...]:
    options = []
    for name in (*PHYSICAL, *_SCALES):
        meta = _KNOWN[name].metadata
        text = str(meta["description"])
        if name in NAMES:
            text += "; estimated, this is where the search starts and what it keeps if it must"
        default = _KNOWN[name].default
        options.append(Option(name, default, text, meta["unit"], meta["lower"], meta["upper"]))
    return (
        *options,
        Option("estimators", [ESTIMATOR], "estimators to run", choices=(ESTIMATOR,)),
        Option(
            "max_error",
            0.15,
            "a parameter that the cycle tells less well is held and not published: relative "
            "standard error [A]",
            "1",
            1e-4,
            1.0,
        ),
        Option(
            "max_misfit",
            1.5,
            "residual over the noise of the signals above which the cycle is refused [A]",
            "1",
            1.0,
            100.0,
        ),
        Option("min_motion", 0.02, "a cycle that moves less is refused [A]", "1", 0.0, 1.0),
    )


OPTIONS = _options()


def refusal_of(options: Options) -> str:
    """Return which option contradicts another, empty if none."""
    return check_numbers({name: number(options, name) for name in PHYSICAL})


def numbers(options: Options, values: Mapping[str, float]) -> FloatArray:
    """Return the numbers of the compiled functions: estimated `values`, else the options."""
    p = np.zeros(COUNT)
    for i, name in enumerate(PHYSICAL):
        meta = _KNOWN[name].metadata
        value = values.get(name, np.nan)
        if not np.isfinite(value):
            value = number(options, name)
        p[i] = min(max(value, meta["lower"]), meta["upper"])
    derive(p)
    return p


def sensors(options: Options) -> Sensors:
    """Return the full scales of the signals."""
    scale = [number(options, name) for name in _SCALES]
    return Sensors(scale[0], scale[1], scale[2], scale[3], scale[4], 0.0, 0.0, 0)
