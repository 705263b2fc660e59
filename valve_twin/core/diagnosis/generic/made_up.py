# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A motion for the signatures of a valve that cannot be simulated: steps through a lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from valve_twin.core.quantity import assumed
from valve_twin.core.simulation.config import SimulationConfig
from valve_twin.core.simulation.plant import Plant, Response
from valve_twin.core.simulation.program import CycleProgram

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Drive
    from valve_twin.core.types import FloatArray

_LEVELS = (0.1, 0.8, 0.3, 0.6)
_HOLD_S = 5.0


@dataclass(frozen=True)
class Lag(Plant):
    """A position that follows its reference with a time constant."""

    inputs: ClassVar[tuple[str, ...]] = ("command",)
    time_constant: float = assumed(0.4, "s", "of the position", 1e-3, 1e3)

    def initial_state(self) -> FloatArray:
        """Return the (1,) position at rest."""
        return np.zeros(1)

    def run(self, state: FloatArray, drive: Drive, period_s: float) -> Response:
        """Run N samples as `Plant.run` says."""
        out = Response.empty(len(drive.disturbance), 1)
        left = np.exp(-period_s / self.time_constant)
        for n, wanted in enumerate(drive.reference):
            out.position[n], out.inputs[n] = state[0], wanted
            state[0] = wanted + left * (state[0] - wanted)
        return out


def made_up() -> SimulationConfig:
    """Return steps up and down through the lag, with the noise of any simulated valve."""
    count = len(_LEVELS)
    program = CycleProgram(
        times_s=tuple(n * _HOLD_S for n in range(count)),
        kinds=("hold",) * count,
        targets=_LEVELS,
        duration_s=count * _HOLD_S,
    )
    return SimulationConfig(plant=Lag(), program=program, period_s=0.05)
