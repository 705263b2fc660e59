# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signals that are not what is configured are named; no working valve is refused for it."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.plausibility import wrong_step
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.simulation.block import to_frames
from valve_twin.core.types import Cycle, EstimateStatus, Frames, join_frames
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

PRESS, POSITIONER = get_model("press_cartridge"), get_model("positioner")
PRESS_S, POSITIONER_S = 0.03, 0.02


def fault_of(model, frames, period_s, **options):
    return model.input_fault(Cycle(1, period_s, frames), complete_options(model, options))


def changed(frames, position=None, inputs=None):
    return replace(
        frames,
        position=frames.position if position is None else position,
        inputs=frames.inputs if inputs is None else inputs,
    )


@pytest.fixture(scope="module")
def press(plant_cycles):
    """Return a cycle of a healthy press valve."""
    return plant_cycles(1, 2, noise=1e-3, delay=1)[0]


@pytest.fixture(scope="module")
def follower():
    """Return a position that follows its command after 5 samples, with different speeds."""
    rng = np.random.default_rng(8)
    n = 3000
    command = np.repeat(rng.uniform(0.3, 0.9, n // 200), 200) * (np.arange(n) % 400 < 250)
    position = np.zeros(n)
    for k in range(5, n):
        move = np.clip(8.0 * (command[k - 5] - position[k - 1]), -0.9, 1.4)
        position[k] = position[k - 1] + POSITIONER_S * move
    position += rng.normal(0.0, 5e-4, n)
    nothing = np.full(n, np.nan)
    stamps = np.arange(n, dtype=np.int64) * 20_000_000
    return Frames(stamps, position, command[:, None], nothing, nothing, np.ones(n, bool))


@pytest.mark.parametrize(
    "layer",
    [
        {"noise": 1e-5},
        {"noise": 1e-3, "delay": 1},
        {"noise": 1e-2, "delay": 2},
        {"noise": 4e-3, "refresh": 5},
    ],
)
def test_nothing_speaks_against_a_press_valve_with_any_sensor(plant_cycles, layer):
    for frames in plant_cycles(4, 5, **layer):
        assert fault_of(PRESS, frames, PRESS_S) == ""


def test_nothing_speaks_against_a_valve_that_follows(follower):
    assert fault_of(POSITIONER, follower, POSITIONER_S) == ""
    slow = changed(follower, position=0.4 * follower.position + 0.2)
    assert fault_of(POSITIONER, slow, POSITIONER_S) == ""


PRESS_MISTAKES = {
    "exchanged commands": (
        lambda y, u: (y, u[:, ::-1]),
        "spool_position falls while v_in is on and rises while v_out is on: exchange signals.v_in",
    ),
    "inverted position": (
        lambda y, u: (1.0 - y, u),
        "rises while v_out is on: the position is inverted: turn the sign of signals.spool_pos",
    ),
    "negated position": (
        lambda y, u: (-y, u),
        "rises while v_out is on: the position is inverted: turn the sign of signals.spool_pos",
    ),
    "backwards in time": (
        lambda y, u: (y[::-1], u[::-1]),
        "exchange signals.v_in and signals.v_out (or the record runs backwards)",
    ),
    "position in percent": (
        lambda y, u: (100.0 * y, u),
        "it is to be 0 to 1: correct signals.spool_position.scale (0.01 for percent)",
    ),
    "commands in percent": (
        lambda y, u: (y, 100.0 * u),
        "v_in runs from 0 to 80, it is to be 0 to 1: correct signals.v_in.scale (0.01 for",
    ),
    "one topic for both commands": (
        lambda y, u: (y, u[:, [0, 0]]),
        "v_in and v_out carry the same values: correct signals.v_in or signals.v_out",
    ),
    "a command for the position": (
        lambda y, u: (u[:, 0], u),
        "spool_position and v_in carry the same values",
    ),
    "commands that stay on": (
        lambda y, u: (y, 0.0 * u + 0.5),
        "nothing is commanded, v_in at 0.5 and v_out at 0.5 all the time",
    ),
}


@pytest.mark.no_cover
@pytest.mark.parametrize(("wrong", "says"), PRESS_MISTAKES.values(), ids=PRESS_MISTAKES)
def test_a_wrong_mapping_of_a_press_valve_is_named(press, wrong, says):
    position, inputs = wrong(press.position, press.inputs)
    assert says in fault_of(PRESS, changed(press, position, inputs), PRESS_S)


POSITIONER_MISTAKES = {
    "exchanged": (
        lambda y, u: (u, y),
        "before command: exchange signals.position and signals.command, or the record runs",
    ),
    "backwards in time": (lambda y, u: (y[::-1], u[::-1]), "or the record runs backwards"),
    "inverted": (lambda y, u: (1.0 - y, u), "position falls as command rises (correlation -0.9"),
    "negated": (lambda y, u: (-y, u), "(a negative one where it is inverted)"),
    "position in percent": (lambda y, u: (100.0 * y, u), "signals.position.scale (0.01 for perc"),
    "command in percent": (lambda y, u: (y, 100.0 * u), "signals.command.scale (0.01 for percen"),
    "the command for the position": (lambda y, u: (u, u), "carry the same values"),
}


@pytest.mark.parametrize(("wrong", "says"), POSITIONER_MISTAKES.values(), ids=POSITIONER_MISTAKES)
def test_a_wrong_mapping_of_a_positioner_is_named(follower, wrong, says):
    position, command = wrong(follower.position, follower.inputs[:, 0])
    frames = changed(follower, np.ascontiguousarray(position), command.reshape(-1, 1))
    assert says in fault_of(POSITIONER, frames, POSITIONER_S)


@pytest.mark.parametrize("period_s", [0.003, 0.024, 0.036, 30.0])
def test_a_wrong_sampling_time_is_seen(period_s):
    stamps = np.arange(500, dtype=np.int64) * 30_000_000
    assert wrong_step(stamps, period_s) == pytest.approx(0.03)


def test_lost_and_bunched_samples_are_no_wrong_sampling_time():
    rng = np.random.default_rng(4)
    whole = np.arange(1000, dtype=np.int64) * 30_000_000
    assert wrong_step(whole[rng.random(1000) > 0.3], 0.03) == 0.0
    jitter = rng.normal(0.0, 5e6, 1000).astype(np.int64)
    assert wrong_step(whole + jitter, 0.03) == 0.0
    bunched = whole - whole % 120_000_000 + np.arange(1000) % 4  # four at a time
    assert wrong_step(bunched, 0.03) == 0.0
    paused = whole + 60_000_000_000 * (np.arange(1000) > 500)
    assert wrong_step(paused, 0.03) == 0.0
    assert wrong_step(paused, 0.04) > 0.0
    assert wrong_step(whole[:10], 0.05) == 0.0  # too few to tell


def test_outliers_are_no_unit(press):
    position = press.position.copy()
    position[[100, 500]] = 60.0
    assert fault_of(PRESS, changed(press, position), PRESS_S) == ""


@pytest.mark.parametrize("what", ["position", "inputs"])
def test_signals_of_missing_values_say_nothing(press, what):
    frames = changed(press, **{what: np.full_like(getattr(press, what), np.nan)})
    assert fault_of(PRESS, frames, PRESS_S) == ""


def test_nothing_is_fitted_to_exchanged_commands(press):
    frames = changed(press, inputs=np.ascontiguousarray(press.inputs[:, ::-1]))
    cycle = Cycle(1, PRESS_S, frames)
    estimates, memory = estimate_cycle(PRESS, complete_options(PRESS, {}), cycle, Memory.empty())
    for estimate in estimates:
        assert estimate.status is EstimateStatus.REFUSED
        assert "exchange signals.v_in and signals.v_out" in estimate.reason
        assert not any(p.usable for p in estimate.parameters)
    assert memory.of(PRESS.trend_estimator) == ()


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0])
def test_a_frozen_position_is_refused_with_its_value(press, value):
    frames = changed(press, position=np.full_like(press.position, value))
    estimates, _ = estimate_cycle(
        PRESS, complete_options(PRESS, {}), Cycle(1, PRESS_S, frames), Memory.empty()
    )
    assert {e.status for e in estimates} == {EstimateStatus.REFUSED}
    assert f"the position stays at {value:g}" in {e.reason for e in estimates}


