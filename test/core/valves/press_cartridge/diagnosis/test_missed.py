# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Values that a sensor did not renew in motion are counted; what looks like them is not."""

import numpy as np
import pytest

from valve_twin.core.valves.press_cartridge.diagnosis.missed import missed_values

STEP = 0.005  # of the position in a sample of motion


def stroke(seed=0, noise=2e-4, stops=()):
    """Return the position of a cycle: rest, 60 samples up, hold, 60 down, rest."""
    speed = np.concatenate([np.zeros(50), np.ones(60), np.zeros(100), -np.ones(60), np.zeros(50)])
    speed[list(stops)] = 0.0
    noises = noise * np.random.default_rng(seed).standard_normal(len(speed))
    return np.cumsum(STEP * speed) + noises


def held(x, at):
    """Return what a sensor shows that repeats its last value at some samples."""
    index = np.arange(len(x))
    index[list(at)] = -1
    return x[np.maximum.accumulate(index)]


def test_each_repeat_in_motion_is_counted():
    found = missed_values(held(stroke(), (70, 85, 86, 230)))
    assert found.missed == 4
    assert found.due == pytest.approx(110, abs=10)  # the two ends of each motion are left out


def test_a_sound_sensor_misses_nothing():
    assert [missed_values(stroke(seed)).missed for seed in range(200)] == [0] * 200


@pytest.mark.parametrize("refresh", [2, 4])
def test_a_slow_sensor_misses_only_what_it_leaves_out(refresh):
    x = stroke()
    slow = [i for i in range(len(x)) if i % refresh]
    assert missed_values(held(x, slow)).missed == 0
    assert missed_values(held(x, [*slow, 80])).missed == 1


def test_a_spool_that_stands_still_for_a_moment_is_no_frozen_sensor():
    assert missed_values(stroke(noise=0.0, stops=(70, 71, 90))).missed == 0


def test_rounding_and_noise_hide_what_a_repeat_would_say():
    coarse = np.round(stroke() / 5e-3) * 5e-3
    assert missed_values(held(coarse, (70, 85))).due == 0
    assert missed_values(coarse).quantum == pytest.approx(5e-3)
    assert missed_values(held(stroke(noise=3e-3), (70, 85))).due == 0


def test_a_cycle_without_motion_says_nothing():
    assert missed_values(np.zeros(500)) == (0, 0, 0.0)
    assert missed_values(np.zeros(0)) == (0, 0, 0.0)
