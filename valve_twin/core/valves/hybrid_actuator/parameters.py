# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the hybrid actuator publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorNumbers, check_gap
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import tolerance_section

ESTIMATOR = "flight"

PARAMETERS = (
    Parameter(
        "resistance_opener",
        "ohm",
        "coil of the opening solenoid",
        0.0,
        trend=True,
        sided=("resistance", "opener"),
    ),
    Parameter(
        "resistance_closer",
        "ohm",
        "coil of the closing solenoid",
        0.0,
        trend=True,
        sided=("resistance", "closer"),
    ),
    Parameter(
        "inductance_opener",
        "H",
        "opening solenoid at its seat, small current",
        0.0,
        sided=("inductance", "opener"),
    ),
    Parameter(
        "inductance_closer",
        "H",
        "closing solenoid at its seat, small current",
        0.0,
        sided=("inductance", "closer"),
    ),
    Parameter("spring_rate", "N/m", "both springs together (k of paper 001)", 0.0, trend=True),
    Parameter("damping", "N s/m", "viscous damping (c of paper 001)", 0.0, trend=True),
    Parameter(
        "coulomb_friction", "N", "friction that does not grow with speed, where it shows", 0.0
    ),
    Parameter("rubbing", "N", "Coulomb friction by this cycle alone, of either sign", -1e3, 1e3),
    Parameter("magnet_force", "N", "permanent magnet at a gap of 0.5 mm", 0.0, trend=True),
    Parameter("natural_frequency", "rad/s", "sqrt(k/m) without magnets", 0.0),
    Parameter("damping_ratio", "1", "c/(2 sqrt(m k)): the printed formula lacks the 2", 0.0),
    Parameter(
        "seating_speed_open",
        "m/s",
        "speed at the first contact when opening",
        0.0,
        trend=True,
        sided=("seating_speed", "open"),
    ),
    Parameter(
        "seating_speed_closed",
        "m/s",
        "speed at the first contact when closing",
        0.0,
        trend=True,
        sided=("seating_speed", "closed"),
    ),
    Parameter(
        "flight_time_open",
        "s",
        "first motion to first contact, opening",
        0.0,
        sided=("flight_time", "open"),
    ),
    Parameter(
        "flight_time_closed",
        "s",
        "first motion to first contact, closing",
        0.0,
        sided=("flight_time", "closed"),
    ),
)
NAMES = tuple(p.name for p in PARAMETERS)


HybridActuatorTolerances = tolerance_section(
    "HybridActuatorTolerances",
    __name__,
    HybridActuatorNumbers,
    {
        "mass": 0.01,
        "half_travel": 0.005,
        "residual_gap": 0.05,
        "beta": 0.02,
        "kappa": 0.05,
        "saturation_flux": 0.02,
        "c1": 0.02,
        "c2": 0.02,
        "c3": 0.02,
        "magnet_length": 0.02,
        "magnet_coupling": 0.05,
        "gas_force": 0.05,
        "gas_length": 0.05,
        "supply_voltage": 0.01,
        "current_scale": 0.005,
    },
)


@dataclass(frozen=True, slots=True)
class HybridActuatorOptions(HybridActuatorNumbers, ModelOptions):
    """The numbers of the data sheet: what is not estimated has to be known."""

    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
    tolerances: object = field(default_factory=HybridActuatorTolerances)


def refusal_of(options: HybridActuatorOptions) -> str:
    """Return why these options cannot be used together, empty if they can."""
    return check_gap(options.kernel, options.residual_gap, options.c2)
