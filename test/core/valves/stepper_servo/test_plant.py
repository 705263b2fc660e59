# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated stepper valve: published geometry, invariants, steps, bad numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.control.stepper import StepperConfig
from valve_twin.core.simulation import Drive, SimulatedValve
from valve_twin.core.types import join_blocks
from valve_twin.core.valves.registry import get_simulation
from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.core.valves.stepper_servo.plant_kernel import SPOOL, flow_opening

MM = 1e-3
PERIOD_S = 0.01
PLANT = StepperServoPlant()
STEP = PLANT.step_size / PLANT.stroke
SHARP = replace(PLANT, window=1, flow_lag=0.0)
EDGES = tuple(
    e / PLANT.stroke
    for e in (PLANT.band_lower, PLANT.band_upper, PLANT.full_lower, PLANT.full_upper)
)


def run_open_loop(plant, target, state=None, **faults):
    """Move the motor to a target a sample, as the paper's first experiment does."""
    n = len(target)
    drive = Drive(
        reference=np.zeros(10 * n),
        hold=np.ones(10 * n, dtype=np.bool_),
        commands=np.column_stack([target, np.zeros(n)]),
        disturbance=np.zeros(n),
        **faults,
    )
    return plant.run(plant.initial_state() if state is None else state, drive, PERIOD_S)


def run_reference(plant, reference, samples):
    drive = Drive(
        reference=np.asarray(reference),
        hold=np.ones(10 * samples, dtype=np.bool_),
        commands=None,
        disturbance=np.zeros(samples),
    )
    return plant.run(plant.initial_state(), drive, PERIOD_S)


def test_the_geometry_is_the_published_one():
    assert PLANT.step_size == pytest.approx(0.01 * MM)  # 004-geom
    assert PLANT.backlash / PLANT.step_size == pytest.approx(10.0)
    assert PLANT.band_upper - PLANT.band_lower == pytest.approx(1.25 * MM)


def test_the_drive_runs_at_a_thousand_steps_a_second():
    got = run_open_loop(SHARP, np.full(30, 0.9))
    assert np.diff(got.inputs[:10, 0]).max() == pytest.approx(10 * STEP)
    assert SHARP.steady_rate(np.array([0.9, 0.0])) * SHARP.stroke == pytest.approx(10 * MM)


def test_the_spool_lags_the_motor_by_half_the_backlash_after_a_reversal():
    target = np.repeat([0.8, 0.3, 0.7], 60)
    got = run_open_loop(SHARP, target)
    half = 0.5 * SHARP.backlash / SHARP.stroke
    lag = got.position - got.inputs[:, 0]
    assert lag[59] == pytest.approx(-half, abs=1e-12)
    assert lag[119] == pytest.approx(half, abs=1e-12)
    assert lag[179] == pytest.approx(-half, abs=1e-12)


def test_seventy_steps_out_of_the_centre_go_just_beyond_the_dead_band():
    """Paper 004, section 2.1: 70 steps either way cover almost the whole working range."""
    centre = round(1.075 * MM / PLANT.step_size) * STEP
    got = run_open_loop(SHARP, np.repeat([centre + 70 * STEP, centre - 70 * STEP], 50))
    reached = got.position[[49, 99]] * SHARP.stroke
    assert 0.0 < reached[0] - SHARP.band_upper < 0.1 * MM
    assert 0.0 < SHARP.band_lower - reached[1] < 0.1 * MM


