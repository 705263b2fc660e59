# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Masks take out what says nothing about the valve, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.data.masks import MaskOptions, find_masks, held_recently
from valve_twin.core.gaps import find_gaps

PERIOD_S = 0.03
PUSH = (1.0, -1.0)


def masks_of(frames):
    return find_masks(frames, PERIOD_S, push=PUSH)


def clean_cycle(**truth):
    return generate_cycle(Truth(**truth), np.random.default_rng(1)).frames


def refreshed(frames, period, phase):
    """Hold each value until the next refresh, as a sensor that is slower than its log."""
    n = np.arange(len(frames))
    source = np.maximum(n - (n - phase) % period, 0)
    return replace(frames, position=frames.position[source]), (n > source)


def test_a_spindle_pushed_onto_its_seat_is_masked(make_frames):
    v_out = np.r_[np.zeros(20), np.full(20, 0.3), np.zeros(20)]
    seat = masks_of(make_frames(np.zeros(60), 0.0, v_out)).seat
    assert seat[20:40].all()
    assert not seat[:20].any()
    # the cut-off speed of an impact acts on until lag and stencil have passed
    reach = MaskOptions().max_lag + 2
    assert seat[40 : 40 + reach].all()
    assert not seat[40 + reach :].any()


def test_the_upper_stop_counts_only_against_inflow(make_frames):
    high = np.ones(30)
    assert masks_of(make_frames(high, 0.3, 0.0)).seat.all()
    assert not masks_of(make_frames(high, 0.0, 0.3)).seat.any()


def test_the_stops_are_where_the_options_say(make_frames):
    frames = make_frames(np.full(30, 0.05), 0.0, 0.3)
    assert not masks_of(frames).seat.any()
    shifted = find_masks(frames, PERIOD_S, push=PUSH, options=MaskOptions(lower_stop=0.05))
    assert shifted.seat.all()


def test_the_sign_of_push_turns_the_sides_round(make_frames):
    frames = make_frames(np.zeros(30), 0.3, 0.0)
    assert not find_masks(frames, PERIOD_S, push=(1.0, -1.0)).seat.any()
    assert find_masks(frames, PERIOD_S, push=(-1.0, 1.0)).seat.all()


@pytest.mark.parametrize("sigma", [0.0, 1e-3, 4e-3])
def test_a_spool_that_ignores_a_clear_command_is_stuck(make_frames, sigma):
    noise = sigma * np.random.default_rng(2).standard_normal(120)
    v_in = np.r_[np.zeros(30), np.full(60, 0.4), np.zeros(30)]
    stuck = masks_of(make_frames(0.4 + noise, v_in, 0.0)).stuck
    assert stuck[40:85].mean() > 0.9
    assert not stuck[:30].any()
    assert not stuck[90:].any()


@pytest.mark.parametrize("sigma", [0.0, 1e-3, 4e-3])
def test_a_working_valve_is_neither_stuck_nor_stale(sigma):
    masks = masks_of(clean_cycle(sigma=sigma))
    assert not masks.stuck.any()
    assert not masks.stale.any()
    assert masks.refresh_period == 1.0


@pytest.mark.parametrize("bits", [6, 8, 10, 12])
@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_quantised_values_that_repeat_are_not_stale(bits, sigma):
    frames = clean_cycle(sigma=sigma)
    quantum = 2.0**-bits
    rounded = replace(frames, position=np.round(frames.position / quantum) * quantum)
    masks = masks_of(rounded)
    assert not masks.stale.any()
    assert masks.refresh_period == 1.0


@pytest.mark.parametrize("period", [2, 3, 4, 5])
@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize("sigma", [1e-5, 1e-3, 4e-3])
def test_every_repeat_of_a_slow_sensor_is_found(period, phase, sigma):
    frames, held = refreshed(clean_cycle(sigma=sigma, leak=0.0), period, phase)
    masks = masks_of(frames)
    assert masks.refresh_period == period
    assert np.array_equal(masks.stale[period:], held[period:])


