# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The noise floor is that of the sensor, whatever drifts or repeats."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.estimation.data.noise import find_rest, rest_noise

PERIOD_S = 0.03


def noise_of(frames):
    return rest_noise(frames, find_masks(frames, PERIOD_S, push=(1.0, -1.0)))


@pytest.mark.parametrize("sigma", [1e-6, 1e-3, 1e-2])
def test_noise_is_unbiased(make_frames, sigma):
    rng = np.random.default_rng(6)
    measured = [noise_of(make_frames(sigma * rng.standard_normal(500))).sigma for _ in range(100)]
    # second differences of white noise: sd of one estimate 4.4 %, of the mean 0.44 %
    assert np.mean(measured) == pytest.approx(sigma, rel=0.015)


def test_single_outliers_are_no_noise_where_they_are_left_out(make_frames):
    """Stranger 96074: 4e-3 in one sample, which no search for spikes finds, told as noise."""
    rng = np.random.default_rng(7)
    quiet = 5e-5 * rng.standard_normal(200)
    odd = quiet.copy()
    odd[[0, 90]] += 4e-3, -4e-3  # one at the edge of the record
    for x, sigma in ((odd, 5e-5), (quiet, 5e-5)):
        frames = make_frames(x)
        masks = find_masks(frames, PERIOD_S, push=(1.0, -1.0))
        assert rest_noise(frames, masks, outliers=False).sigma == pytest.approx(sigma, rel=0.2)
    assert noise_of(make_frames(odd)).sigma > 4.0 * 5e-5


@pytest.mark.parametrize("share", [0.07, 0.1, 0.15, 0.3])
def test_a_sensor_that_is_off_in_many_samples_is_noisy(make_frames, share):
    """A loose contact was as quiet as before, its noise that of the samples between."""
    rng = np.random.default_rng(8)
    quiet = 5e-4 * rng.standard_normal(1000)
    loose = quiet + 0.02 * (rng.random(1000) < share) * rng.choice((-1.0, 1.0), 1000)
    frames = make_frames(loose)
    masks = find_masks(frames, PERIOD_S, push=(1.0, -1.0))
    assert rest_noise(frames, masks, outliers=False).sigma > 5.0 * 5e-4


def test_steps_of_a_sensor_that_mostly_repeats_are_not_taken_for_outliers(make_frames):
    x = 1e-3 * (np.arange(200) % 9 == 0)
    frames = make_frames(x)
    masks = replace(find_masks(frames, PERIOD_S, push=(1.0, -1.0)), stale=np.zeros(200, bool))
    with_all, without = (rest_noise(frames, masks, outliers=o).sigma for o in (True, False))
    assert without == pytest.approx(with_all, rel=1e-12)
    assert without > 0.0


def test_noise_of_whole_cycles_does_not_count_the_motion():
    truth = Truth(sigma=1e-3, leak=3e-5)
    measured = [
        noise_of(generate_cycle(truth, np.random.default_rng(seed)).frames).sigma
        for seed in range(20)
    ]
    # sd of one estimate 4 %, of the mean 1 %; the controller answers large noise, so rest lacks it
    assert np.mean(measured) == pytest.approx(1e-3, rel=0.04)


def test_a_leak_that_ends_on_the_seat_is_not_noise():
    frames = generate_cycle(Truth(sigma=1e-5, leak=3e-5), np.random.default_rng(0)).frames
    assert noise_of(frames).sigma == pytest.approx(1e-5, rel=0.12)


def test_a_leak_in_hold_is_not_noise(make_frames):
    x = 0.3 - 1e-3 * np.arange(200) + 1e-5 * np.random.default_rng(4).standard_normal(200)
    assert noise_of(make_frames(x)).sigma == pytest.approx(1e-5, rel=0.2)


def test_repeats_of_a_slow_sensor_do_not_hide_the_noise():
    measured = []
    for seed in range(10):
        frames = generate_cycle(Truth(sigma=2e-3), np.random.default_rng(seed)).frames
        source = np.arange(len(frames)) // 4 * 4
        measured.append(noise_of(replace(frames, position=frames.position[source])).sigma)
    # some 130 second differences a cycle, 10 cycles: sd of the mean 2.7 %
    assert np.mean(measured) == pytest.approx(2e-3, rel=0.08)


def test_a_cycle_without_rest_has_no_noise_level(make_frames):
    noise = noise_of(make_frames(np.linspace(0.1, 0.9, 100), 0.5, 0.0))
    assert np.isnan(noise.sigma)
    assert noise.samples == 0


def test_a_gap_splits_the_rest(make_frames):
    x = np.r_[np.full(40, 0.2), np.full(40, 0.7)] + 1e-4 * np.random.default_rng(5).normal(size=80)
    frames = make_frames(x)
    later = frames.stamp_ns + np.where(np.arange(80) >= 40, 10**10, 0)
    assert noise_of(replace(frames, stamp_ns=later)).sigma < 2e-4


def test_rest_begins_when_lag_and_pole_have_passed(make_frames):
    v_in = np.r_[np.zeros(10), np.full(5, 0.3), np.zeros(30)]
    frames = make_frames(np.zeros(45), v_in, 0.0)
    rest = find_rest(frames, find_masks(frames, PERIOD_S, push=(1.0, -1.0)), settle=15)
    assert np.flatnonzero(rest).tolist() == [*range(10), *range(30, 45)]


@pytest.mark.parametrize("count", [0, 1, 5])
def test_hardly_any_samples_give_no_noise_level(make_frames, count):
    assert np.isnan(noise_of(make_frames(np.zeros(count))).sigma)
