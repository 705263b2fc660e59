# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The extended positioner: what it recovers of a simulated valve, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from test.core.valves import blocks
from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import evaluate
from valve_twin.core.simulation import SimulatedValve, to_frames
from valve_twin.core.types import Cycle, Estimate, ParameterStatus, join_blocks
from valve_twin.core.valves.positioner.extended import (
    MOTION_SIZE,
    N_EXTENDED,
    N_TRANSITION,
    delay_record,
    move,
    transition,
)
from valve_twin.core.valves.positioner.model import MODEL
from valve_twin.core.valves.positioner.plant import PositionerPlant
from valve_twin.core.valves.registry import complete_options, get_simulation

PERIOD_S = 0.04
FAST = PositionerPlant(
    rate_rising=4.0, rate_falling=3.0, slew_rising=1e3, slew_falling=1e3, dead_band=0.0, delay=0.04
)
NO_LIMIT = {"slew_limits": False, "max_dead_band": 0.0, "max_delay_s": 0.2}


def held(levels, samples=60):
    return np.repeat(np.array(levels, dtype=np.float64), samples).reshape(-1, 1)


STEPS = held([0.1, 0.8, 0.7, 0.3, 0.4, 0.9, 0.2, 0.6, 0.1])


def cycle_of(plant, commands=STEPS, noise=0.0, seed=1):
    """Simulate a valve under commands from outside."""
    config = get_simulation("positioner")
    measurement = replace(config.measurement, noise=noise, delay=0)
    config = replace(
        config, plant=plant, period_s=PERIOD_S, controller="external", measurement=measurement
    )
    block = SimulatedValve(config, seed=seed).advance(len(commands), commands)
    return Cycle(1, PERIOD_S, to_frames(block))


def estimate(plant, options, commands=STEPS, noise=0.0, seed=1):
    chosen = complete_options(MODEL, {**NO_LIMIT, **options})
    return MODEL.estimate(cycle_of(plant, commands, noise, seed), chosen)[0]


def test_a_lagging_speed_solves_its_equation():
    """Against an integrator, inside the linear region where sub-steps do not matter."""
    p = np.zeros(N_EXTENDED)
    p[:6] = [4.0, 3.0, 1e3, 1e3, 0.0, 0.15]
    m = np.zeros(N_TRANSITION)
    transition(p, 0.05, m)
    z = np.zeros(MOTION_SIZE)
    found = []
    for _ in range(8):
        move(z, 0.5, p, 0.05, 1, m, -1.0, 2.0)
        found.append(z[0])
    solved = solve_ivp(
        lambda _, s: [s[1], (4.0 * (0.5 - s[0]) - s[1]) / 0.15],
        (0.0, 0.4),
        [0.0, 0.0],
        t_eval=np.arange(1, 9) * 0.05,
        rtol=1e-10,
        atol=1e-12,
    )
    assert found == pytest.approx(solved.y[0], rel=1e-7)


@pytest.mark.parametrize("lag", [1e-8, 1e-4, 1.0 / 16.0, 3.0])
def test_any_lag_is_stable_and_none_is_the_plain_law(lag):
    """Overdamped, critical (1 / 4 rate), underdamped; a vanishing lag is none."""
    p = np.zeros(N_EXTENDED)
    p[:6] = [4.0, 4.0, 1e3, 1e3, 0.0, lag]
    m = np.zeros(N_TRANSITION)
    transition(p, 0.1, m)
    z = np.zeros(MOTION_SIZE)
    way = []
    for _ in range(400):
        move(z, 0.5, p, 0.1, 1, m, -1.0, 2.0)
        way.append(z[0])
    assert way[-1] == pytest.approx(0.5, abs=1e-3)
    if lag < 1e-3:
        plain = 0.5 * (1.0 - np.exp(-4.0 * 0.1 * np.arange(1, 401)))
        assert way == pytest.approx(plain, abs=1e-3)


def test_a_rise_and_a_fall_are_delayed_by_their_own():
    command = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0], dtype=np.float64)
    found = delay_record(command, 3, 1, 3)
    assert np.flatnonzero(np.diff(found) > 0)[0] == 3 + 3
    assert np.flatnonzero(np.diff(found) < 0)[0] == 8 + 1
    assert np.array_equal(delay_record(command, 2, 2, 2)[2:], command[:-2])
    late = delay_record(command[5:], 1, 3, 1)  # before its first sample it was as in that
    assert np.array_equal(late[1:], [1, 1, 1, 1, 1, 1, 0, 0])


