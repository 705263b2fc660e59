# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults as changes of a motion."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.faults import (
    FAULTS,
    FIRST_SIZES,
    LARGEST,
    Sensed,
    source,
)
from valve_twin.core.diagnosis.table import BY_NAME

UNCHANGED = sorted(set(FAULTS))


@pytest.fixture
def sensed(motion):
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(motion))
    return lambda: Sensed(motion, noise, 0.05, source(5, 2))


@pytest.mark.parametrize("name", UNCHANGED)
def test_a_fault_of_no_size_changes_nothing(name, sensed, motion):
    found = FAULTS[name](sensed(), 0.0)
    assert found == pytest.approx(motion + sensed().noise, abs=1e-12)


@pytest.mark.parametrize("name", UNCHANGED)
def test_a_fault_has_a_name_a_first_size_and_the_same_numbers_again(name, sensed):
    assert name in BY_NAME
    size = 20.0 * FIRST_SIZES[name]
    assert size <= LARGEST.get(name, np.inf) or name == "command_loss"
    size = min(size, LARGEST.get(name, np.inf))
    first, again = FAULTS[name](sensed(), size), FAULTS[name](sensed(), size)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, sensed().motion + sensed().noise)


def test_lost_motion_leaves_half_its_width_on_either_side(sensed, motion):
    out = FAULTS["lost_motion"](sensed(), 0.02) - sensed().noise
    assert np.abs(out - motion).max() == pytest.approx(0.01, rel=1e-6)


def test_every_move_is_lost_where_all_commands_are(sensed, motion):
    out = FAULTS["command_loss"](sensed(), 1.0) - sensed().noise
    assert np.ptp(out) < 0.02 * np.ptp(motion)


def test_an_end_stop_stops(sensed, motion):
    out = FAULTS["end_stop_upper"](sensed(), 0.1) - sensed().noise
    assert out.max() == pytest.approx(motion.max() - 0.1)
    out = FAULTS["end_stop_lower"](sensed(), 0.1) - sensed().noise
    assert out.min() == pytest.approx(motion.min() + 0.1)
