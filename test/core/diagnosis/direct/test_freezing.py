# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A sensor that leaves out values is found from its counts alone, from the first cycle on."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.direct.freezing import freezing


def test_a_sensor_that_freezes_from_the_first_cycle_on_is_told():
    rng = np.random.default_rng(1)
    missed = rng.binomial(100, 0.03, 30).astype(float)
    found = freezing(np.arange(1, 31), missed, np.full(30, 100.0))
    assert [(f.fault, f.part, f.onset <= 2, f.end) for f in found] == [
        ("sensor_freeze", "sensor", True, -1)
    ]
    assert found[0].severity == pytest.approx(0.03, abs=0.01)  # 3000 draws: three deviations


def test_one_value_in_eight_cycles_is_chance():
    missed = np.zeros(40)
    missed[[5, 14, 30]] = 1.0
    assert freezing(np.arange(1, 41), missed, np.full(40, 100.0)) == []


def test_it_is_over_when_enough_values_came_and_begins_anew():
    missed = np.zeros(60)
    missed[10:14] = missed[40:44] = 5.0
    first, second = freezing(np.arange(1, 61), missed, np.full(60, 100.0))
    assert (first.onset, first.end, second.onset) == (11, 19, 41)


def test_few_values_do_not_say_that_it_is_over():
    missed = np.zeros(40)
    missed[10:14] = 1.0
    due = np.where(np.arange(40) < 14, 20.0, 1.0)  # one in 20: 26 more values say nothing
    assert freezing(np.arange(1, 41), missed, due)[0].end == -1


def test_unknown_counts_say_nothing():
    unknown = np.full(30, np.nan)
    assert freezing(np.arange(1, 31), unknown, unknown) == []
