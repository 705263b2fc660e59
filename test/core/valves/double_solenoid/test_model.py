# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valve's twin: what it recovers, refuses and predicts."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus, Validity
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid.control.kernel import drive_open_loop
from valve_twin.core.valves.double_solenoid.motion import reconstruct_force
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.plant_kernel import FORCE, X
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

OPTIONS = complete_options(MODEL, {})
PERIOD_S = 1e-4
TRUTH = {
    "resistance_a": 2.6,
    "resistance_b": 2.6,
    "force_gain": 1.0,
    "friction": 6.0,
    "preload_1": 20.0,
}


def make_cycles(given=None, cycles=1, seed=0):
    config = configure(get_simulation("double_solenoid"), given or {})
    blocks = simulate_cycles(config, cycles, seed)
    return [Cycle(n, PERIOD_S, to_frames(b)) for n, b in enumerate(blocks, 1)]


@cache
def cycle():
    return make_cycles()[0]


def values_of(given=None, seed=0):
    (estimate,) = MODEL.estimate(make_cycles(given, 1, seed)[0], OPTIONS)
    assert estimate.status is EstimateStatus.ACCEPTED, estimate.reason
    return {p.name: p.value for p in estimate.parameters}


def test_is_registered():
    assert get_model("double_solenoid") is MODEL
    assert MODEL.inputs == get_simulation("double_solenoid").plant.inputs


def test_recovers_a_known_valve():
    """Measured: resistances 0.01 % off, force gain and friction 0.1 and 0.4 %."""
    found = values_of()
    for name, truth in TRUTH.items():
        assert found[name] == pytest.approx(truth, rel=0.01)


@pytest.mark.parametrize(
    "given",
    [
        {"plant.preload_1": 17.0},
        {"plant.resistance_a": 3.2, "plant.friction": 9.0},
        {"plant.force_gain": 0.8, "plant.resistance_b": 2.1},
    ],
)
def test_recovers_a_valve_that_is_not_the_one_of_the_options(given):
    wanted = TRUTH | {name.removeprefix("plant."): value for name, value in given.items()}
    for name, value in values_of(given, seed=1).items():
        assert value == pytest.approx(wanted[name], rel=0.01)


def test_follows_trajectory_set_control_as_well():
    for name, value in values_of({"plant.control": "trajectory_set"}).items():
        assert value == pytest.approx(TRUTH[name], rel=0.01)


def test_the_force_is_reconstructed_from_the_motion():
    plant = DoubleSolenoidPlant()
    state = plant.initial_state()
    commands = 0.15 * np.sin(2.0 * np.pi * 25.0 * PERIOD_S * np.arange(2000))
    out = np.empty((2000, len(state)))
    drive_open_loop(state, plant.valve(), plant.tables(), plant.current_gains(), commands, out)
    noisy = out[:, X] + 0.16e-6 * np.random.default_rng(0).standard_normal(2000)
    force = reconstruct_force(noisy, plant.valve(), PERIOD_S)
    inner = slice(50, -50)
    left = force[inner] - out[inner, FORCE]
    assert np.sqrt(np.mean(left**2)) < 0.06 * np.ptp(out[inner, FORCE])


def test_the_model_in_force_predicts_the_next_cycle():
    memory, estimates = Memory.empty(), []
    for one in make_cycles(cycles=4, seed=1):
        (estimate,), memory = estimate_cycle(MODEL, OPTIONS, one, memory)
        estimates.append(estimate)
    for estimate in estimates[1:]:
        assert np.sqrt(estimate.mse_test) < 1.4 * 1e-4  # of the noise
        assert estimate.fit_test > 80.0


def run(one, values, cuts=(), restart=None, position=None):
    c = MODEL.coefficients(values, 0, PERIOD_S, OPTIONS)
    restart = blocks.marked(len(one.frames)) if restart is None else restart
    return blocks.predict(MODEL, c, one.frames, restart, cuts, position)


