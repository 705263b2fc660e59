# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated press valve: cycles, determinism, faults, aging and speed."""

import statistics
import time
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.simulation import (
    AgingRule,
    SimulatedValve,
    configure,
    simulate_cycles,
    to_frames,
)
from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant, default_simulation
from valve_twin.core.valves.press_cartridge.truth import cycle_truth
from valve_twin.core.valves.registry import get_simulation

DEFAULT = default_simulation()
IDEAL = configure(
    DEFAULT, {"measurement": {"noise": 0, "delay": 0}, "scatter": {"supply_pressure": 0}}
)
ROUGH = configure(
    DEFAULT,
    {
        "measurement": {"refresh": 4, "noise": 4e-3, "delay": 2, "process_noise": 2e-4},
        "aging": {"area_in": {"rate": -0.01}},
        "fault": {"kind": "lost_samples", "severity": 0.1, "start_s": 3.0, "duration_s": 20.0},
        "program": {
            "times_s": [0.0, 0.3, 2.0],
            "kinds": ["hold", "step", "step"],
            "targets": [0.0, 0.2, 0.0],
            "duration_s": 3.6,
        },
    },
)
EXTERNAL = replace(IDEAL, controller="external")


def assert_same(one, other):
    for item in fields(one):
        np.testing.assert_array_equal(getattr(one, item.name), getattr(other, item.name))


def press(plant):
    assert isinstance(plant, PressCartridgePlant)
    return plant


def joined(blocks, name):
    return np.concatenate([getattr(b, name) for b in blocks])


@pytest.fixture(scope="module")
def ideal_cycle():
    return SimulatedValve(IDEAL).advance(850)


def test_cycle_is_that_of_the_reference_experiment(ideal_cycle):
    position = ideal_cycle.true_position
    moved = np.diff(position)
    assert moved.max() == pytest.approx(0.0070, abs=5e-5)
    assert moved.min() == pytest.approx(-0.028, abs=5e-4)
    at = {t: position[round(t / 0.03)] for t in (0.9, 7.2, 12.0, 24.0)}
    assert at == pytest.approx({0.9: 0.0, 7.2: 0.2, 12.0: 0.28, 24.0: 0.0}, abs=0.01)


def test_hold_shows_the_leak_with_the_output_off(ideal_cycle):
    hold = slice(round(9.5 / 0.03), round(17.97 / 0.03))
    t_s = ideal_cycle.stamp_ns[hold] * 1e-9
    assert not ideal_cycle.inputs[hold].any()
    slope = np.polyfit(t_s, ideal_cycle.true_position[hold], 1)[0]
    assert slope == pytest.approx(-9.5e-4, rel=0.02)


def test_commands_stay_below_their_limit_and_one_at_a_time(ideal_cycle):
    assert ideal_cycle.inputs.max() == 0.8
    assert not (ideal_cycle.inputs[:, 0] * ideal_cycle.inputs[:, 1]).any()


def loops(work: Callable[[], object]) -> float:
    """Return the CPU time of some work over that of a Python sum of 1e6 numbers, a median of 5."""

    def cost(of: Callable[[], object]) -> float:
        start = time.process_time()
        of()
        return time.process_time() - start

    def reference() -> None:
        total = 0.0
        for number in range(1_000_000):
            total += number

    return statistics.median(cost(work) / cost(reference) for _ in range(5))


@pytest.mark.no_cover
def test_a_block_of_samples_is_simulated_far_faster_than_real_time():
    """100 x real time is 0.3 ms a sample, 20 000 numbers of such a sum; a block takes 1/20."""
    valve = SimulatedValve(DEFAULT)
    valve.advance(850)
    assert loops(lambda: valve.advance(1700)) <= 1700 * 0.02 / 20.0


@pytest.mark.no_cover
def test_single_samples_as_a_live_node_asks_for_them_keep_the_speed():
    valve = SimulatedValve(DEFAULT)
    valve.advance(30)
    assert loops(lambda: [valve.advance(1) for _ in range(170)]) <= 170 * 0.02


def test_same_seed_same_samples_and_other_seed_other_noise():
    one, again, other = (SimulatedValve(ROUGH, s).advance(400) for s in (7, 7, 8))
    assert_same(one, again)
    assert (one.position != other.position).any()
    assert (one.delivered != other.delivered).any()


