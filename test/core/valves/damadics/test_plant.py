# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import SimulatedValve, simulate_cycles, to_frames
from valve_twin.core.types import Cycle
from valve_twin.core.valves.damadics import MODEL
from valve_twin.core.valves.damadics.plant import DamadicsPlant, default_simulation


def test_blocks_of_any_length_have_the_same_bits():
    whole = SimulatedValve(default_simulation(), 5).advance(300).position
    valve = SimulatedValve(default_simulation(), 5)
    parts = [valve.advance(n).position for n in (1, 99, 200)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()


def test_a_fault_is_a_number_of_the_plant():
    simulation = default_simulation()
    clogged = replace(simulation, plant=DamadicsPlant(clogging=0.5))
    (block,) = simulate_cycles(clogged, 1)
    assert block.true_position.max() == pytest.approx(0.5, abs=1e-9)
    with pytest.raises(ValueError, match="clogging"):
        DamadicsPlant(clogging=1.5)


def test_a_stuck_valve_stays_and_a_frozen_sensor_lets_the_loop_run_away():
    valve = SimulatedValve(default_simulation())
    before = valve.advance(30).true_position[-1]
    valve.set_fault("stuck")
    assert valve.advance(60).true_position == pytest.approx(before, abs=0.01)
    valve.set_fault("none")
    valve.set_fault("sensor_freeze")
    assert np.ptp(valve.advance(100).true_position) > 0.3


def test_the_twin_learns_the_valve_from_its_cycles():
    memory = Memory.empty()
    for i, block in enumerate(simulate_cycles(default_simulation(), 3, seed=1)):
        cycle = Cycle(i + 1, 1.0, to_frames(block))
        estimates, memory = estimate_cycle(MODEL, MODEL.options, cycle, memory)
    assert estimates[0].fit_test > 75.0  # of the free run over a cycle it has not seen


def test_a_valve_that_follows_is_still_proposed_as_a_positioner():
    assert MODEL.proposed_for == ""
