# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from valve_twin.io.errors import BagError
from valve_twin.io.instruments.derived import difference, one_side, resampled, with_derived
from valve_twin.io.instruments.table import Column, Recording


def recording(*columns):
    made = tuple(
        Column(name, "bar", np.asarray(t, dtype=float), np.asarray(v, dtype=float))
        for name, t, v in columns
    )
    return Recording(Path("a.csv"), made, "measured", measured=True)


def values(found, name):
    return next(c for c in found.columns if c.name == name).values


def test_a_difference_is_taken_at_the_times_of_the_first():
    found = recording(("p a", [0, 1, 2], [5, 6, 7]), ("p - b", [0, 2], [1, 3]))
    made = with_derived(found, [difference("p a", "p - b"), "p a + p - b", "p a"])
    assert [c.name for c in made.columns] == ["p a", "p - b", "p a - p - b", "p a + p - b"]
    np.testing.assert_allclose(values(made, "p a - p - b"), [4, 4, 4])
    np.testing.assert_allclose(values(made, "p a + p - b"), [6, 8, 10])


def test_both_sides_of_a_bipolar_command_make_it_again():
    command = np.array([0.0, 3.0, -2.0, np.nan])
    sides = [one_side("u (V)"), one_side("u (V)", falling=True)]
    made = with_derived(recording(("u (V)", range(4), command)), sides)
    up, down = (values(made, name) for name in sides)
    assert min(np.nanmin(up), np.nanmin(down)) == 0.0
    np.testing.assert_array_equal(up - down, command)


def test_a_channel_of_exactly_that_name_comes_first_and_nothing_is_guessed():
    found = recording(("a", [0, 1], [1, 2]), ("b", [0, 1], [1, 1]), ("a - b", [0, 1], [9, 9]))
    assert with_derived(found, ["a - b", "a - c", "max(c, 0)"]) == found


def test_a_dense_channel_is_averaged_without_delay_and_a_sparse_one_interpolated():
    t = np.arange(0.0, 10.0, 0.001)
    noisy = 2.0 * t + np.random.default_rng(1).normal(0.0, 0.5, len(t))
    slow = np.arange(0.0, 10.5, 0.5)
    made = resampled(recording(("dense", t, noisy), ("slow", slow, slow**2)), 0.1)
    dense = made.columns[0]
    np.testing.assert_allclose(np.diff(dense.seconds), 0.1)
    inner = slice(1, 99)  # the first and last are averages over half a step
    error = dense.values[inner] - 2.0 * dense.seconds[inner]
    assert abs(error.mean()) < 4 * 0.5 / np.sqrt(len(t))
    assert error.std() == pytest.approx(0.05, rel=0.35)  # of 100 samples each
    expected = np.interp(made.columns[1].seconds, slow, slow**2)
    np.testing.assert_allclose(made.columns[1].values, expected)


def test_a_switched_channel_is_held_and_a_pause_stays_empty():
    t = np.concatenate((np.arange(0.0, 5.0, 0.01), np.arange(8.0, 12.0, 0.01)))
    switched = np.where(t < 2.504, 0.0, 10.0)
    made = resampled(recording(("u", t, switched), ("y", t, np.sin(t))), 0.05)
    command, answer = made.columns
    known = command.values[np.isfinite(command.values)]
    assert set(known) == {0.0, 10.0}
    pause = (answer.seconds > 5.03) & (answer.seconds < 7.97)
    assert np.isnan(answer.values[pause]).all()
    assert np.isnan(command.values[pause]).all()
    assert np.isfinite(answer.values[~pause]).mean() > 0.99


def test_a_step_longer_than_the_file_is_refused():
    with pytest.raises(BagError, match=r"a\.csv: resample_s 20 gives 1 rows"):
        resampled(recording(("a", [0, 1], [1, 2])), 20.0)


def test_a_value_that_is_stored_when_it_changes_stays_in_a_silence_that_ends_where_it_began():
    rng = np.random.default_rng(4)
    steps = rng.choice([0.5, 1.0, 3.0, 8.0, 30.0], 200)
    steps[[0, 100]] = 0.0, 80.0
    t, pause = np.cumsum(steps), np.cumsum(steps)
    pause[100:] += 3600.0  # longer than any silence
    near = np.round(np.cumsum(rng.choice([-0.3, 0.3], 200)), 1)
    near[100] = near[99] + 0.3
    far = np.where(np.arange(200) < 100, near, near + 9.0)  # something was missed
    even = np.arange(200.0) + np.where(np.arange(200) < 100, 0.0, 80.0)  # a pause of a logger
    jitter = np.cumsum(rng.uniform(0.7, 1.3, 200)) + np.where(np.arange(200) < 100, 0.0, 80.0)
    for seconds, read, kept in (
        (t, near, True), (t, far, False), (pause, near, False), (even, near, False),
        (jitter, near, False),
    ):  # fmt: skip
        made = resampled(recording(("y", seconds, read)), 1.0)
        grid = made.columns[0].seconds
        silent = np.isfinite(values(made, "y")[(grid > seconds[99]) & (grid < seconds[100])])
        assert len(silent) > 70
        assert silent.all() if kept else not silent.any()
