# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.changepoint import best_lines
from valve_twin.core.aging.joining import join

X = np.arange(120.0)


def pieces_of(y):
    return best_lines(X, y, least=8, most=12, max_candidates=500)


def joined(y):
    return join(X, y, pieces_of(y))


def teeth(height, period=22.0):
    turn = X / period + 0.4
    return height * (turn - np.floor(turn) - 0.5)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_bend_is_one_segment_and_not_several_lines(sign, scatter):
    bent = 1.0 + sign * 0.2 * np.expm1(4.0 * X / 120.0) / np.expm1(4.0)
    y = bent + 0.003 * scatter(1, 120)
    assert len(pieces_of(y)) > 2
    found = joined(y)
    assert found.kept == 0
    assert not found.wave.any()


def test_teeth_on_a_line_are_one_segment_and_a_wave(scatter):
    y = 1.0 - 0.001 * X + teeth(0.011) + 0.001 * scatter(2, 120)
    assert len(pieces_of(y)) > 3
    found = joined(y)
    assert found.kept == 0
    assert found.period == pytest.approx(22.0, rel=0.1)
    assert np.std(found.wave - teeth(0.011)) < 0.002


def test_steps_larger_than_a_wave_may_be_stay_changes(scatter):
    y = 1.0 - 0.05 * np.floor(X / 40.0) + 0.004 * scatter(3, 120)
    found = joined(y)
    assert found.kept == len(pieces_of(y)) - 1 == 3
    assert not found.wave.any()


def test_one_step_stays_a_change(scatter):
    for seed in range(20):
        y = 1.0 - 0.05 * (X >= 60) + 0.01 * scatter(seed, 120)
        assert joined(y).kept == 2


def test_pieces_before_a_step_stay_where_a_bend_follows(scatter):
    late = np.maximum(X - 50.0, 0.0) / 70.0
    y = 1.0 - 0.1 * (X >= 50) - 0.2 * late**3 + 0.003 * scatter(4, 120)
    bounds = pieces_of(y)
    found = joined(y)
    assert len(bounds) > 3
    assert bounds[found.kept] == 50


def test_one_piece_is_left_alone(scatter):
    found = join(X, scatter(5, 120), np.array([0, 120]))
    assert found.kept == 1
    assert np.isnan(found.period)
