# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the double-solenoid valve publishes, and its options."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from valve_twin.core.types import Parameter
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.interface import Option, Options, number

if TYPE_CHECKING:
    from collections.abc import Mapping

ESTIMATOR = "balance"

PARAMETERS = (
    Parameter("resistance_a", "ohm", "coil A, from its flux balance", 0.0, trend=True),
    Parameter("resistance_b", "ohm", "coil B, from its flux balance", 0.0, trend=True),
    Parameter(
        "force_gain",
        "1",
        "magnetic force over that of the characteristic curves",
        0.0,
        trend=True,
        resolution=5e-4,  # ripple of the currents, whose squares a mean does not hold
    ),
    Parameter(
        "friction",
        "N",
        "Coulomb friction peak to peak (F_h of paper 000)",
        0.0,
        trend=True,
        resolution=3e-3,  # as above, of 6 N
    ),
    Parameter(
        "preload_1", "N", "spring 1 in the middle, spring 2 as in the options", 0.0, trend=True
    ),
)
NAMES = tuple(p.name for p in PARAMETERS)
COILS = NAMES[:2]
MECHANICAL = NAMES[2:]

_NUMBERS = (
    "mass",
    "spring_1",
    "spring_2",
    "preload_1",
    "preload_2",
    "friction",
    "alpha",
    "beta",
    "force_gain",
    "resistance_a",
    "resistance_b",
    "half_stroke",
    "end_stop",
    "turns",
    "pole_area",
    "gap",
    "saturation_flux",
    "coupling",
    "current_b1",
    "current_b2",
    "current_a1",
    "current_a2",
    "force_f1",
    "force_f2",
    "force_d1",
    "force_d2",
    "supply_voltage",
    "current_scale",
    "map_mutual",
)
_LISTS = ("map_current", "map_position", "map_flux")


def _options() -> tuple[Option, ...]:
    """Return the numbers of the data sheet as options: what is not estimated has to be known."""
    known = {f.name: f for f in fields(DoubleSolenoidPlant)}
    options = []
    for name in _NUMBERS:
        meta = known[name].metadata
        text = str(meta["description"])
        if name in NAMES:
            text += "; estimated, this is where the search starts"
        options.append(
            Option(name, known[name].default, text, meta["unit"], meta["lower"], meta["upper"])
        )
    for name in _LISTS:
        meta = known[name].metadata
        text = f"{meta['description']}; one number alone = none"
        options.append(Option(name, [0.0], text, meta["unit"]))
    estimators = Option("estimators", [ESTIMATOR], "estimators to run", choices=(ESTIMATOR,))
    return (*options, estimators)


OPTIONS = _options()


def known_valve(options: Options, values: Mapping[str, float]) -> DoubleSolenoidPlant:
    """Return the valve of the options, with estimated `values` in their place.

    Raises
    ------
    ValueError
        If a number is outside its range or does not fit the others; it names the number.
    """
    numbers = {name: values.get(name, number(options, name)) for name in _NUMBERS}
    lists = {name: _numbers_of(options, name) for name in _LISTS}
    return DoubleSolenoidPlant(**numbers, **lists)  # type: ignore[arg-type]


def _numbers_of(options: Options, name: str) -> tuple[float, ...]:
    value = options[name]
    assert isinstance(value, (list, tuple))
    return tuple(float(v) for v in value)