def test_second_order_is_recovered():
    plant = replace(FAST, velocity_lag=0.2)
    found = estimate(plant, {"second_order": True})
    assert found.value("velocity_lag") == pytest.approx(0.2, rel=0.02)
    assert found.value("stiffness_rising") == pytest.approx(20.0, rel=0.02)
    assert found.value("stiffness_falling") == pytest.approx(15.0, rel=0.02)
    assert found.value("damping") == pytest.approx(5.0, rel=0.02)


@pytest.mark.no_cover
def test_second_order_is_recovered_from_noise():
    """Twelve seeds: bias within three standard errors of the mean and the 1 % of the sub-steps."""
    plant = replace(FAST, velocity_lag=0.2)
    found = [estimate(plant, {"second_order": True}, noise=2e-3, seed=s) for s in range(12)]
    values = np.array([[e.value("stiffness_rising"), e.value("damping")] for e in found])
    scatter = values.std(axis=0, ddof=1)
    bias = np.abs(values.mean(axis=0) - [20.0, 5.0])
    assert np.all(bias < 3 * scatter / np.sqrt(12) + 0.01 * np.array([20.0, 5.0]))
    assert np.all(scatter < 0.05 * np.array([20.0, 5.0]))


def test_a_valve_without_a_lag_tells_the_ratio_of_stiffness_and_damping_only():
    found = estimate(FAST, {"second_order": True}, noise=2e-3)
    values = {p.name: p for p in found.parameters}
    for name in ("stiffness_rising", "stiffness_falling", "damping", "velocity_lag"):
        assert values[name].status is ParameterStatus.REFUSED
    assert "not told apart" in values["damping"].reason
    assert "stiffness_rising/damping" in values["damping"].reason
    assert values["rate_rising"].status is ParameterStatus.OK
    assert values["rate_rising"].value == pytest.approx(4.0, rel=0.05)


def test_a_cycle_of_several_levels_tells_its_static_curve():
    plant = replace(FAST, dead_command=0.15, static_gain=1.1)
    found = estimate(plant, {"static_curve": True})
    assert found.value("dead_command") == pytest.approx(0.15, rel=1e-4)
    assert found.value("static_gain") == pytest.approx(1.1, rel=1e-4)
    assert found.value("rate_falling") == pytest.approx(3.0, rel=1e-4)


def test_cycles_of_one_level_each_tell_the_curve_together():
    plant = replace(FAST, dead_command=0.15, static_gain=1.1)
    options = complete_options(MODEL, {**NO_LIMIT, "static_curve": True})
    told: list[Estimate] = []
    for level in (0.4, 0.9, 0.6):
        told += MODEL.estimate(cycle_of(plant, held([0.0, level, 0.0])), options, told)
    first = {p.name: p for p in told[0].parameters}
    assert first["dead_command"].status is ParameterStatus.NOT_EXCITED
    assert "one level" in first["dead_command"].reason
    assert told[-1].value("dead_command") == pytest.approx(0.15, abs=1e-3)
    assert told[-1].value("static_gain") == pytest.approx(1.1, rel=1e-3)
    unseen = cycle_of(plant, held([0.0, 0.75, 0.0]))
    force = model_in_force(MODEL, Memory(tuple(told)), PERIOD_S, options)
    assert force is not None
    assert evaluate(MODEL, force.coefficients, unseen.frames, PERIOD_S)[1] > 99.0


def test_two_delays_are_told_apart():
    plant = replace(FAST, delay=0.12, delay_change=-0.08)
    found = estimate(plant, {"two_delays": True})
    assert found.value("delay") == pytest.approx(0.12 + PERIOD_S)  # and the sample it acts in
    assert found.value("delay_falling") == pytest.approx(0.04 + PERIOD_S)
    assert found.value("rate_falling") == pytest.approx(3.0, rel=1e-3)


@pytest.mark.parametrize("delay_change", [0.0, 1.2])
def test_a_cycle_that_begins_with_its_command_keeps_its_only_opening(delay_change):
    """A delay of 2.55 s, longer than the whole opening, left nothing that tells of a rise."""
    plant = replace(FAST, delay=0.4, delay_change=delay_change, slew_rising=0.7, slew_falling=0.5)
    cycle = cycle_of(plant, np.array([*held([0.0], 60), *held([1.0, 0.0], 200)]), noise=0.002)
    begun = Cycle(1, PERIOD_S, cycle.frames[60:])
    options = complete_options(MODEL, {"two_delays": True, "max_delay_s": 2.9})
    (found,) = MODEL.estimate(begun, options)
    assert found.value("slew_rising") == pytest.approx(0.7, rel=0.03)
    assert found.value("delay") == pytest.approx(0.44, abs=0.2)
    assert found.value("slew_falling") == pytest.approx(0.5, rel=0.03)
    assert found.value("delay_falling") == pytest.approx(0.44 + delay_change, abs=0.1)


