# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The regression is that of paper 002, at any lag, over measured rows only."""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle, steady_gains
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.valves.press_cartridge.estimation.regression import (
    design,
    gram,
    mean_square_error,
    usable_rows,
)
from valve_twin.core.valves.press_cartridge.estimators import TERM_SETS

PERIOD_S = 0.03


def masks_of(frames):
    return find_masks(frames, PERIOD_S, push=(1.0, -1.0))


@pytest.fixture
def moving(make_frames):
    rng = np.random.default_rng(1)
    return make_frames(0.5 + 0.1 * rng.random(60), rng.random(60), rng.random(60))


@pytest.mark.parametrize("lag", [0, 1, 2, 4])
def test_rows_are_those_of_the_paper(moving, lag):
    u, y = design(moving, np.array([10]), lag)
    x = moving.position
    vi, vo = moving.inputs[10 - lag]
    dx = x[9] - x[8]
    expected = [dx, vi, vo, vi**2, vo**2, vi * vo, vi * dx, vo * dx]
    assert u[0] == pytest.approx(expected, rel=1e-15)
    assert y[0] == pytest.approx(x[10] - 2 * x[9] + x[8], rel=1e-15)


@pytest.mark.parametrize("lag", [0, 2, 4])
def test_the_compiled_normal_equations_are_those_of_the_rows(moving, lag):
    rows = usable_rows(moving, masks_of(moving), lag)
    u, y = design(moving, rows, lag)
    g = gram(moving, rows, lag)
    assert g.matrix == pytest.approx(u.T @ u, rel=1e-12)
    assert g.vector == pytest.approx(u.T @ y, rel=1e-12, abs=1e-14)
    assert g.power == pytest.approx(y @ y, rel=1e-12)
    assert g.rows == len(rows) == 60 - max(2, lag)


def test_a_part_of_the_normal_equations_has_the_terms_by_their_paper_number(moving):
    rows = usable_rows(moving, masks_of(moving), 2)
    part = gram(moving, rows, 2).part(TERM_SETS["4"])
    u = design(moving, rows, 2)[0][:, [0, 1, 2, 4]]
    assert part.matrix == pytest.approx(u.T @ u, rel=1e-12)


def test_the_mean_square_error_is_that_of_the_rows(moving):
    rows = usable_rows(moving, masks_of(moving), 2)
    theta = np.random.default_rng(2).normal(size=8)
    u, y = design(moving, rows, 2)
    expected = np.mean((y - u @ theta) ** 2)
    assert mean_square_error(moving, rows, 2, theta) == pytest.approx(expected, rel=1e-12)
    assert np.isnan(mean_square_error(moving, rows[:0], 2, theta))


@pytest.mark.parametrize(("lag", "lost"), [(1, [20, 21]), (2, [20, 21]), (4, [20, 21, 22, 23])])
def test_no_row_spans_a_gap(moving, lag, lost):
    later = moving.stamp_ns + np.where(np.arange(60) >= 20, 90_000_000, 0)
    frames = replace(moving, stamp_ns=later)
    rows = usable_rows(frames, masks_of(frames), lag)
    assert sorted(set(range(max(2, lag), 60)) - set(rows)) == lost


@pytest.mark.parametrize(("lag", "lost"), [(0, 3), (2, 3), (4, 5)])
def test_a_sample_that_is_not_finite_costs_the_rows_that_use_it(moving, lag, lost):
    position = moving.position.copy()
    position[20] = np.nan
    frames = replace(moving, position=position)
    rows = usable_rows(frames, masks_of(frames), lag)
    assert len(rows) == 60 - max(2, lag) - lost
    assert np.isfinite(design(frames, rows, lag)[1]).all()


def test_repeats_of_a_slow_sensor_are_kept_only_on_demand():
    frames = generate_cycle(Truth(), np.random.default_rng(3)).frames
    frames = replace(frames, position=frames.position[np.arange(len(frames)) // 3 * 3])
    masks = masks_of(frames)
    assert len(usable_rows(frames, masks, 2)) == 0
    assert len(usable_rows(frames, masks, 2, keep_stale=True)) > 0.9 * len(frames)


def test_a_freeze_is_never_kept():
    frames = generate_cycle(Truth(), np.random.default_rng(3)).frames
    position = frames.position.copy()
    position[300:360] = position[299]
    frames = replace(frames, position=position)
    rows = usable_rows(frames, masks_of(frames), 2, keep_stale=True)
    assert not set(range(300, 362)) & set(rows)


def test_common_rows_are_usable_at_every_lag(moving):
    later = moving.stamp_ns + np.where(np.arange(60) >= 20, 90_000_000, 0)
    frames = replace(moving, stamp_ns=later)
    masks = masks_of(frames)
    common = set(usable_rows(frames, masks, 4))
    for lag in range(5):
        assert common <= set(usable_rows(frames, masks, lag))


def test_an_offset_of_the_position_changes_nothing():
    frames = generate_cycle(Truth(), np.random.default_rng(4)).frames
    masks = masks_of(frames)
    rows = usable_rows(frames, masks, 2)
    plain = gram(frames, rows, 2)
    moved = gram(replace(frames, position=frames.position + 0.125), rows, 2)
    assert moved.matrix == pytest.approx(plain.matrix, rel=1e-9, abs=1e-12)
    assert moved.vector == pytest.approx(plain.vector, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_hardly_any_samples_give_hardly_any_rows(make_frames, count):
    frames = make_frames(np.zeros(count))
    assert len(usable_rows(frames, masks_of(frames), 2)) == max(count - 2, 0)


def test_gains_of_the_published_estimate():
    # paper 002, Table 1, third column; K_in = 0.0101/0.99
    theta = np.array([-0.99, 0.0101, -0.0561, 0.0, 0.0278, 0.0, 0.0, 0.0])
    k_in, k_out = steady_gains(theta, 0.2, 0.3)
    assert k_in == pytest.approx(0.0102, abs=5e-5)
    assert k_out == pytest.approx((0.0561 - 0.0278 * 0.3) / 0.99)


def test_gains_use_all_eight_terms_and_need_a_speed_term():
    theta = np.array([-0.8, 0.02, -0.05, -0.01, 0.03, 0.0, 0.1, 0.2])
    k_in, k_out = steady_gains(theta, 0.5, 0.4)
    assert k_in == pytest.approx((0.02 - 0.005) / (0.8 - 0.05))
    assert k_out == pytest.approx((0.05 - 0.012) / (0.8 - 0.08))
    assert np.isnan(steady_gains(np.zeros(8), 0.5, 0.4)).all()
