# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the positioner publishes, and its options."""

from __future__ import annotations

from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import Option

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

PARAMETERS = (
    Parameter(
        "rate_rising",
        "1/s",
        "speed per distance to the command, rising position [A]",
        0.0,
        trend=True,
    ),
    Parameter(
        "rate_falling",
        "1/s",
        "speed per distance to the command, falling position [A]",
        0.0,
        trend=True,
    ),
    Parameter("slew_rising", "1/s", "largest speed, rising position [A]", 0.0, trend=True),
    Parameter("slew_falling", "1/s", "largest speed, falling position [A]", 0.0, trend=True),
    Parameter("dead_band", "1", "distance to the command that moves nothing [A]", 0.0, trend=True),
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
    ),
    Parameter(
        "response_falling",
        "s",
        "delay + 1 / rate_falling: how far the position trails a falling ramp",
        0.0,
        trend=True,
    ),
    Parameter(
        "speed_rising",
        "1/s",
        "greatest rising speed shown over a fifth of the cycle's motion",
        0.0,
    ),
    Parameter(
        "speed_falling",
        "1/s",
        "greatest falling speed shown over a fifth of the cycle's motion",
        0.0,
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
)

OPTIONS = (
    Option("max_delay_s", 0.5, "longest delay tried [A]", "s", 0.0, 60.0),
    Option("max_dead_band", 0.05, "upper bound of the dead band [A]", "1", 0.0, 1.0),
    Option("min_slew", 0.0, "speed that the valve reaches for certain", "1/s", 0.0, 1e3),
    Option("min_motion", 0.02, "a cycle that moves less is refused [A]", "1", 0.0, 1.0),
    Option("lower_stop", -0.1, "mechanical stop of falling position", "1", -10.0, 10.0),
    Option("upper_stop", 1.1, "mechanical stop of rising position", "1", -10.0, 10.0),
    Option(
        "interval_blocks",
        0,
        "blocks of a cycle whose scatter gives the intervals, 0 = from cycle to cycle [A]",
        "1",
        0,
        1000,
    ),
    Option("estimators", [ESTIMATOR], "estimators to run", choices=(ESTIMATOR,)),
)
