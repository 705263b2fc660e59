# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The prediction loop, with a run that rises by the input before: all is counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.kit.prediction import predictor, state_size

NAN = float("nan")
ON, NEW, GAP, BAD = Restart.GO_ON, Restart.NEW_CYCLE, Restart.GAP, Restart.BAD
STARTING, VALID, UNUSABLE = Validity.STARTING, Validity.VALID, Validity.BAD_INPUT


@njit
def advance(m, seen, followed, free, memory, inputs, n, bad):
    before = memory[0]
    if not bad:
        memory[0] = inputs[n, 0]
    if seen == 0.0:
        return Validity.STARTING
    followed[0] += before
    free[0] += before
    return Validity.VALID


@njit
def follow(m, followed, memory, x, inputs, n, code):
    followed[0] = x
    return code


@njit
def shown(m, value):
    return m[0] * value


def run(restart, measured, *, cuts=(), at_once=False):
    """Predict with the input 1, 2, 3, ... in blocks; return prediction, free run and codes."""
    n = len(restart)
    predict = predictor(advance, follow, run=1, shown=shown, at_once=at_once)
    state, inputs = np.zeros(state_size(1, 1)), np.arange(1.0, n + 1)[:, None]
    predicted, simulated, codes = np.empty(n), np.empty(n), np.empty(n, dtype=np.uint8)
    marks, measured = np.array(restart, dtype=np.uint8), np.array(measured, dtype=float)
    for first, last in zip((0, *cuts), (*cuts, n), strict=True):
        part = slice(first, last)
        predict(
            state,
            np.array([10.0]),
            measured[part],
            inputs[part],
            marks[part],
            predicted[part],
            simulated[part],
            codes[part],
        )
    return predicted.tolist(), simulated.tolist(), codes.tolist()


def same(found, expected):
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])
    assert found[2] == [int(code) for code in expected[2]]


def test_a_new_cycle_rejoins_the_free_run_and_a_gap_begins_both_anew():
    found = run([GAP, ON, ON, NEW, ON, GAP, ON], [0.0] * 7)
    predicted = [NAN, 10.0, 20.0, 30.0, 40.0, NAN, 60.0]
    simulated = [NAN, 10.0, 30.0, 0.0, 40.0, NAN, 60.0]
    same(found, (predicted, simulated, [STARTING, *[VALID] * 4, STARTING, VALID]))


def test_a_bad_sample_is_predicted_from_the_one_before_and_corrects_nothing():
    found = run([GAP, ON, BAD, ON], [0.0, 0.0, 99.0, 0.0])
    same(
        found,
        ([NAN, 10.0, 20.0, 40.0], [NAN, 10.0, 30.0, 50.0], [STARTING, VALID, UNUSABLE, VALID]),
    )


def test_a_record_begins_with_its_first_usable_sample():
    found = run([BAD, BAD, ON, ON], [99.0, 99.0, 0.0, 0.0])
    codes = [UNUSABLE, UNUSABLE, STARTING, VALID]
    same(found, ([NAN, NAN, NAN, 30.0], [NAN, NAN, NAN, 30.0], codes))


def test_a_free_run_may_begin_with_the_first_measured_output():
    found = run([GAP, ON, GAP, ON], [5.0, 0.0, 6.0, 0.0], at_once=True)
    assert found[1] == [50.0, 60.0, 60.0, 90.0]


@pytest.mark.parametrize("cut", range(1, 7))
def test_blocks_of_any_length_give_the_same(cut):
    restart, measured = [GAP, ON, BAD, NEW, ON, BAD, ON], [0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 13.0]
    same(run(restart, measured, cuts=(cut,)), run(restart, measured))