@pytest.mark.parametrize("period", [2, 3, 4])
def test_a_slow_sensor_without_noise_is_found_in_motion(period):
    frames, held = refreshed(clean_cycle(sigma=0.0), period, 0)
    masks = masks_of(frames)
    moving = np.abs(frames.inputs).max(axis=1) > 0.1
    assert masks.refresh_period == period
    assert np.array_equal(masks.stale[moving], held[moving])


def test_a_refresh_that_is_no_whole_number_of_samples_is_measured():
    frames = clean_cycle(sigma=1e-3)
    source = np.floor(np.floor(np.arange(len(frames)) / 2.5) * 2.5 + 0.5).astype(int)
    masks = masks_of(replace(frames, position=frames.position[source]))
    assert masks.refresh_period == pytest.approx(2.5, abs=0.1)


def test_a_frozen_sensor_is_stale_while_it_is_frozen():
    frames = clean_cycle(sigma=1e-3)
    position = frames.position.copy()
    position[300:360] = position[299]
    masks = masks_of(replace(frames, position=position))
    assert np.array_equal(np.flatnonzero(masks.stale), np.arange(300, 360))
    assert masks.refresh_period == 1.0


def test_a_freeze_through_a_motion_is_found_without_noise():
    frames = clean_cycle(sigma=0.0, process_noise=0.0)
    position = frames.position.copy()
    position[90:100] = position[89]
    assert np.abs(frames.inputs[80:100]).max() > 0.05
    masks = masks_of(replace(frames, position=position))
    assert np.array_equal(np.flatnonzero(masks.stale), np.arange(90, 100))


def test_a_sensor_that_clips_at_the_end_of_its_range_is_not_frozen():
    frames = clean_cycle(sigma=1e-3)
    masks = masks_of(replace(frames, position=np.maximum(frames.position, 0.005)))
    assert not masks.stale.any()


def test_what_is_not_valid_or_not_finite_is_bad(make_frames):
    frames = make_frames(np.linspace(0.2, 0.3, 12))
    position, inputs, valid = frames.position.copy(), frames.inputs.copy(), frames.valid.copy()
    position[3], inputs[5, 1], valid[7] = np.nan, np.inf, False
    masks = masks_of(replace(frames, position=position, inputs=inputs, valid=valid))
    assert np.flatnonzero(masks.bad).tolist() == [3, 5, 7]


def test_gaps_are_missing_samples_and_stamps_that_do_not_advance():
    stamps = np.array([0, 30, 60, 120, 150, 150, 180], np.int64) * 1_000_000
    assert np.flatnonzero(find_gaps(stamps, PERIOD_S)).tolist() == [3, 5]


def test_jitter_of_the_stamps_is_no_gap():
    jitter = np.random.default_rng(3).uniform(-6e6, 6e6, 200).astype(np.int64)
    assert not find_gaps(np.arange(200, dtype=np.int64) * 30_000_000 + jitter, PERIOD_S).any()


@pytest.mark.parametrize("count", [0, 1, 2, 5, 30])
def test_short_cycles_have_masks_of_their_length(make_frames, count):
    masks = masks_of(make_frames(np.zeros(count), 0.5, 0.0))
    assert len(masks.any) == len(masks.gap) == count


def test_push_needs_one_sign_an_input(make_frames):
    with pytest.raises(ValueError, match="push has 1 entries"):
        find_masks(make_frames(np.zeros(5)), PERIOD_S, push=(1.0,))


def test_held_recently_looks_back_so_far_and_no_further():
    flag = np.array([False, True, False, False, False])
    assert held_recently(flag, 0).tolist() == flag.tolist()
    assert held_recently(flag, 2).tolist() == [False, True, True, True, False]
    assert held_recently(flag, 9).tolist() == [False, True, True, True, True]
