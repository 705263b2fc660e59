# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Delay and pole: found to a part of a sample, pooled over cycles."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    OutputErrorOptions,
    acting_command,
    find_phases,
    fit_lag,
    lay_out,
)
from valve_twin.core.valves.press_cartridge.estimation.response.timing import (
    Timing,
    choose_timing,
    find_timing,
    pool_timing,
)

QUIET = Truth(sigma=1e-6, process_noise=0.0, leak=0.0)
OPTIONS = OutputErrorOptions()
ALL = np.ones(5, np.bool_)


def run_of(truth, seed=0):
    frames = generate_cycle(truth, np.random.default_rng([5, seed])).frames
    return lay_out(frames, find_masks(frames, 0.03, push=(1.0, -1.0)), 0.03, truth.sigma, OPTIONS)


def test_a_command_between_two_samples_is_interpolated():
    command = np.array([0.0, 0.0, 0.8, 0.8, 0.4])
    assert acting_command(command, 1.0) == pytest.approx([0.0, 0.0, 0.0, 0.8, 0.8])
    assert acting_command(command, 0.25) == pytest.approx([0.0, 0.0, 0.6, 0.8, 0.5])


@pytest.mark.parametrize("part", [-0.4, 0.0, 0.3])
def test_a_part_of_a_sample_is_found(part):
    """The position is made from commands that act 2 samples and a part of one late."""
    run = run_of(QUIET)
    acting = [acting_command(v, 2.0 + part) for v in (run.v_in, run.v_out)]
    speed, position = 0.0, np.full(len(run.position), 0.3)
    for n in range(1, len(position)):
        speed = 0.4 * speed + 0.6 * (0.01 * acting[0][n] - 0.03 * acting[1][n])
        position[n] = position[n - 1] + speed
    found = find_timing(replace(run, position=position), 2, ALL, OPTIONS)
    assert found.delay == pytest.approx(2.0 + part, abs=0.02)
    assert found.pole == pytest.approx(0.4, abs=0.02)


def test_a_fixed_delay_stays_and_its_pole_is_searched_everywhere():
    run = run_of(replace(QUIET, pole=0.8))
    found = find_timing(run, 2, ALL, replace(OPTIONS, delay=2.0))
    assert found == Timing(2.0, found.pole)
    assert found.pole == pytest.approx(0.8, abs=1e-3)


def test_few_cycles_are_not_pooled_and_a_wrong_third_does_no_harm():
    """Two cycles of three say 1.9, one takes a sample less with a slow pole."""
    alone = [(1.9, 0.1), (1.95, 0.1), (0.9, 0.5)] * 5
    assert pool_timing(alone[:4]) is None
    found = pool_timing([*alone, (np.nan, np.nan)])
    assert found is not None
    assert found.pooled
    assert found.pole == pytest.approx(0.1)
    assert found.delay == pytest.approx(1.9, abs=0.06)


def test_a_cycle_takes_the_pooled_timing_unless_it_contradicts_it():
    noisy = run_of(replace(QUIET, sigma=4e-3, pole=0.2))
    own = find_timing(noisy, 2, ALL, OPTIONS)
    pooled = Timing(2.0, 0.2, pooled=True)
    assert choose_timing(noisy, own, pooled, ALL, OPTIONS).timing is pooled
    assert choose_timing(noisy, own, None, ALL, OPTIONS).timing is own
    sharp = run_of(replace(QUIET, pole=0.2))
    own = find_timing(sharp, 2, ALL, OPTIONS)
    chosen = choose_timing(sharp, own, Timing(1.0, 0.2, pooled=True), ALL, OPTIONS)
    assert chosen.timing is own
    timed = replace(OPTIONS, pole=own.pole)
    fresh = fit_lag(sharp, find_phases(sharp, own.delay, OPTIONS), ALL, timed)
    known = fit_lag(sharp, chosen.phases, ALL, timed, chosen.linear)
    assert known.gram.tobytes() == fresh.gram.tobytes()
    assert known.linear.tobytes() == fresh.linear.tobytes()
