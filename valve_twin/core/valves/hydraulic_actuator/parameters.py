# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the hydraulic actuator publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import assumed, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions

ESTIMATOR = "output_error"

PARAMETERS = (
    Parameter(
        "flow_limit_lift",
        "1/s",
        "flow of the open valve, lifting, as the pressure rise in a locked cylinder, assumed",
        0.0,
        trend=True,
        sided=("flow_limit", "lift"),
    ),
    Parameter(
        "flow_limit_lower",
        "1/s",
        "the same, lowering, assumed",
        0.0,
        trend=True,
        sided=("flow_limit", "lower"),
    ),
    Parameter(
        "half_opening_lift",
        "1",
        "opening that lets half of flow_limit_lift pass: overlap and dead band raise it, assumed",
        0.0,
        trend=True,
        sided=("half_opening", "lift"),
    ),
    Parameter(
        "half_opening_lower",
        "1",
        "the same, lowering, assumed",
        0.0,
        trend=True,
        sided=("half_opening", "lower"),
    ),
    Parameter(
        "progressivity",
        "1",
        "exponent of the flow over small openings, 1 = proportional, assumed",
        1.0,
        trend=True,
    ),
    Parameter(
        "resonance",
        "rad/s",
        "angular frequency of the load on the locked oil: compressibility and mass, assumed",
        0.0,
        trend=True,
    ),
    Parameter(
        "throttling_lift",
        "s^2",
        "load pressure per square of the lifting flow: line, throttle, load resistance, assumed",
        0.0,
        trend=True,
        sided=("throttling", "lift"),
    ),
    Parameter(
        "throttling_lower",
        "s^2",
        "the same, lowering, assumed",
        0.0,
        trend=True,
        sided=("throttling", "lower"),
    ),
    Parameter(
        "spool_lag",
        "s",
        "time constant with which the spool follows its opening, assumed",
        0.0,
        trend=True,
    ),
)
NAMES = tuple(p.name for p in PARAMETERS)
LIFT, LOWER = (
    {p.sided[0]: p.name for p in PARAMETERS if p.sided and p.sided[1] == way}
    for way in ("lift", "lower")
)
"""Names of the parameters of either direction, by what they are."""


@dataclass(frozen=True, slots=True)
class HydraulicActuatorOptions(ModelOptions):
    """Options of the model."""

    min_opening: float = assumed(
        0.1,
        "1",
        "largest opening of a direction below which that direction is not estimated",
        0.0,
        1e3,
    )
    min_samples: int = assumed(100, "1", "a cycle of fewer usable samples is refused", 20, 1e6)
    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
