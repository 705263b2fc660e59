# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated valve for the Hammerstein-Wiener model: not of its own form, in continuous time.

dx/dt = (static_gain (u + curvature u (1 - u)) - x) / response, each direction its own
"""

from __future__ import annotations

from dataclasses import replace
from math import exp
from typing import TYPE_CHECKING

from valve_twin.core.simulation.measurement import MeasurementConfig
from valve_twin.core.valves.kit.law import Law, parameter
from valve_twin.core.valves.kit.plant import steps
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the position x (1,) under a held command u (1,) [1], as `Law` says."""
    target = p[0] * (u[0] + p[3] * u[0] * (1.0 - u[0]))
    response = p[1] if target > x[0] else p[2]
    x[0] = target + (x[0] - target) * exp(-period_s / response)


LAW = Law(
    step=step,
    states=1,
    parameters=(
        parameter("static_gain", 0.9, "1", "settled position per command", lower=0.1, upper=10.0),
        parameter("response_rising", 0.4, "s", "time constant, rising", lower=1e-3, upper=1e3),
        parameter("response_falling", 0.6, "s", "time constant, falling", lower=1e-3, upper=1e3),
        parameter("curvature", 0.3, "1", "of the static curve", lower=-1.0, upper=1.0),
    ),
)
_LEVELS = (0, 3, 6, 1, 5, 2, 4, 3, 1, 0)  # sixths of the full scale
_STEPS = steps(tuple(n / 6 for n in _LEVELS), every_s=3.0, period_s=0.05)
PROGRAM = replace(_STEPS, measurement=MeasurementConfig(noise=1e-3, delay=0))
