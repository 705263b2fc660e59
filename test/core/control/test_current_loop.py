# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bridge: 16 patterns, 9 mean voltages, one inversion a sample."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.control.current_loop import (
    PATTERNS,
    SUB_STEPS,
    CurrentGains,
    integrate_error,
    level_at,
    mean_voltage,
    pattern,
    positive_steps,
)


def levels(start, positive):
    return [level_at(start, positive, k) for k in range(SUB_STEPS)]


@pytest.mark.parametrize("start", [-1.0, 1.0])
@pytest.mark.parametrize("positive", range(SUB_STEPS + 1))
def test_a_sample_inverts_once_at_most_and_has_its_mean(start, positive):
    signs = levels(start, positive)
    assert sum(a != b for a, b in pairwise(signs)) <= 1
    assert sum(s > 0.0 for s in signs) == positive
    assert mean_voltage(positive, 24.0) == pytest.approx(24.0 * sum(signs) / SUB_STEPS)


@pytest.mark.parametrize("start", [-1.0, 1.0])
@pytest.mark.parametrize("positive", range(1, SUB_STEPS))
def test_the_bridge_goes_on_from_its_level(start, positive):
    assert levels(start, positive)[0] == start


def test_sixteen_patterns_have_nine_means_in_steps_of_a_quarter():
    means = set()
    for index in range(PATTERNS):
        start, before = pattern(index)
        means.add(start * (2.0 * before - SUB_STEPS) / SUB_STEPS)
    assert sorted(means) == [-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0]


@given(st.floats(-40.0, 40.0))
def test_the_nearest_mean_is_taken(voltage):
    given_ = mean_voltage(positive_steps(voltage, 24.0), 24.0)
    assert abs(given_ - min(max(voltage, -24.0), 24.0)) <= 3.0 + 1e-9


def test_the_integral_part_stands_while_the_voltage_is_limited():
    g = CurrentGains(20.0, 2.0, 24.0, 2.6)
    assert integrate_error(g, 2.0, 0.0, 1.0, 40.0) == 1.0
    assert integrate_error(g, 1.0, 0.9, 1.0, 5.0) == pytest.approx(1.2)
