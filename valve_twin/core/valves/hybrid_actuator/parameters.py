# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the hybrid actuator publishes, and its options."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from valve_twin.core.types import Parameter
from valve_twin.core.valves.hybrid_actuator.magnetics import KERNELS, Magnetics
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant, check_gap
from valve_twin.core.valves.hybrid_actuator.plant_kernel import Armature
from valve_twin.core.valves.interface import Option, Options, number

if TYPE_CHECKING:
    from collections.abc import Mapping

ESTIMATOR = "flight"

PARAMETERS = (
    Parameter("resistance_opener", "ohm", "coil of the opening solenoid", 0.0, trend=True),
    Parameter("resistance_closer", "ohm", "coil of the closing solenoid", 0.0, trend=True),
    Parameter("inductance_opener", "H", "opening solenoid at its seat, small current", 0.0),
    Parameter("inductance_closer", "H", "closing solenoid at its seat, small current", 0.0),
    Parameter("spring_rate", "N/m", "both springs together (k of paper 001)", 0.0, trend=True),
    Parameter("damping", "N s/m", "viscous damping (c of paper 001)", 0.0, trend=True),
    Parameter("magnet_force", "N", "permanent magnet at a gap of 0.5 mm", 0.0, trend=True),
    Parameter("natural_frequency", "rad/s", "sqrt(k/m) without magnets", 0.0),
    Parameter("damping_ratio", "1", "c/(2 sqrt(m k)): the printed formula lacks the 2", 0.0),
    Parameter(
        "seating_speed_open", "m/s", "speed at the first contact when opening", 0.0, trend=True
    ),
    Parameter(
        "seating_speed_closed", "m/s", "speed at the first contact when closing", 0.0, trend=True
    ),
    Parameter("flight_time_open", "s", "first motion to first contact, opening", 0.0),
    Parameter("flight_time_closed", "s", "first motion to first contact, closing", 0.0),
)
NAMES = tuple(p.name for p in PARAMETERS)

_FROM_PLANT = (
    "mass",
    "spring_rate",
    "damping",
    "magnet_force",
    "half_travel",
    "residual_gap",
    "restitution",
    "beta",
    "kappa",
    "saturation_flux",
    "c1",
    "c2",
    "c3",
    "magnet_length",
    "magnet_coupling",
    "gas_force",
    "gas_length",
    "supply_voltage",
    "current_scale",
    "resistance_opener",
    "resistance_closer",
)
_STARTS = ("spring_rate", "damping", "magnet_force", "resistance_opener", "resistance_closer")


def _options() -> tuple[Option, ...]:
    """Return the numbers of the data sheet as options: what is not estimated has to be known."""
    known = {f.name: f for f in fields(HybridActuatorPlant)}
    options = [
        Option("kernel", KERNELS[1], str(known["kernel"].metadata["description"]), choices=KERNELS)
    ]
    for name in _FROM_PLANT:
        meta = known[name].metadata
        text = str(meta["description"])
        if name in _STARTS:
            text += "; estimated, this is where the search starts"
        options.append(
            Option(name, known[name].default, text, meta["unit"], meta["lower"], meta["upper"])
        )
    estimators = Option("estimators", [ESTIMATOR], "estimators to run", choices=(ESTIMATOR,))
    return (*options, estimators)


OPTIONS = _options()


def refusal_of(options: Options) -> str:
    """Return why these options cannot be used together, empty if they can."""
    return check_gap(
        str(options["kernel"]), number(options, "residual_gap"), number(options, "c2")
    )


def solenoid(options: Options, values: Mapping[str, float]) -> Magnetics:
    """Return a solenoid's numbers: estimated `values` where there are, else the options."""
    return Magnetics(
        kernel=KERNELS.index(str(options["kernel"])),
        beta=number(options, "beta"),
        kappa=number(options, "kappa"),
        saturation_flux=number(options, "saturation_flux"),
        c1=number(options, "c1"),
        c2=number(options, "c2"),
        c3=number(options, "c3"),
        magnet_force=values.get("magnet_force", number(options, "magnet_force")),
        magnet_length=number(options, "magnet_length"),
        coupling=number(options, "magnet_coupling"),
    )


def armature(options: Options, values: Mapping[str, float]) -> Armature:
    """Return the moving parts' numbers: estimated `values` where there are, else the options."""

    def take(name: str) -> float:
        return values.get(name, number(options, name))

    return Armature(
        mass=number(options, "mass"),
        spring=take("spring_rate"),
        damping=take("damping"),
        travel=number(options, "half_travel"),
        residual_gap=number(options, "residual_gap"),
        restitution=number(options, "restitution"),
        gas_force=number(options, "gas_force"),
        gas_length=number(options, "gas_length"),
        resistance_opener=take("resistance_opener"),
        resistance_closer=take("resistance_closer"),
        blocks=True,
    )
