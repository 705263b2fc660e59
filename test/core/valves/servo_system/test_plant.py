# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated servosystem: cycles, sensors, faults, failure and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.simulation import SimulatedValve, configure
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.servo_system.dynamics import P1, P2, VV, XV
from valve_twin.core.valves.servo_system.plant import ServoSystemPlant, default_simulation
from valve_twin.core.valves.servo_system.plant_kernel import FIRST, INPUTS

CLEAN = {"plant.sensor_noise": 0.0, "plant.sensor_quantum": 0.0, "measurement.noise": 0.0,
         "measurement.quantum": 0.0}  # fmt: skip


def cycle(given_=None, seed=1, samples=4000, faults=()):
    valve = SimulatedValve(configure(default_simulation(), given_ or {}), seed)
    for fault in faults:
        valve.set_fault(*fault)
    return valve.advance(samples)


@pytest.fixture(scope="module")
def clean():
    return cycle(CLEAN)


def test_the_piston_follows_what_is_wanted(clean):
    ends = [390, 790, 1440, 2240, 3990]  # before the next move
    np.testing.assert_allclose(clean.true_position[ends], clean.reference[ends], atol=0.02)


def test_load_and_piston_move_together(clean):
    load = clean.inputs[:, INPUTS.index("load_position")]
    assert np.abs(load - clean.true_position).max() < 0.02


def test_pressures_balance_the_piston_at_rest(clean):
    scale = ServoSystemPlant().pressure_scale
    p1, p2 = (scale * clean.inputs[-1, INPUTS.index(f"pressure_{k}")] for k in (1, 2))
    force = ServoSystemPlant().area_1 * p1 - ServoSystemPlant().area_2 * p2
    assert abs(force) < ServoSystemPlant().static_friction


def test_the_same_samples_come_in_any_blocks():
    config = default_simulation()
    whole, split = SimulatedValve(config, 3), SimulatedValve(config, 3)
    one = whole.advance(700)
    parts = [split.advance(n) for n in (1, 99, 350, 250)]
    np.testing.assert_array_equal(one.position, np.concatenate([p.position for p in parts]))
    np.testing.assert_array_equal(one.inputs, np.concatenate([p.inputs for p in parts]))


def test_sensors_have_the_stated_noise_and_steps(clean):
    noisy = cycle({"plant.sensor_noise": 5e-3, "plant.sensor_quantum": 0.0})
    off = (noisy.inputs - clean.inputs)[:, 1:]
    np.testing.assert_allclose(off.std(axis=0), 5e-3, rtol=0.05)
    assert np.abs(np.corrcoef(off.T) - np.eye(8)).max() < 0.08
    stepped = cycle({"plant.sensor_noise": 0.0, "plant.sensor_quantum": 0.01}).inputs[:, 1:]
    np.testing.assert_allclose(stepped, np.round(stepped / 0.01) * 0.01, atol=1e-12)


def test_every_seed_of_the_simulation_gives_every_sensor_its_own_noise(clean):
    one, other = (cycle({"plant.sensor_quantum": 0.0}, seed=s).inputs[:, 1:] for s in (1, 2))
    off = np.hstack([one, other]) - np.tile(clean.inputs[:, 1:], 2)
    assert np.abs(np.corrcoef(off.T) - np.eye(16)).max() < 0.08


def test_a_held_valve_does_not_move():
    valve = SimulatedValve(configure(default_simulation(), CLEAN), 1)
    valve.set_fault("stuck")
    opening = valve.advance(300).inputs[:, INPUTS.index("valve_position")]
    assert np.ptp(opening) == 0.0


def test_a_leak_lowers_the_pressure_of_chamber_1_in_motion(clean):
    leaking = cycle(CLEAN, faults=[("leak", 0.5)])
    p1 = INPUTS.index("pressure_1")
    assert leaking.inputs[50:200, p1].mean() < 0.95 * clean.inputs[50:200, p1].mean()


def test_a_frozen_position_lets_the_piston_run_away():
    frozen = cycle(CLEAN, samples=350, faults=[("sensor_freeze",)])
    assert frozen.true_position[-1] > 0.95


def test_the_end_covers_hold_the_piston():
    frozen = cycle(CLEAN, samples=2000, faults=[("sensor_freeze",)])
    assert frozen.true_position.max() < 1.01
    assert np.isfinite(frozen.true_position).all()


def test_takes_the_desired_position_from_outside():
    config = configure(default_simulation(), {**CLEAN, "controller": "external"})
    commands = np.full((600, len(INPUTS)), 0.6)
    block = SimulatedValve(config, 1).advance(600, commands)
    assert block.true_position[-1] == pytest.approx(0.6, abs=0.01)


def test_an_integration_that_fails_is_told_with_time_and_state():
    plant = ServoSystemPlant()
    state = plant.initial_state()
    drive = Drive(np.full(20, 0.6), np.ones(20, dtype=np.bool_), None, np.zeros(20))
    plant.run(state, drive, 1e-3)
    state[FIRST + VV] = np.inf
    response = plant.run(state, drive, 1e-3)
    assert np.isnan(response.position[1:]).all()
    told = plant.failure(state)
    assert told.startswith("integration failed at 0.02")
    assert "x_v = " in told
    assert "P_f1 = " in told


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("piston_mass", -0.35),
        ("valve_mass", 0.0),
        ("bulk_modulus", -1e9),
        ("supply_underlap", 0.8e-3),
        ("return_underlap", 0.8e-3),
        ("valve_travel", 1e-3),
        ("discharge", float("nan")),
        ("return_pressure", 30e6),
        ("coulomb_friction", 50.0),
        ("hysteresis_width", 0.006),
        ("stroke", 0.2),
    ],
)
def test_refuses_what_is_not_physical_by_name_value_and_range(name, value):
    with pytest.raises(ValueError, match=rf"{name} = .*: must be a number from .* to "):
        ServoSystemPlant(**{name: value})


def test_refuses_sampling_too_slow_for_its_modes():
    with pytest.raises(ValueError, match=r"period_s = 0.02: must be a number from 0 to 0.004"):
        replace(default_simulation(), period_s=0.02)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6), st.floats(0.0, 0.1), st.floats(1e8, 5e9)
)
@settings(max_examples=15, deadline=None)
def test_stays_finite_and_inside_its_stops_whatever_is_wanted(levels, air, bulk):
    plant = ServoSystemPlant(air_share=air, bulk_modulus=bulk)
    state = plant.initial_state()
    wanted = np.repeat(levels, 60)
    drive = Drive(wanted, np.ones(len(wanted), dtype=np.bool_), None, np.zeros(len(wanted)))
    response = plant.run(state, drive, 1e-3)
    assert plant.failure(state) == ""
    assert np.isfinite(response.position).all()
    assert abs(state[FIRST + XV]) < 1.1 * plant.valve_travel
    assert min(state[FIRST + P1], state[FIRST + P2]) > -0.2e6
