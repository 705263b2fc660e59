# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the timing of a fixed cycle publishes, and its options."""

from __future__ import annotations

from dataclasses import dataclass

from valve_twin.core.diagnosis.direct.unreached import CLOSED, OPENED
from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import assumed, quantity, setting
from valve_twin.core.types import Parameter
from valve_twin.core.valves.interface import ModelOptions

ESTIMATOR = "centroid"

PARAMETERS = (
    Parameter(
        "valve_lag",
        "s",
        "how much later than healthy_instant_s the valve switches: shift of the flow spike",
        -1e5,
        1e5,
        trend=True,
    ),
    Parameter(
        "pump_leakage",
        "m^3/s",
        "flow missing from healthy_flow while the flow is steady",
        -1e3,
        1e3,
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
    Parameter("decay", "s", "time in which the spike falls towards the steady flow, assumed", 0.0),
)

STROKES = (
    Parameter("close_time", "s", "between_ends: from leaving the open end to the closed one", 0.0),
    Parameter(OPENED, "1", "between_ends: 1 = the open end was reached, 0 = not", 0.0, 1.0),
    Parameter(CLOSED, "1", "between_ends: 1 = the closed end was reached, 0 = not", 0.0, 1.0),
)
"""What two limit switches tell beside."""


@dataclass(frozen=True, slots=True)
class CycleTimingOptions(ModelOptions):
    """Options of the model."""

    spike_start_s: float = quantity(9.0, "s", "the spike is looked for from here on", 0.0, 1e5)
    spike_end_s: float = quantity(10.5, "s", "and up to here", 0.0, 1e5)
    spike_half_width_s: float = quantity(
        0.35, "s", "the centroid is taken this far to both sides of itself", 1e-4, 1e4
    )
    min_spike_ratio: float = assumed(
        1.3, "1", "peak over steady flow below which there is no spike", 1.0, 1e3
    )
    steady_start_s: float = quantity(25.0, "s", "the flow is steady from here on", 0.0, 1e5)
    steady_end_s: float = quantity(59.0, "s", "and up to here", 0.0, 1e5)
    healthy_instant_s: float = quantity(
        0.0, "s", "switching_instant of the healthy valve", 0.0, 1e5
    )
    healthy_flow: float = quantity(0.0, "m^3/s", "steady_flow of the healthy pump", 0.0, 1e3)
    between_ends: bool = setting(
        False,
        "the flow is 1 between two limit switches and 0 at each, a command opens the valve at the "
        "first sample of a cycle: whether both ends are reached is told, too",
    )
    estimators: tuple[str, ...] = setting(
        (ESTIMATOR,), "estimators to run", choices=(ESTIMATOR, FEATURES)
    )
