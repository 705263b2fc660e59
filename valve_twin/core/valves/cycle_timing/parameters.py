# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the timing of a fixed cycle publishes, and its options."""

from __future__ import annotations

from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import Option

ESTIMATOR = "centroid"

PARAMETERS = (
    Parameter(
        "valve_lag",
        "s",
        "how much later than healthy_instant_s the valve switches: shift of the flow spike",
        trend=True,
    ),
    Parameter(
        "pump_leakage",
        "m^3/s",
        "flow missing from healthy_flow while the flow is steady",
        trend=True,
    ),
    Parameter(
        "switching_instant",
        "s",
        "centroid of the flow spike, counted from the first sample of the cycle",
        0.0,
    ),
    Parameter("steady_flow", "m^3/s", "mean flow in the steady window"),
    Parameter("rise_instant", "s", "centre of the rise that begins the spike", 0.0),
    Parameter("peak_flow", "m^3/s", "largest flow of the spike"),
    Parameter("decay", "s", "time in which the spike falls towards the steady flow [A]", 0.0),
)

OPTIONS = (
    Option("spike_start_s", 9.0, "the spike is looked for from here on", "s", 0.0, 1e5),
    Option("spike_end_s", 10.5, "and up to here", "s", 0.0, 1e5),
    Option(
        "spike_half_width_s",
        0.35,
        "the centroid is taken this far to both sides of itself",
        "s",
        1e-4,
        1e4,
    ),
    Option(
        "min_spike_ratio",
        1.3,
        "peak over steady flow below which there is no spike [A]",
        "1",
        1.0,
        1e3,
    ),
    Option("steady_start_s", 25.0, "the flow is steady from here on", "s", 0.0, 1e5),
    Option("steady_end_s", 59.0, "and up to here", "s", 0.0, 1e5),
    Option("healthy_instant_s", 0.0, "switching_instant of the healthy valve", "s", 0.0, 1e5),
    Option("healthy_flow", 0.0, "steady_flow of the healthy pump", "m^3/s", 0.0, 1e3),
    Option("estimators", [ESTIMATOR], "estimators to run", choices=(ESTIMATOR,)),
)
