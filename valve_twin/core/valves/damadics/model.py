# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The twin of the DAMADICS actuator: a valve that follows a position command.

It knows nothing of air, spring and water; the law is the positioner's, learnt from every cycle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.valves.damadics.plant import default_simulation
from valve_twin.core.valves.positioner.model import PositionerModel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.simulation.config import SimulationConfig


@dataclass(frozen=True, slots=True)
class DamadicsModel(PositionerModel):
    """Implements `ValveModel` for command and position of the benchmark's actuator."""

    name: str = "damadics"
    proposed_for: str = ""

    def strangers(self) -> Mapping[str, Mapping[str, object]]:
        """Return none: the benchmark's actuator has no number that the twin learns."""
        return {}

    def simulation(self) -> SimulationConfig:
        """Return the default simulation: the benchmark's actuator under steps and ramps."""
        return default_simulation()


MODEL = DamadicsModel()
