# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The double-solenoid valve against real time, its trajectory set control against its budget."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median
from valve_twin.core.physics.coenergy import linear_map
from valve_twin.core.quantity import replaced
from valve_twin.core.valves.double_solenoid.control.kernel import decide_all, drive_open_loop
from valve_twin.core.valves.double_solenoid.designed import map_lists
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.plant_kernel import SAMPLE_S

if TYPE_CHECKING:
    from collections.abc import Iterator

BUDGET_S = 4e-5
"""What one decision of the trajectory set may take [s]."""

_SAMPLES = 4000
_DECISIONS = 100


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _simulation("double-solenoid valve, 80 kHz", DoubleSolenoidPlant(), scale.repeats, 300.0)
    mapped = replaced(DoubleSolenoidPlant(), map_lists(linear_map(0.04, -8e-3, 2.5e-3, 7, 9)))
    yield _simulation("the same on a map of both coils", mapped, scale.repeats, 200.0)
    yield _control(scale.repeats)


def _simulation(name: str, plant: DoubleSolenoidPlant, repeats: int, goal: float) -> Ratio:
    """Compare 0.4 s of valve, bridges and current controllers at 80 kHz with their length."""
    commands = 0.3 * np.sin(0.01 * np.arange(_SAMPLES))
    state = plant.initial_state()
    out = np.empty((_SAMPLES, len(state)))
    numbers = (plant.valve(), plant.tables(), plant.current_gains(), commands, out)
    ours = median(lambda: drive_open_loop(state, *numbers), repeats)
    return Ratio(name, "real time", ours, SAMPLE_S * _SAMPLES, goal)


def _control(repeats: int) -> Ratio:
    """Compare decisions of 896 model steps with the time that is left for them at 10 kHz."""
    plant = DoubleSolenoidPlant()
    state = plant.initial_state()
    numbers = (plant.valve(), plant.tables(), plant.current_gains())
    weights = plant.trajectory_set.weights()
    wanted = np.linspace(0.0, plant.half_stroke, _DECISIONS)
    out = np.empty(_DECISIONS)
    ours = median(lambda: decide_all(state, *numbers, weights, wanted, out), repeats)
    ours /= _DECISIONS
    return Ratio("trajectory set control, 896 model steps", "40 us", ours, BUDGET_S, 1.0)
