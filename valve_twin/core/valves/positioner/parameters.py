# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the positioner publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass, field

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.tolerances import tolerance_section
from valve_twin.core.valves.positioner.structure import Structure

ESTIMATOR = "output_error"
FITTED = ("rate_rising", "rate_falling", "slew_rising", "slew_falling", "dead_band")
DERIVED = (
    "delay",
    "response_rising",
    "response_falling",
    "speed_rising",
    "speed_falling",
    "command_fit",
    "asymmetry",
)
SECOND_ORDER = ("velocity_lag", "stiffness_rising", "stiffness_falling", "damping")
CURVE = ("dead_command", "static_gain", "rest_level", "top_command", "top_level")

# Those of terms that few valves have are followed where `aging.parameters` names them.
PARAMETERS = (
    Parameter(
        "rate_rising",
        "1/s",
        "speed per distance to the command, rising position, assumed",
        0.0,
        trend=True,
        sided=("rate", "rising"),
    ),
    Parameter(
        "rate_falling",
        "1/s",
        "speed per distance to the command, falling position, assumed",
        0.0,
        trend=True,
        sided=("rate", "falling"),
    ),
    Parameter(
        "slew_rising",
        "1/s",
        "largest speed, rising position, assumed",
        0.0,
        trend=True,
        sided=("slew", "rising"),
    ),
    Parameter(
        "slew_falling",
        "1/s",
        "largest speed, falling position, assumed",
        0.0,
        trend=True,
        sided=("slew", "falling"),
    ),
    Parameter(
        "dead_band", "1", "distance to the command that moves nothing, assumed", 0.0, trend=True
    ),
    Parameter(
        "delay",
        "s",
        "command sample to the first position sample that shows it, whole samples",
        0.0,
    ),
    Parameter(
        "response_rising",
        "s",
        "delay + 1 / rate_rising: how far the position trails a rising ramp; better known than "
        "either part",
        0.0,
        trend=True,
        sided=("response", "rising"),
    ),
    Parameter(
        "response_falling",
        "s",
        "delay + 1 / rate_falling: how far the position trails a falling ramp",
        0.0,
        trend=True,
        sided=("response", "falling"),
    ),
    Parameter(
        "speed_rising",
        "1/s",
        "greatest rising speed shown over a fifth of the cycle's motion",
        0.0,
        sided=("speed", "rising"),
    ),
    Parameter(
        "speed_falling",
        "1/s",
        "greatest falling speed shown over a fifth of the cycle's motion",
        0.0,
        sided=("speed", "falling"),
    ),
    Parameter(
        "command_fit",
        "%",
        "fit of the trivial model, position = command: what fit_test has to beat",
        upper=100.0,
    ),
    Parameter(
        "asymmetry",
        "1",
        "speed_rising over speed_falling: 1 for a valve that is as fast both ways",
        0.0,
    ),
    Parameter(
        "velocity_lag",
        "s",
        "time constant with which the speed follows what is asked of it, assumed",
        0.0,
    ),
    Parameter(
        "stiffness_rising",
        "1/s^2",
        "acceleration per distance to the target, rising: rate / velocity_lag, assumed",
        0.0,
        sided=("stiffness", "rising"),
    ),
    Parameter(
        "stiffness_falling",
        "1/s^2",
        "the same, falling position, assumed",
        0.0,
        sided=("stiffness", "falling"),
    ),
    Parameter("damping", "1/s", "deceleration per speed: 1 / velocity_lag, assumed", 0.0),
    Parameter(
        "delay_falling",
        "s",
        "delay of a falling command, whole samples",
        0.0,
        sided=("delay", "falling"),
    ),
    Parameter(
        "stiction",
        "1",
        "distance beyond the dead band that a resting spool needs to break away, assumed",
        0.0,
    ),
    Parameter(
        "backlash",
        "1",
        "way of the spool that the position does not show when the motion turns, assumed",
        0.0,
    ),
    Parameter(
        "dead_command",
        "1",
        "command below which the position rests; from cycles at different levels",
        0.0,
    ),
    Parameter("static_gain", "1", "settled position per command beyond dead_command", 0.0),
    Parameter("rest_level", "1", "position that a command below dead_command leads to"),
    Parameter("top_command", "1", "highest command of the cycle"),
    Parameter("top_level", "1", "position that top_command leads to"),
)


@dataclass(frozen=True, slots=True)
class PositionerNumbers(Structure):
    """Known constants of the valve."""

    lower_stop: float = quantity(-0.1, "1", "mechanical stop of falling position", -10.0, 10.0)
    upper_stop: float = quantity(1.1, "1", "mechanical stop of rising position", -10.0, 10.0)


PositionerTolerances = tolerance_section(
    "PositionerTolerances",
    __name__,
    PositionerNumbers,
    {"lower_stop": 0.0, "upper_stop": 0.0},
    absolute=True,
)


@dataclass(frozen=True, slots=True)
class PositionerOptions(PositionerNumbers, ModelOptions):
    """Options of the model."""

    max_delay_s: float = assumed(0.5, "s", "longest delay tried", 0.0, 60.0)
    max_dead_band: float = assumed(0.05, "1", "upper bound of the dead band", 0.0, 1.0)
    min_slew: float = quantity(0.0, "1/s", "speed that the valve reaches for certain", 0.0, 1e3)
    min_motion: float = assumed(0.02, "1", "a cycle that moves less is refused", 0.0, 1.0)
    interval_blocks: int = assumed(
        0,
        "1",
        "blocks of a cycle whose scatter gives the intervals, 0 = from cycle to cycle",
        0,
        1000,
    )
    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
    tolerances: object = field(default_factory=PositionerTolerances)