@settings(max_examples=25)
@given(st.lists(st.integers(0, 200), min_size=1, max_size=12))
def test_samples_do_not_depend_on_how_they_are_asked_for(counts):
    whole = SimulatedValve(ROUGH, 5).advance(sum(counts))
    valve = SimulatedValve(ROUGH, 5)
    parts = [valve.advance(n) for n in counts]
    for item in fields(whole):
        np.testing.assert_array_equal(joined(parts, item.name), getattr(whole, item.name))


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1), st.integers(1, 30)), max_size=8),
    st.integers(1, 40),
)
def test_external_samples_do_not_depend_on_how_they_are_asked_for(program, chunk):
    levels = [np.tile([a, b], (n, 1)) for a, b, n in program]
    commands = np.concatenate([np.zeros((1, 2)), *levels])
    whole = SimulatedValve(EXTERNAL).advance(len(commands), commands)
    valve = SimulatedValve(EXTERNAL)
    parts = [
        valve.advance(len(c), c)
        for c in (commands[i : i + chunk] for i in range(0, len(commands), chunk))
    ]
    for item in fields(whole):
        np.testing.assert_array_equal(joined(parts, item.name), getattr(whole, item.name))


def test_external_commands_that_the_controller_gave_move_the_spindle_alike():
    # a controller tick as long as a sample makes both see the same commands
    config = configure(IDEAL, {"plant.plc.period_s": 0.03})
    own = SimulatedValve(config).advance(850)
    external = replace(config, controller="external")
    replayed = SimulatedValve(external).advance(850, own.inputs)
    np.testing.assert_array_equal(replayed.true_position, own.true_position)
    assert np.isnan(replayed.reference).all()


def test_external_cycles_start_when_opening_rises_after_closing():
    inputs = np.zeros((60, 2))
    inputs[5:8, 0] = inputs[10:12, 0] = 0.5  # first cycle, opened twice
    inputs[20:25, 1] = 0.5
    inputs[30:35, 0] = 0.5  # second cycle
    block = SimulatedValve(EXTERNAL).advance(60, inputs)
    np.testing.assert_array_equal(block.cycle, [1] * 30 + [2] * 30)


@pytest.mark.parametrize(
    ("commands", "text"),
    [
        (None, "controller 'external' needs commands"),
        (np.zeros((3, 2)), r"must be finite and of shape \(4, 2\), got shape \(3, 2\)"),
        (np.full((4, 2), np.nan), "must be finite"),
    ],
)
def test_refuses_bad_external_commands(commands, text):
    with pytest.raises(ValueError, match=text):
        SimulatedValve(EXTERNAL).advance(4, commands)


def test_refuses_commands_when_it_runs_cycles_itself():
    with pytest.raises(ValueError, match="controller 'cycles' takes no commands"):
        SimulatedValve(IDEAL).advance(4, np.zeros((4, 2)))


def test_refuses_a_negative_number_of_samples():
    with pytest.raises(ValueError, match="samples = -1: must not be negative"):
        SimulatedValve(IDEAL).advance(-1)


def test_no_samples_give_an_empty_block_and_leave_the_time():
    valve = SimulatedValve(IDEAL)
    assert len(valve.advance(0)) == 0
    assert valve.time_ns == 0


def test_a_fixed_refresh_phase_starts_with_the_cycle():
    config = configure(DEFAULT, {"measurement": {"refresh": 4, "refresh_phase": 2}})
    for block in simulate_cycles(config, 2):
        fresh = np.flatnonzero(np.diff(block.position) != 0.0) + 1
        assert set(fresh % 4) == {2}


def test_cycle_number_follows_the_samples():
    valve = SimulatedValve(IDEAL)
    valve.advance(850)
    assert valve.cycle == 1  # the next one starts with its first sample
    valve.advance(1)
    assert valve.cycle == 2


def test_cycles_are_numbered_from_the_first_and_stamps_run_on():
    blocks = list(simulate_cycles(replace(IDEAL, first_cycle=429), 3))
    assert [set(b.cycle) for b in blocks] == [{429}, {430}, {431}]
    assert set(np.diff(joined(blocks, "stamp_ns"))) == {30_000_000}


