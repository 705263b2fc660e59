# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The smallest valve, an example: it follows its command with a lag, outside a dead band.

dx/dt = (u - x - dead_band sign(u - x)) / time_constant     |u - x| > dead_band, else 0
"""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

from valve_twin.core.valves.kit import Law, Valve, parameter, steps
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the position x (1,) [1] under a held command u (1,) [1], as `Law` says."""
    e = u[0] - x[0]
    if abs(e) > p[1]:
        target = u[0] - p[1] if e > 0.0 else u[0] + p[1]
        x[0] = target + (x[0] - target) * exp(-period_s / p[0])


VALVE = Valve(
    name="first_order",
    inputs=("command",),
    output="position",
    law=Law(
        step=step,
        states=1,
        parameters=(
            parameter("time_constant", 0.4, "s", "of the position", lower=1e-3, upper=1e3),
            parameter("dead_band", 0.01, "1", "moves nothing", lower=0.0, upper=0.2),
        ),
    ),
    program=steps((0.1, 0.8, 0.3, 0.6), every_s=5.0, period_s=0.05),
)
