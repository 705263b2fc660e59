# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The largest jump that a valve made before a cycle, and no later one."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.jumps import jumps_made


def test_a_jump_counts_from_three_cycles_behind_it_on_and_for_the_window():
    along = np.zeros((40, 2))
    along[10:, 0] = -4.0
    made = jumps_made(along, 12)
    assert np.all(made[:11] == 0.0)
    assert made[13:25, 0] == pytest.approx(4.0)  # mean of cycles 10-12 less that of 7-9
    assert made[27:] == pytest.approx(0.0)
    assert np.all(made[:, 1] == 0.0)


def test_what_a_cycle_shows_itself_is_no_jump_made_before():
    along = np.random.default_rng(1).standard_normal((30, 3))
    later = along.copy()
    later[20:] += 50.0
    assert jumps_made(later, 40)[:21] == pytest.approx(jumps_made(along, 40)[:21])


@pytest.mark.parametrize("cycles", [0, 6, 7])
def test_few_cycles_have_made_no_jump_or_one(cycles):
    made = jumps_made(np.arange(cycles)[:, None] ** 2.0, 40)
    assert made.shape == (cycles, 1)
    assert made.sum() == (0.0 if cycles < 7 else pytest.approx(15.0))


@pytest.mark.parametrize("window", [1, 2, 7, 40])
def test_the_largest_is_that_of_the_newest_jumps(window):
    along = np.random.default_rng(window).standard_normal((90, 2))
    made, each = jumps_made(along, window), jumps_made(along, 1)
    for row in range(90):
        assert np.array_equal(made[row], each[max(row - window + 1, 0) : row + 1].max(axis=0))


def test_what_came_before_the_window_changes_no_bit():
    """Else what a record says would depend on how many of its cycles are looked at at a time."""
    along = 1e3 * np.random.default_rng(3).standard_normal((200, 4))
    since = 100 - 6 - 40
    assert np.array_equal(jumps_made(along, 40)[100:], jumps_made(along[since:], 40)[46:])