@settings(max_examples=200, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_nothing_flows_in_the_dead_band_and_more_the_farther_out(a, b):
    low, high = min(a, b), max(a, b)
    qa, qb = flow_opening(low, *EDGES), flow_opening(high, *EDGES)
    assert min(qa, qb) >= 0.0
    assert max(qa, qb) <= 1.0
    if EDGES[0] <= low <= EDGES[1]:
        assert qa == 0.0
    if low >= EDGES[1]:
        assert qa <= qb
    if high <= EDGES[0]:
        assert qa >= qb


def test_the_flow_is_saturated_at_both_ends():
    assert flow_opening(0.2 / 2.1, *EDGES) == pytest.approx(1.0)
    assert flow_opening(1.9 / 2.1, *EDGES) == pytest.approx(1.0)
    assert flow_opening(0.0, *EDGES) == flow_opening(1.0, *EDGES) == 1.0


def test_a_step_is_reached_without_hunting():
    got = run_reference(PLANT, np.full(4000, 0.85), 400)
    assert np.abs(got.position[-100:] - 0.85).max() * PLANT.stroke <= 0.01 * MM
    assert np.ptp(got.inputs[-100:, 0]) == 0.0


def test_without_dead_zone_it_hunts():
    """Why the corrected law has one: the printed law never stops."""
    plant = replace(PLANT, controller=StepperConfig(dead_zone=0.0))
    got = run_reference(plant, np.full(4000, 0.8503), 400)
    assert np.abs(np.diff(got.inputs[-200:, 0])).sum() > 20 * STEP


def test_sines_slow_enough_for_the_drive_are_followed():
    t = np.arange(4000) * 0.001
    reference = 0.5 + 0.5 / 2.1 * np.sin(2 * np.pi * 0.5 * t)
    got = run_reference(PLANT, reference, 400)
    error = (got.position - reference[::10])[100:] * PLANT.stroke
    assert np.abs(error).max() < 0.1 * MM


def test_lost_steps_take_the_spool_away_from_the_count():
    lossy = replace(SHARP, lost_share=0.1)
    got = run_open_loop(lossy, np.repeat([0.6, 0.4, 0.6, 0.4], 40))
    start = SHARP.initial_state()[SPOOL]
    up = (0.6 - start + 0.2) / STEP
    half = 0.5 * SHARP.backlash / SHARP.stroke
    lost = (got.inputs[-1, 0] + half - got.position[-1]) / STEP
    assert lost == pytest.approx(np.floor(0.1 * round(up)), abs=1.01)


def test_a_stuck_spool_loses_the_steps_that_its_screw_cannot_make():
    state = SHARP.initial_state()
    before = state[SPOOL]
    run_open_loop(SHARP, np.full(40, 0.8), state, stuck=True)
    assert state[SPOOL] == before
    got = run_open_loop(SHARP, np.full(40, 0.8), state)
    assert got.position[-1] < 0.8 - 0.2


def test_the_spool_stays_inside_its_stroke():
    got = run_open_loop(SHARP, np.repeat([1.0, 0.0, 1.0], 150))
    assert got.position.min() >= 0.0
    assert got.position.max() <= 1.0


def test_blocks_of_any_length_give_the_same_samples():
    config = get_simulation("stepper_servo")
    whole = SimulatedValve(config, seed=5).advance(2300)
    valve = SimulatedValve(config, seed=5)
    split = join_blocks([valve.advance(n) for n in (1, 999, 1100, 200)])
    assert whole.position.tobytes() == split.position.tobytes()
    assert whole.inputs.tobytes() == split.inputs.tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"backlash": -1e-4}, r"StepperServoPlant\.backlash = -0\.0001: must be a number from 0"),
        (
            {"band_lower": 1.8e-3},
            r"\.band_lower = 0\.0018: must be below band_upper = 0\.0017 \[m\]",
        ),
        ({"full_upper": 3e-3}, r"\.full_upper = 0\.003: must be below stroke = 0\.0021 \[m\]"),
        ({"lead": 0.1}, r"\.lead = 0\.1: must be at most 0\.021 \[m\], so that a step"),
        ({"window": 0}, r"StepperServoPlant\.window = 0: must be a number from 1"),
        ({"lead": float("nan")}, r"StepperServoPlant\.lead = nan: must be a number"),
    ],
)
def test_refuses_what_is_no_valve(change, message):
    with pytest.raises(ValueError, match=message):
        replace(PLANT, **change)


def test_refuses_a_sampling_that_shows_no_thread():
    with pytest.raises(ValueError, match=r"period_s = 0\.5: must be at most 0\.2 \[s\]"):
        PLANT.ticks_per_sample(0.5)


def test_refuses_a_sampling_that_the_controller_does_not_meet():
    with pytest.raises(ValueError, match=r"period_s = 0\.0105: must be a whole multiple of c"):
        PLANT.ticks_per_sample(0.0105)