def test_supply_pressure_scatters_between_cycles_by_its_standard_deviation():
    rest = {"times_s": [0.0], "kinds": ["hold"], "targets": [0.0], "duration_s": 0.3}
    config = configure(DEFAULT, {"program": rest})
    valve = SimulatedValve(config, 4)
    pressures = []
    for _ in range(400):
        valve.advance(config.cycle_samples)
        pressures.append(press(valve.plant).supply_pressure)
    # 4 standard errors of a standard deviation over 400 cycles are 14 %
    assert np.std(pressures) / 3e7 == pytest.approx(0.004, rel=0.14)


def test_refresh_phase_is_drawn_for_each_cycle():
    config = configure(ROUGH, {"fault.kind": "none"})
    phases = set()
    for block in simulate_cycles(config, 30, 3):
        fresh = np.flatnonzero(np.diff(block.position[8:]) != 0.0) + 9
        phases.add(int(fresh[0]) % 4)
    assert phases == {0, 1, 2, 3}


def test_command_offsets_are_in_the_log_only(ideal_cycle):
    config = configure(IDEAL, {"measurement.command_offsets": [0.001, -0.001]})
    block = SimulatedValve(config).advance(850)
    np.testing.assert_array_equal(block.true_position, ideal_cycle.true_position)
    np.testing.assert_allclose(
        block.inputs - ideal_cycle.inputs, [[0.001, -0.001]] * 850, atol=1e-15
    )


def test_process_noise_changes_motion_but_not_rest():
    noisy = configure(IDEAL, {"measurement.process_noise": 2e-4})
    calm, loud = SimulatedValve(IDEAL).advance(850), SimulatedValve(noisy).advance(850)
    rest = slice(0, 33)
    np.testing.assert_array_equal(loud.true_position[rest], calm.true_position[rest])
    change = np.diff(loud.true_position - calm.true_position)[38:80]
    assert 1e-4 < change.std() < 3e-4


def test_lost_samples_are_marked_with_their_probability_and_only_while_the_fault_lasts():
    valve = SimulatedValve(IDEAL, 2)
    valve.advance(100)
    assert "lost_samples" in valve.set_fault("lost_samples", 0.3, 60.0)
    block = valve.advance(3000)
    lost = ~block.delivered
    assert not lost[2000:].any()
    # 4 standard errors of a probability 0.3 over 2000 samples
    assert lost[:2000].mean() == pytest.approx(0.3, abs=0.041)
    assert len(to_frames(block)) == 3000 - lost.sum()


def test_frozen_sensor_repeats_one_value_and_recovers():
    valve = SimulatedValve(DEFAULT, 2)
    valve.advance(40)
    valve.set_fault("sensor_freeze", duration_s=0.6)
    block = valve.advance(60)
    assert len(set(block.position[:20])) == 1
    assert len(set(block.position[20:])) == 40
    assert np.ptp(block.true_position[:20]) > 0.01


def test_stuck_and_leak_fault_act_on_the_spindle_until_cleared():
    valve = SimulatedValve(IDEAL)
    valve.advance(60)
    valve.set_fault("stuck")
    assert np.ptp(valve.advance(30).true_position) == 0.0
    assert valve.set_fault("none") == "all faults cleared"
    assert np.ptp(valve.advance(30).true_position) > 0.01
    held = SimulatedValve(IDEAL)
    held.advance(400)
    held.set_fault("leak", 2e-3)
    slope = np.diff(held.advance(100).true_position)[20:].mean() / 0.03
    assert slope == pytest.approx(-9.5e-4 - 2e-3, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "severity", "duration", "text"),
    [
        ("leek", 0.0, 0.0, "fault.kind = 'leek': must be one of leak, stuck, sensor_freeze"),
        ("leak", -1.0, 0.0, r"fault.severity = -1.0 for leak: must be from 0 to 1"),
        ("lost_samples", 2.0, 0.0, r"fault.severity = 2.0 for lost_samples"),
        ("stuck", 0.0, -1.0, r"fault.duration = -1.0: must be a time from 0 to 1e9"),
        ("stuck", 0.0, 1e308, r"fault.duration = 1e\+308: must be a time from 0 to 1e9"),
    ],
)
def test_refuses_impossible_faults(kind, severity, duration, text):
    with pytest.raises(ValueError, match=text):
        SimulatedValve(IDEAL).set_fault(kind, severity, duration)