SIMULATED = ["stepper_servo", "hybrid_actuator", "servo_system", "double_solenoid", "positioner"]


@pytest.fixture(scope="module")
def simulated():
    """Return a function that gives a cycle of a simulated valve, made once."""
    made = {}

    def make(name):
        if name not in made:
            config = get_simulation(name)
            frames = [to_frames(block) for block in simulate_cycles(config, 1, 3)]
            period_s = float(np.median(np.diff(frames[0].stamp_ns))) * 1e-9
            made[name] = join_frames(frames), period_s
        return made[name]

    return make


@pytest.mark.parametrize("name", SIMULATED)
def test_nothing_speaks_against_a_simulated_valve(simulated, name):
    frames, period_s = simulated(name)
    assert fault_of(get_model(name), frames, period_s) == ""


@pytest.mark.parametrize("name", SIMULATED)
def test_percent_is_named_in_every_signal(simulated, name):
    frames, period_s = simulated(name)
    model = get_model(name)
    said = fault_of(model, changed(frames, 100.0 * frames.position), period_s)
    assert f"signals.{model.output}.scale (0.01 for percent)" in said
    for i, signal in enumerate(model.inputs):
        scaled = frames.inputs.copy()
        scaled[:, i] *= 100.0
        assert f"correct signals.{signal}.scale" in fault_of(
            model, changed(frames, inputs=scaled), period_s
        )


@pytest.mark.parametrize("name", ["stepper_servo", "double_solenoid", "positioner"])
def test_an_inverted_position_of_a_valve_that_follows_is_named(simulated, name):
    frames, period_s = simulated(name)
    said = fault_of(get_model(name), changed(frames, 1.0 - frames.position), period_s)
    assert "one of them is inverted" in said