def test_any_block_length_predicts_the_same_bits():
    whole = run(cycle(), {})
    for one, other in zip(whole, run(cycle(), {}, (1, 2, 60, 61, 1200)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_prediction_uses_earlier_positions_only():
    changed_ = cycle().frames.position.copy()
    changed_[60] += 0.01
    before, after = run(cycle(), {})[0], run(cycle(), {}, position=changed_)[0]
    np.testing.assert_array_equal(before[:61], after[:61])
    assert before[61] != after[61]


def test_marks_what_a_prediction_is_worth():
    restart = blocks.marked(len(cycle().frames), {80: 3, 500: 2})
    position = cycle().frames.position.copy()
    position[80] = np.nan
    predicted, _, validity = run(cycle(), {}, restart=restart, position=position)
    assert validity[0] == validity[500] == Validity.STARTING
    assert np.isnan(predicted[[0, 500]]).all()
    assert validity[80] == Validity.BAD_INPUT
    assert np.isfinite(predicted[81])
    assert validity[60] == Validity.VALID


def refusal(one, options=OPTIONS):
    (estimate,) = MODEL.estimate(one, options)
    assert estimate.status is EstimateStatus.REFUSED
    assert all(p.status is not ParameterStatus.OK for p in estimate.parameters)
    return estimate.reason


def changed(one, **arrays):
    return replace(one, frames=replace(one.frames, **arrays))


def test_refuses_sampling_that_is_too_slow():
    slow = replace(cycle(), period_s=1e-3)
    assert "sampled every 0.001 s: currents that change in 0.3 ms need 0.0002 s" in refusal(slow)


def test_a_logger_of_0_2_ms_gives_means_over_its_own_sample():
    """Measured: resistances 0.02 % off, force gain 0.1 %, friction 0.6 %, preload 0.06 %."""
    simulation = replace(get_simulation("double_solenoid"), period_s=2e-4)
    (block,) = simulate_cycles(simulation, 1, 1)
    (found,) = MODEL.estimate(Cycle(1, 2e-4, to_frames(block)), OPTIONS)
    assert found.status is EstimateStatus.ACCEPTED, found.reason
    for name, value in TRUTH.items():
        assert found.value(name) == pytest.approx(value, rel=0.01), name


def test_refuses_numbers_that_no_valve_has():
    options = replace(OPTIONS, gap=0.9e-3)
    assert "gap = 0.0009: must be 1.1 end_stop = 0.00099 or more" in refusal(cycle(), options)
    assert np.isnan(MODEL.coefficients({}, 0, PERIOD_S, options)).all()


def test_a_spool_that_rests_tells_its_coils_only():
    plant = DoubleSolenoidPlant()
    n = 2000
    drive = Drive(np.full(n, 0.5), np.ones(n, dtype=np.bool_), None, np.zeros(n), stuck=True)
    response = plant.run(plant.initial_state(), drive, PERIOD_S)
    frames = cycle().frames[:n]
    still = replace(
        cycle(), frames=replace(frames, inputs=response.inputs, position=response.position)
    )
    (estimate,) = MODEL.estimate(still, OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert estimate.status is EstimateStatus.PARTIAL
    assert by_name["resistance_a"].value == pytest.approx(2.6, rel=0.01)
    assert by_name["friction"].status is ParameterStatus.NOT_EXCITED
    assert "no friction shows" in by_name["friction"].reason


def test_a_dead_bridge_tells_no_resistance():
    inputs = cycle().frames.inputs.copy()
    inputs[:, 1:] = 0.0
    (estimate,) = MODEL.estimate(changed(cycle(), inputs=inputs), OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert by_name["resistance_a"].status is ParameterStatus.NOT_EXCITED
    assert "too little" in by_name["resistance_a"].reason


@pytest.mark.parametrize("column", range(1, 6))
def test_not_a_number_in_any_signal_is_left_out(column):
    inputs, position = cycle().frames.inputs.copy(), cycle().frames.position.copy()
    if column < 5:
        inputs[1000:1005, column] = np.nan
    else:
        position[1000:1005] = np.nan
    (estimate,) = MODEL.estimate(changed(cycle(), inputs=inputs, position=position), OPTIONS)
    assert estimate.counts.bad == 5
    for name, truth in TRUTH.items():
        assert estimate.value(name) == pytest.approx(truth, rel=0.01)


def test_refuses_a_record_of_nothing_but_not_a_number():
    position = np.full(len(cycle().frames), np.nan)
    assert refusal(changed(cycle(), position=position)) == "0 usable samples, fewer than 500"


MIXED = {"coils_exchanged": [0, 2, 1, 4, 3], "voltage_and_current_exchanged": [0, 3, 4, 1, 2]}


@pytest.mark.parametrize("order", MIXED.values(), ids=MIXED)
def test_exchanged_signals_are_seen(order):
    (estimate,) = MODEL.estimate(changed(cycle(), inputs=cycle().frames.inputs[:, order]), OPTIONS)
    assert estimate.status is not EstimateStatus.ACCEPTED
    by_name = {p.name: p for p in estimate.parameters}
    assert by_name["force_gain"].status is ParameterStatus.REFUSED
    if order[1] == 3:
        assert by_name["resistance_a"].status is ParameterStatus.REFUSED
        assert "voltage and current exchanged" in by_name["resistance_a"].reason


def test_an_inverted_position_is_seen():
    (estimate,) = MODEL.estimate(changed(cycle(), position=1.0 - cycle().frames.position), OPTIONS)
    assert estimate.parameters[2].status is ParameterStatus.REFUSED


def test_a_position_of_noise_is_no_spool():
    noise = np.random.default_rng(0).uniform(0.0, 1.0, len(cycle().frames))
    (estimate,) = MODEL.estimate(changed(cycle(), position=noise), OPTIONS)
    assert "not a spool" in estimate.parameters[3].reason


def test_a_current_beyond_the_curves_is_refused_with_its_value():
    huge = changed(cycle(), inputs=cycle().frames.inputs * 1e6)
    assert "A lies beyond the curves, which end at 6 A" in refusal(huge)


def test_voltage_without_current_tells_no_resistance():
    inputs = cycle().frames.inputs * np.array([1.0, 1.0, 1.0, 0.0, 0.0])
    (estimate,) = MODEL.estimate(changed(cycle(), inputs=inputs), OPTIONS)
    assert all(not p.usable for p in estimate.parameters)


def test_refuses_gaps():
    stamps = cycle().frames.stamp_ns.copy()
    stamps[50:] += 1_000_000
    assert "1 gaps" in refusal(changed(cycle(), stamp_ns=stamps))


@pytest.mark.parametrize(
    "given", [{"plant.mass": 0.06}, {"plant.spring_1": 6e3}, {"measurement.delay": 3}]
)
def test_what_is_not_as_in_the_options_is_seen_in_the_motion(given):
    (estimate,) = MODEL.estimate(make_cycles(given)[0], OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert by_name["friction"].status is ParameterStatus.REFUSED
    assert (
        "a force is missing, coils are exchanged or an option is wrong"
        in by_name["friction"].reason
    )
    assert by_name["resistance_a"].value == pytest.approx(2.6, rel=0.01)


def test_a_map_of_lists_serves_valve_and_twin_alike():
    """The format of docs/valves/double_solenoid.md: currents, positions, fluxes row by row."""
    constant, gap = 4e-7 * np.pi * 350.0**2 * 1.2e-4, 1.7e-3
    current, position = np.linspace(0.0, 6.0, 25), np.linspace(-0.96e-3, 0.96e-3, 13)
    flux = 0.045 * np.tanh(current[:, None] * constant / (gap - position) / 0.045)
    lists = {"map_current": current, "map_position": position, "map_flux": flux.ravel()}
    given = {f"plant.{name}": values.tolist() for name, values in lists.items()}
    options = complete_options(MODEL, {name: values.tolist() for name, values in lists.items()})
    (estimate,) = MODEL.estimate(make_cycles(given)[0], options)
    assert estimate.status is EstimateStatus.ACCEPTED, estimate.reason
    for name, truth in TRUTH.items():
        assert estimate.value(name) == pytest.approx(truth, rel=0.01)
    against = replace(options, map_mutual=-2e-3)
    given["plant.map_mutual"] = -2e-3
    (estimate,) = MODEL.estimate(make_cycles(given)[0], against)
    assert estimate.value("resistance_a") == pytest.approx(2.6, rel=0.01)
    with pytest.raises(ValueError, match=r"map_mutual = -0.0079: must be within 0.00\d+ \[H\]"):
        make_cycles(given | {"plant.map_mutual": -7.9e-3})
