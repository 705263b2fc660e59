# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled passes do what the same in plain numpy does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.estimation.data.kernels import (
    choose_independent,
    count_masked,
    excitation_sums,
    longest_run,
    mark_rows,
    mark_seat,
    mark_stuck,
    rest_bends,
)
from valve_twin.core.estimation.data.masks import held_recently
from valve_twin.core.gaps import count_lost, count_paused, extreme_steps, find_gaps

SEEDS = st.integers(0, 10**6)


def flags(rng, n, share):
    return rng.random(n) < share


@given(SEEDS, st.integers(3, 120), st.integers(2, 6), st.booleans())
def test_rows_are_those_without_a_flag_in_reach(seed, n, back, keep_stale):
    rng = np.random.default_rng(seed)
    seat, stuck, stale, bad, gap = (flags(rng, n, 0.05) for _ in range(5))
    lost = seat | stuck | bad if keep_stale else seat | stuck | bad | stale
    out = held_recently(lost, 2) | held_recently(bad, back) | held_recently(gap, back - 1)
    out[:back] = True
    rows = np.empty(n, np.int64)
    count = mark_rows(seat, stuck, stale, bad, gap, keep_stale, back, rows)
    assert rows[:count].tolist() == np.flatnonzero(~out).tolist()
    masked = count_masked(seat, stuck, stale, bad, gap)
    assert masked == (seat.sum(), stuck.sum(), stale.sum(), (bad | gap).sum())


@given(SEEDS, st.integers(30, 200))
def test_second_differences_at_rest_are_those_of_neighbours_in_one_stretch(seed, n):
    rng = np.random.default_rng(seed)
    x, inputs = rng.normal(size=n), np.where(rng.random((n, 2)) < 0.02, 0.5, 0.0)
    bad, gap, stale = flags(rng, n, 0.02), flags(rng, n, 0.03), flags(rng, n, 0.1)
    stuck = flags(rng, n, 0.02)
    left = bad | stale | stuck
    acting = (np.abs(inputs) > 0.1).any(axis=1) | bad
    rest = ~held_recently(acting, 5)
    stretch = np.cumsum(~rest | gap)
    kept = rest & ~left
    label = stretch[kept]
    bend = np.diff(x[kept], 2)[label[2:] == label[:-2]]
    bends = np.empty(n)
    total, count = rest_bends(x, inputs, bad, gap, stale, stuck, 0.1, 5, bends)
    assert bends[:count] == pytest.approx(bend, rel=1e-12, abs=1e-12)
    assert total == pytest.approx(float(np.sum(bend**2)), rel=1e-12)


@given(SEEDS)
def test_excitation_is_that_of_the_rows_in_which_the_input_acts(seed):
    rng = np.random.default_rng(seed)
    x, inputs = rng.normal(size=90), np.maximum(rng.normal(size=(90, 2)), 0.0)
    rows = np.flatnonzero(rng.random(90) < 0.6)
    rows = rows[rows >= 3]
    level = inputs[rows - 2, 1]
    on = level > 0.01
    count, travel, mean, deviation = excitation_sums(x, inputs, rows, 2, 1, 0.01)
    assert count == on.sum()
    acting = rows[on]
    assert travel == pytest.approx(abs(np.sum(x[acting] - x[acting - 1])), rel=1e-9, abs=1e-12)
    assert (mean, deviation) == pytest.approx((level[on].mean(), level[on].std()), rel=1e-12)


@given(SEEDS, st.integers(1, 8))
def test_independent_columns_have_a_part_outside_the_earlier_ones(seed, k):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(40, k)) * 10.0 ** rng.uniform(-3, 3, k)
    for j in range(1, k):
        kind = rng.integers(0, 4)
        if kind == 0:
            u[:, j] = u[:, :j] @ rng.normal(size=j)
        elif kind == 1:
            u[:, j] = 0.0
    chosen = np.empty(k, np.int64)
    count = choose_independent(u.T @ u, np.arange(k), 1e-12, chosen)
    expected: list[int] = []
    for j in range(k):
        length = np.linalg.norm(u[:, j])
        if length == 0.0:
            continue
        others = u[:, expected]
        rest = u[:, j] - others @ np.linalg.lstsq(others, u[:, j], rcond=None)[0]
        if np.linalg.norm(rest) / length > 1e-6:
            expected.append(j)
    assert chosen[:count].tolist() == expected


