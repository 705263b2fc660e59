# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Return-point memory, wiping-out, rate independence and loop areas of the play hysteresis."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.physics import hysteresis

REACH, SHARE = 0.01, 0.4
INPUTS = st.lists(st.floats(-0.06, 0.06), min_size=1, max_size=30)


def follow(inputs, memory):
    """Outputs (N,) of a path whose points are its turning points."""
    out = []
    before = inputs[0]
    for u in inputs:
        out.append(hysteresis.output(u, u - before, memory, REACH, SHARE)[0])
        hysteresis.remember(u, memory, REACH)
        before = u
    return np.array(out)


@given(INPUTS, st.floats(-0.06, 0.06), st.floats(-0.06, 0.06))
def test_minor_loop_closes_exactly(history, a, b):
    memory = np.zeros(hysteresis.PLAYS)
    follow([*history, a, b], memory)
    kept = memory.copy()
    middle = 0.5 * (a + b)
    follow([middle, b], memory)
    np.testing.assert_allclose(memory, kept, atol=1e-15)


@given(INPUTS, INPUTS)
def test_a_large_excursion_wipes_out_what_was_before(one, other):
    ends = []
    for history in (one, other):
        memory = np.zeros(hysteresis.PLAYS)
        follow([*history, 0.2, -0.2, 0.01], memory)
        ends.append(memory.copy())
    np.testing.assert_array_equal(ends[0], ends[1])


@given(INPUTS, st.integers(1, 20))
def test_depends_on_the_path_and_not_on_its_pace(path, between):
    fine = np.concatenate(
        [np.linspace(a, b, between, endpoint=False) for a, b in pairwise(path)] + [path[-1:]]
    )
    ends = []
    for points in (path, fine):
        memory = np.zeros(hysteresis.PLAYS)
        follow(list(points), memory)
        ends.append(memory)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-15)


def test_loop_grows_with_its_amplitude_and_has_the_stated_width():
    areas = []
    for amplitude in (0.015, 0.03, 0.06):
        wave = amplitude * np.sin(np.linspace(0.0, 4.0 * np.pi, 8001))
        out = follow(list(wave), np.zeros(hysteresis.PLAYS))[4000:]
        areas.append(abs(np.trapezoid(out, wave[4000:])))
    assert areas[0] < areas[1] < areas[2]
    width = SHARE * hysteresis.mean_reach(REACH)
    up = follow([-0.06, 0.06, -0.06, 0.0], np.zeros(hysteresis.PLAYS))[-1]
    down = follow([0.06, -0.06, 0.06, 0.0], np.zeros(hysteresis.PLAYS))[-1]
    assert 0.5 * abs(down - up) == pytest.approx(width, rel=1e-12)


def test_slope_at_an_edge_depends_on_the_way():
    memory = np.zeros(hysteresis.PLAYS)
    hysteresis.remember(0.05, memory, REACH)
    on = hysteresis.output(0.05, 1.0, memory, REACH, SHARE)[1]
    back = hysteresis.output(0.05, -1.0, memory, REACH, SHARE)[1]
    assert on == pytest.approx(1.0)
    assert back == pytest.approx(1.0 - SHARE)
