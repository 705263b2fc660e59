# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signals that are short of samples or bits, late, early, or of another size are named."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus, Frames
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options

SIMULATION = MODEL.simulation()


def frames_of(seed=1, **layer):
    measurement = replace(SIMULATION.measurement, **layer)
    config = replace(SIMULATION, measurement=measurement)
    (block,) = simulate_cycles(config, 1, seed=seed)
    return to_frames(block)


def fault(frames, **options):
    cycle = Cycle(1, SIMULATION.period_s, frames)
    return MODEL.input_fault(cycle, complete_options(MODEL, options))


def scaled(frames, factor):
    """Return the position in another scale; shipped limits take out what lies beyond them."""
    position = factor * frames.position
    return replace(frames, position=position, valid=(position > -0.2) & (position < 1.2))


def shifted(frames, samples):
    y = frames.position
    late = np.concatenate([np.full(abs(samples), y[0]), y[: -abs(samples)]])
    early = np.concatenate([y[abs(samples) :], np.full(abs(samples), y[-1])])
    return replace(frames, position=late if samples > 0 else early)


@pytest.mark.parametrize("noise", [1e-5, 1e-3, 4e-3])
def test_good_cycles_pass(noise):
    for seed in range(5):
        frames = frames_of(seed, noise=noise)
        assert fault(frames, usual_stroke=0.28) == ""
        assert fault(replace(frames, position=np.round(frames.position * 256.0) / 256.0)) == ""


def test_limits_do_not_hide_a_wrong_unit():
    assert "spool_position runs from" in fault(scaled(frames_of(), 10.0))


@pytest.mark.parametrize("factor", [0.1, 0.5, 3.0])
def test_a_wrong_scale_shows_in_the_usual_stroke(factor):
    said = fault(scaled(frames_of(), factor), usual_stroke=0.28)
    assert "usual_stroke is 0.28: correct signals.spool_position.scale" in said


@pytest.mark.parametrize(
    ("samples", "text"), [(17, "moves 0.51 s after its"), (-3, "moves 0.09 s before its")]
)
def test_a_position_out_of_step_with_its_commands_is_named(samples, text):
    for seed in range(5):
        assert text in fault(shifted(frames_of(seed), samples))


def cylinder(seed, ahead=0):
    """Return a cycle of a cylinder whose commands press on after it has reached its stops."""
    rng = np.random.default_rng(seed)
    n, (run, back, late) = 345, rng.integers((50, 50, 1), (75, 75, 5))
    inputs = np.zeros((n, 2))
    inputs[:110, 0], inputs[185:305, 1] = 1.0, 1.0
    speed = np.zeros(n)
    speed[late : late + run], speed[185 + late : 185 + late + back] = 1.0 / run, -1.0 / back
    position = np.concatenate(([0.0], np.cumsum(speed)[:-1]))
    position = np.concatenate((position[ahead:], np.full(ahead, position[-1])))
    position += rng.normal(0.0, 5e-4, n)
    none = np.full(n, np.nan)
    stamps = np.arange(n, dtype=np.int64) * 20_000_000
    return Frames(stamps, position, inputs, none, none, np.ones(n, dtype=np.bool_))


@pytest.mark.parametrize("seed", range(20))
def test_a_cylinder_pressed_against_its_stops_is_in_step(seed):
    frames = cylinder(seed)
    frames.position[300 if seed % 2 else 90] += 0.3  # a wild sample is no stop
    cycle = Cycle(1, 0.02, frames)
    assert MODEL.input_fault(cycle, complete_options(MODEL, {})) == ""


@pytest.mark.parametrize("seed", range(20))
def test_a_cylinder_that_reaches_its_stops_before_its_commands_is_out_of_step(seed):
    frames = cylinder(seed, ahead=45)
    cycle = Cycle(1, 0.02, frames)
    assert "before its commands" in MODEL.input_fault(cycle, complete_options(MODEL, {}))


def test_a_command_that_is_often_no_number_is_named():
    frames = frames_of()
    inputs = frames.inputs.copy()
    inputs[::10, 0] = np.nan
    assert fault(replace(frames, inputs=inputs)).startswith("v_in is no number in 10% of the")
    valid = np.arange(len(frames.position)) % 10 > 0
    assert fault(replace(frames, valid=valid)).startswith("10% of the samples are outside")


def test_a_position_of_six_bits_is_refused_with_its_step():
    frames = frames_of()
    coarse = replace(frames, position=np.round(frames.position * 64.0) / 64.0)
    assert "moves in steps of 0.0156" in fault(coarse)
    cycle = Cycle(1, SIMULATION.period_s, coarse)
    (found,), _ = estimate_cycle(MODEL, complete_options(MODEL, {}), cycle, Memory.empty())
    assert found.status is EstimateStatus.REFUSED
    assert "steps of 0.0156" in found.reason
