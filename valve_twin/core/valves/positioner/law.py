# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The plain law of the positioner as a step of one sample: the motion of fit and prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.valves.kit.law import Law, parameter
from valve_twin.core.valves.positioner.kernels import advance
from valve_twin.core.valves.positioner.parameters import CURVE, SECOND_ORDER
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

EXTENDED = {*SECOND_ORDER, *CURVE, "delay_falling", "stiction", "backlash"}
"""Parameters of the extended law, of which this one knows nothing."""

_STOP = "not estimated: the usual option, set the valve's own"


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the position x (1,) [1] under a held command u (1,) [1], as `Law` says."""
    x[0] = min(max(advance(x[0], u[0], p, period_s), p[5]), p[6])


LAW = Law(
    step=step,
    states=1,
    parameters=(
        parameter("rate_rising", 2.0, "1/s", "speed per distance", lower=1e-6, upper=1e6),
        parameter("rate_falling", 2.0, "1/s", "the same, falling", lower=1e-6, upper=1e6),
        parameter("slew_rising", 1.0, "1/s", "largest speed", lower=1e-6, upper=1e6),
        parameter("slew_falling", 1.0, "1/s", "the same, falling", lower=1e-6, upper=1e6),
        parameter("dead_band", 0.0, "1", "distance that moves nothing", lower=0.0, upper=1.0),
        parameter("lower_stop", -0.1, "1", f"lower stop, {_STOP}", lower=-10.0, upper=10.0),
        parameter("upper_stop", 1.1, "1", f"upper stop, {_STOP}", lower=-10.0, upper=10.0),
    ),
)
