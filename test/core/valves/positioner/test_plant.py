# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated positioner: what the model finds in it, and that splitting does not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.simulation import SimulatedValve, to_frames
from valve_twin.core.types import Cycle, EstimateStatus, join_blocks
from valve_twin.core.valves.positioner.model import MODEL
from valve_twin.core.valves.positioner.plant import PositionerPlant
from valve_twin.core.valves.registry import complete_options, get_simulation

OPTIONS = complete_options(MODEL, {})


def quiet_simulation():
    config = get_simulation("positioner")
    return replace(config, measurement=replace(config.measurement, noise=0.0, delay=0))


FITTED = ("rate_rising", "rate_falling", "slew_rising", "slew_falling", "dead_band")


def held_commands():
    levels = np.array([0.1, 0.8, 0.75, 0.3, 0.35, 0.9, 0.4, 0.1])
    return np.repeat(levels, 80).reshape(-1, 1)


@pytest.mark.parametrize("controller", ["cycles", "external"])
def test_the_model_finds_the_plant_it_is_the_sampled_form_of(controller):
    config = replace(quiet_simulation(), controller=controller)
    commands = held_commands() if controller == "external" else None
    block = SimulatedValve(config, seed=1).advance(640, commands)
    (found,) = MODEL.estimate(Cycle(1, 0.05, to_frames(block)), OPTIONS)
    plant = PositionerPlant()
    assert found.status is EstimateStatus.ACCEPTED
    for name in ("rate_rising", "rate_falling", "slew_rising", "slew_falling", "dead_band"):
        assert found.value(name) == pytest.approx(getattr(plant, name), rel=1e-6)
    assert found.value("delay") == pytest.approx(plant.delay + 0.05)  # and the sample it acts in


def test_blocks_of_any_length_give_the_same_samples():
    config = get_simulation("positioner")
    whole = SimulatedValve(config, seed=5).advance(900)
    valve = SimulatedValve(config, seed=5)
    split = join_blocks([valve.advance(n) for n in (1, 250, 349, 300)])
    assert whole.position.tobytes() == split.position.tobytes()
    assert whole.inputs.tobytes() == split.inputs.tobytes()


def test_the_steady_rate_is_limited_by_the_slew():
    plant = PositionerPlant()
    assert plant.steady_rate(np.array([1.0])) == plant.slew_rising
    assert plant.steady_rate(np.array([0.0])) == -plant.slew_falling
    assert plant.steady_rate(np.array([0.5])) == 0.0


@pytest.mark.parametrize(
    ("name", "value"), [("rate_rising", -1.0), ("dead_band", 0.9), ("delay", 50.0)]
)
def test_a_value_that_cannot_be_is_named(name, value):
    with pytest.raises(ValueError, match=rf"{name} = {value}"):
        PositionerPlant(**{name: value})