def test_aging_set_at_run_time_takes_effect_at_the_next_cycle():
    valve = SimulatedValve(IDEAL)
    valve.advance(100)
    assert valve.set_aging("area_in", "linear", -0.01) == (
        "area_in ages by law linear, rate -0.01, from cycle 2"
    )
    assert press(valve.plant).area_in == 1.27e-5
    valve.advance(850)
    assert press(valve.plant).area_in == pytest.approx(0.99 * 1.27e-5)
    valve.set_aging("area_in", "none", 0.0)
    valve.advance(850)
    assert press(valve.plant).area_in == 1.27e-5


def test_aging_stops_at_the_end_of_the_physical_range():
    valve = SimulatedValve(replace(IDEAL, aging=(AgingRule("area_ratio", "linear", 0.01),)))
    assert press(valve.aged_plant(100)).area_ratio == 0.99


def test_aging_of_an_unknown_parameter_names_the_nearest():
    with pytest.raises(ValueError, match="'areain' is unknown; did you mean 'area_in'"):
        SimulatedValve(IDEAL).set_aging("areain", "linear", -0.01)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("step", "plant parameter 'step' is unknown"),
        ("offset_in", "'offset_in' = 0: no relative change moves it"),
    ],
)
def test_refuses_aging_that_would_do_nothing_or_spoil_the_computation(name, text):
    with pytest.raises(ValueError, match=text):
        SimulatedValve(IDEAL).set_aging(name, "linear", 0.01)


AGED = replace(IDEAL, first_cycle=429, aging=(AgingRule("area_in", "linear", -0.15 / 104, 430),))


@pytest.mark.parametrize(("v", "drift"), [(0.8, -13.5), (0.5, -14.1), (0.2, -14.8)])
def test_gain_drifts_less_than_the_pilot_area_by_the_published_figures(v, drift):
    valve = SimulatedValve(AGED)
    change = valve.steady_gain(533, v) / valve.steady_gain(429, v) - 1.0
    assert 100.0 * change == pytest.approx(drift, abs=0.06)


def test_closing_gain_does_not_drift_with_the_opening_area():
    valve = SimulatedValve(AGED)
    before, after = (valve.steady_gain(c, 0.3, input_index=1) for c in (429, 533))
    assert after == pytest.approx(before, rel=1e-12)
    assert before == pytest.approx(0.0459, abs=5e-5)


def test_truth_of_a_cycle_is_the_steady_gain_at_its_weighted_command(ideal_cycle):
    truth = cycle_truth(AGED, 429)
    moved = np.diff(ideal_cycle.true_position)
    opening = (moved > 0.0) & (ideal_cycle.inputs[:-1, 0] > 0.0)
    mean = np.average(ideal_cycle.inputs[:-1, 0][opening], weights=moved[opening])
    assert truth.commands[0] == pytest.approx(mean, rel=1e-12)
    gain = SimulatedValve(AGED).steady_gain(429, mean)
    assert truth.gains[0] == pytest.approx(gain, rel=1e-12)
    assert 0.0 < truth.commands[1] < 0.8


def test_commands_from_outside_are_limited_to_what_the_plant_takes():
    wild = np.array([[3.0, -2.0]] * 20)
    tame = np.array([[1.0, 0.0]] * 20)
    one, other = (SimulatedValve(EXTERNAL).advance(20, c) for c in (wild, tame))
    np.testing.assert_array_equal(one.true_position, other.true_position)
    actuator = replace(get_simulation("hybrid_actuator"), controller="external")
    inverse = np.tile([0.0, -1.0, 0.0, 0.0], (10, 1))
    block = SimulatedValve(actuator).advance(10, 2.0 * inverse)
    np.testing.assert_array_equal(block.inputs[:, 1], inverse[:, 1])


@pytest.mark.parametrize(
    ("model", "aged", "rate", "limit"),
    [
        ("stepper_servo", "band_upper", 0.5, "full_upper"),
        ("stepper_servo", "band_lower", -0.9, "full_lower"),
    ],
)
def test_aging_stops_where_the_numbers_make_no_valve(model, aged, rate, limit):
    rule = AgingRule(aged, "step", rate, 1)
    valve = SimulatedValve(replace(get_simulation(model), aging=(rule,)))
    left = getattr(valve.plant, aged) / getattr(valve.plant, limit)
    assert left == pytest.approx(1.0, abs=1e-6)
    assert (left < 1.0) == (rate > 0.0)