def test_backlash_is_recovered():
    found = estimate(replace(FAST, backlash=0.06), {"max_backlash": 0.2})
    assert found.value("backlash") == pytest.approx(0.06, rel=0.05)
    assert found.value("rate_rising") == pytest.approx(4.0, rel=0.02)


def test_stiction_is_seen_in_what_a_resting_spool_ignores():
    """A staircase of 0.02: with stiction 0.05 the spool goes every third step."""
    plant = replace(FAST, stiction=0.05, dead_band=0.005)
    stairs = held([*np.arange(0.2, 0.8, 0.02), *np.arange(0.8, 0.2, -0.02), 0.7, 0.1], 25)
    options = {"max_stiction": 0.2, "max_dead_band": 0.02}
    without = estimate(plant, {**options, "max_stiction": 0.0}, stairs)
    found = estimate(plant, options, stairs)
    cycle = cycle_of(plant, stairs)
    fits = []
    for e, chosen in ((without, {**options, "max_stiction": 0.0}), (found, options)):
        complete = complete_options(MODEL, {**NO_LIMIT, **chosen})
        force = model_in_force(MODEL, Memory((e,)), PERIOD_S, complete)
        assert force is not None
        fits.append(evaluate(MODEL, force.coefficients, cycle.frames, PERIOD_S)[1])
    assert fits[1] > 99.0 > fits[0]
    # thresholds between two steps do the same: 0.05 to 0.07 here, the truth is 0.055
    assert 0.05 < found.value("stiction") + found.value("dead_band") < 0.065


def test_the_one_step_prediction_of_the_true_valve_is_exact_without_a_lag():
    plant = replace(FAST, dead_command=0.15, static_gain=1.1, delay=0.12, delay_change=-0.08)
    options = complete_options(
        MODEL, {**NO_LIMIT, "static_curve": True, "two_delays": True, "lower_stop": 0.0}
    )
    cycle = cycle_of(plant)
    found = MODEL.estimate(cycle, options)[0]
    force = model_in_force(MODEL, Memory((found,)), PERIOD_S, options)
    assert force is not None
    mse, fit = evaluate(MODEL, force.coefficients, cycle.frames, PERIOD_S)
    assert mse < 1e-10
    assert fit > 99.99


def predict(cycle, coefficients, cuts=()):
    restart = blocks.marked(len(cycle.frames), {150: 1, 200: 2, 250: 3})
    return blocks.predict(MODEL, coefficients, cycle.frames, restart, cuts)


def test_any_split_into_blocks_gives_the_same_bits():
    plant = replace(FAST, velocity_lag=0.2, backlash=0.02, stiction=0.01)
    options = complete_options(
        MODEL, {**NO_LIMIT, "second_order": True, "max_backlash": 0.1, "max_stiction": 0.1}
    )
    cycle = cycle_of(plant, noise=1e-3)
    values = {"rate_rising": 4.0, "rate_falling": 3.0, "velocity_lag": 0.2, "backlash": 0.02}
    coefficients = MODEL.coefficients(values, 2, PERIOD_S, options)
    whole = predict(cycle, coefficients)
    rng = np.random.default_rng(3)
    for _ in range(10):
        cuts = np.sort(rng.choice(np.arange(1, 500), 5, replace=False))
        split = predict(cycle, coefficients, cuts)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, split, strict=True))


def test_blocks_of_the_simulated_valve_of_any_length_give_the_same_samples():
    plant = PositionerPlant(velocity_lag=0.2, backlash=0.02, dead_command=0.05, delay_change=0.02)
    config = replace(get_simulation("positioner"), plant=plant)
    whole = SimulatedValve(config, seed=5).advance(600)
    valve = SimulatedValve(config, seed=5)
    split = join_blocks([valve.advance(n) for n in (1, 250, 349)])
    assert whole.position.tobytes() == split.position.tobytes()


def test_further_terms_at_zero_leave_the_simulated_valve_as_it_was():
    """The extended recursion with a vanishing backlash against the plain one."""
    plain = cycle_of(PositionerPlant()).frames.position
    extended = cycle_of(PositionerPlant(backlash=1e-12)).frames.position
    assert extended == pytest.approx(plain, abs=1e-9)


def test_a_delay_change_that_looks_ahead_is_named():
    with pytest.raises(ValueError, match=r"delay_change = -0.2: with delay"):
        PositionerPlant(delay=0.05, delay_change=-0.2)