@given(SEEDS, st.integers(1, 60))
def test_the_longest_run_repeats_one_value_without_a_break(seed, n):
    rng = np.random.default_rng(seed)
    x = rng.integers(0, 3, n).astype(float)
    x[flags(rng, n, 0.1)] = np.nan
    breaks = flags(rng, n, 0.1)
    change = np.ones(n, bool)
    change[1:] = (x[1:] != x[:-1]) | breaks[1:]
    first = np.flatnonzero(change)
    assert longest_run(x, breaks) == np.diff(np.append(first, n)).max()


@given(SEEDS, st.integers(1, 80))
def test_the_seat_is_masked_while_pushed_into_and_shortly_after(seed, n):
    rng = np.random.default_rng(seed)
    x, drive = rng.uniform(-0.1, 1.1, n), rng.choice([-0.5, 0.0, 0.5], n)
    seat = np.zeros(n, bool)
    mark_seat(x, drive, 0.01, 0.99, 0.01, 4, seat)
    down, up = held_recently(drive < -0.01, 4), held_recently(drive > 0.01, 4)
    assert (seat == ((x <= 0.01) & down) | ((x >= 0.99) & up)).all()


@given(SEEDS)
def test_a_stuck_spool_is_a_whole_window_of_command_without_motion(seed):
    rng = np.random.default_rng(seed)
    n, half, lag = 160, 10, 4
    drive = np.repeat(rng.choice([-0.5, 0.0, 0.5], 4), 40)
    x = np.cumsum(np.where(rng.random() < 0.5, 0.01 * drive, 0.0)) + 1e-4 * rng.normal(size=n)
    breaks = flags(rng, n, 0.005)
    stuck = np.zeros(n, bool)
    mark_stuck(x, drive, breaks, half, lag, 0.1, 5e-4, stuck)
    expected = np.zeros(n, bool)
    for end in range(2 * half + lag - 1, n):
        window, reach = (
            slice(end - 2 * half + 1, end + 1),
            slice(end - 2 * half - lag + 1, end + 1),
        )
        if breaks[window].any() or abs(np.sign(drive[reach]).sum()) < 2 * half + lag:
            continue
        steps = np.diff(x[end - 2 * half : end + 1])
        floor = max(5e-4, 3.0 * np.sqrt(np.mean(steps**2) / half))
        if abs(x[window][half:].mean() - x[window][:half].mean()) < floor:
            expected[window] = True
    assert (stuck == expected).all()


@given(SEEDS, st.integers(0, 40))
def test_gaps_and_steps_of_stamps(seed, n):
    rng = np.random.default_rng(seed)
    steps = rng.choice([30, 30, 30, 45, 46, 90, 0, -30], n) * 1_000_000
    stamps = np.cumsum(steps).astype(np.int64)
    expected = np.zeros(n, bool)
    step = np.diff(stamps)
    expected[1:] = (step > 45_000_000) | (step <= 0)
    assert (find_gaps(stamps, 0.03) == expected).all()
    assert extreme_steps(stamps) == ((step.min(), step.max()) if n > 1 else (0, 0))
    rising = np.cumsum(np.abs(steps) + 1_000_000).astype(np.int64)
    missing = np.diff(rising) / 30e6
    assert count_paused(rising, 0.03) == 0
    assert count_lost(rising, 0.03) == int(np.rint(missing[missing > 1.5] - 1.0).sum())


def test_a_pause_is_not_a_loss():
    """99 samples missing for a second at 10 ms are one; 19 periods of 1 s are a loss."""
    stamps = np.cumsum([0, 1, 1, 5, 1, 100, 1, 99, 1]) * 10_000_000
    assert count_lost(stamps, 0.01) == 4 + 99 + 98
    assert count_paused(stamps, 0.01) == 99
    slow = np.cumsum([0, 1, 19, 1, 20, 1]) * 1_000_000_000
    assert (count_lost(slow, 1.0), count_paused(slow, 1.0)) == (18 + 19, 19)
