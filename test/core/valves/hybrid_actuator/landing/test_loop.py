# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The controller of the landing as the drive of the simulated valve."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from valve_twin.core.simulation import SimulatedValve, configure
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.hybrid_actuator import plant_kernel as at
from valve_twin.core.valves.hybrid_actuator.landing.loop import data_sheet
from valve_twin.core.valves.hybrid_actuator.landing.numbers import LandingNumbers
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant, default_simulation

PERIOD_S = 1e-4
NUMBERS = LandingNumbers(period=PERIOD_S, known_supply=24.0, known_damping=3.559)
PLANT = HybridActuatorPlant(control="soft_landing", landing=NUMBERS)
SEED = 7000


def drive(reference, seed=SEED, **more):
    n = len(reference)
    return Drive(reference, np.zeros(n, dtype=np.bool_), None, np.zeros(n), seed=seed, **more)


def stroke(plant, state, target, samples=400):
    """Follow a stroke sample by sample; return the speed of its first contact [m/s]."""
    kept = 2.0 / (plant.mass * (1.0 - plant.restitution**2))
    found = float("nan")
    for _ in range(samples):
        lost = state[at.IMPACT]
        plant.run(state, drive(np.array([target])), PERIOD_S)
        arrived = (2.0 * target - 1.0) * state[at.X] > 0.0
        if state[at.IMPACT] > lost and arrived and np.isnan(found):
            found = float(np.sqrt((state[at.IMPACT] - lost) * kept))
    return found


@pytest.mark.no_cover
def test_opener_and_closer_land_softly_on_the_whole_grid():
    for friction, supply, gas in product((0.9, 1.1), repeat=3):
        plant = replace(
            PLANT,
            damping=3.559 * friction,
            coulomb_friction=2.0 * friction,
            supply_voltage=24.0 * supply,
            gas_force=20.0 * gas,
        )
        state = plant.initial_state()
        assert stroke(plant, state, 1.0) < 0.1
        assert stroke(plant, state, 0.0) < 0.1
        assert state[at.POSITION] == 0.0


def test_any_blocks_give_the_same_bits():
    reference = np.repeat([0.0, 1.0, 0.0], [20, 300, 300])
    whole, parts = PLANT.initial_state(), PLANT.initial_state()
    together = PLANT.run(whole, drive(reference), PERIOD_S)
    cuts = [PLANT.run(parts, drive(part), PERIOD_S) for part in np.split(reference, [7, 33, 401])]
    np.testing.assert_array_equal(together.position, np.concatenate([c.position for c in cuts]))
    np.testing.assert_array_equal(together.inputs, np.concatenate([c.inputs for c in cuts]))
    np.testing.assert_array_equal(whole, parts)


def test_the_flux_of_a_coil_is_that_of_the_logged_means_of_a_faster_controller():
    plant = replace(PLANT, landing=replace(NUMBERS, period=0.5 * PERIOD_S))
    state, reference = plant.initial_state(), np.ones(40)
    before = state[at.FLUX_CLOSER]
    out = plant.run(state, drive(reference), PERIOD_S)
    volts, amperes = 24.0 * out.inputs[:, 1], 50.0 * out.inputs[:, 3]
    lost = plant.resistance_closer * PERIOD_S * float(np.sum(amperes))
    assert abs(np.diff(volts)).max() > 1.0
    put_in = PERIOD_S * float(np.sum(volts))
    assert put_in - lost == pytest.approx(state[at.FLUX_CLOSER] - before, abs=0.05 * abs(put_in))


def test_what_ages_does_not_tell_the_controller():
    state = PLANT.initial_state()
    aged = replace(PLANT, magnet_force=0.9 * PLANT.magnet_force)
    aged.run(state, drive(np.ones(200)), PERIOD_S)
    armature, magnetics, supply = data_sheet(state)
    assert armature == PLANT.armature()
    assert magnetics == PLANT.magnetics()
    assert supply == 24.0


def test_a_stroke_that_does_not_arrive_is_given_up():
    plant = replace(PLANT, gas_force=500.0)
    state = plant.initial_state()
    plant.run(state, drive(np.ones(600)), PERIOD_S)
    heat = state[at.JOULE]
    plant.run(state, drive(np.ones(200)), PERIOD_S)
    assert state[at.POSITION] < 0.9
    assert state[at.JOULE] == heat


def test_a_command_that_returns_in_flight_brings_it_back():
    state = PLANT.initial_state()
    PLANT.run(state, drive(np.ones(30)), PERIOD_S)
    assert 0.05 < state[at.POSITION] < 0.95
    PLANT.run(state, drive(np.zeros(600)), PERIOD_S)
    PLANT.run(state, drive(np.ones(600)), PERIOD_S)
    assert state[at.FAILED] == 0.0
    assert np.isfinite(state).all()


def test_a_sampling_that_is_no_multiple_of_the_controller_s_is_refused():
    with pytest.raises(ValueError, match=r"landing\.period = 7e-05"):
        replace(PLANT, landing=LandingNumbers(period=7e-5)).ticks_per_sample(PERIOD_S)


def test_the_node_s_settings_reach_it():
    given = {"plant.control": "soft_landing", "plant.landing.period": PERIOD_S}
    valve = SimulatedValve(configure(default_simulation(), given), seed=SEED)
    block = valve.advance(500)
    flight = block.position[(block.position > 0.95) & (block.position < 0.98)]
    assert np.diff(flight).max() * 8e-3 / PERIOD_S < 0.5  # under the sequence about 1 m/s
    assert block.position[-1] == pytest.approx(1.0, abs=0.01)
