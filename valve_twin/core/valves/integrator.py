# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A valve whose opening sets the speed of what it moves: a cylinder, a tank, a drive without loop.

dx/dt = gain_rising (u - neutral - dead_band)       u > neutral + dead_band
      = gain_falling (u - neutral + dead_band)      u < neutral - dead_band, else 0

between two stops, 0 <= x <= 1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.generic.features import feature_set
from valve_twin.core.valves.kit import Law, Valve, parameter, steps
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.features import FeatureSet
    from valve_twin.core.types import FloatArray


@njit(cache=True)
def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Advance the position x (1,) under a held opening u (1,) [1], as `Law` says."""
    e = u[0] - p[3]
    if e > p[2]:
        x[0] = min(x[0] + period_s * p[0] * (e - p[2]), 1.0)
    elif e < -p[2]:
        x[0] = max(x[0] + period_s * p[1] * (e + p[2]), 0.0)


class Integrator(Valve):
    """The kit's valve with the scatter of an answer that sums up every error of its speed."""

    feature_set: FeatureSet = feature_set(least={"rough_rest": 0.3})


VALVE = Integrator(
    name="integrator",
    inputs=("command",),
    output="position",
    law=Law(
        step=step,
        states=1,
        parameters=(
            parameter(
                "gain_rising",
                0.5,
                "1/s",
                "speed per opening",
                lower=1e-6,
                upper=1e4,
                sided=("gain", "rising"),
            ),
            parameter(
                "gain_falling",
                0.4,
                "1/s",
                "likewise, falling",
                lower=1e-6,
                upper=1e4,
                sided=("gain", "falling"),
            ),
            parameter("dead_band", 0.04, "1", "half width, moves nothing", lower=0.0, upper=0.9),
            parameter("neutral", 0.5, "1", "opening in the middle of it", lower=-2.0, upper=2.0),
        ),
    ),
    program=steps((0.5, 0.9, 0.53, 0.2, 0.5, 0.8, 0.6, 0.1, 0.0, 0.0), every_s=2.0, period_s=0.05),
    proposed_for="integrated",
)
