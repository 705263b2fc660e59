# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What no sound valve shows is told from the first cycles on, and ends when it is gone."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.direct.bounds import beyond


def test_what_is_there_from_the_first_cycle_on_is_told():
    (found,) = beyond(np.arange(1, 31), np.full(30, 0.03), "sensor_offset")
    assert (found.fault, found.part, found.onset, found.alarm, found.end) == (
        "sensor_offset",
        "sensor",
        1,
        3,
        -1,
    )
    assert found.severity == pytest.approx(0.03)


def test_it_ends_when_three_cycles_are_without():
    excess = np.zeros(40)
    excess[10:20] = 0.5
    excess[14] = 0.0  # one cycle without is no end
    excess[30:32] = 0.5  # two with it are no beginning
    (found,) = beyond(np.arange(1, 41), excess, "dead_band")
    assert (found.onset, found.end) == (11, 23)
    assert found.rivals == ("command_offset",)


def test_cycles_that_do_not_tell_are_left_out():
    excess = np.array([np.nan, 0.02, np.nan, 0.02, 0.02, np.nan])
    (found,) = beyond(np.arange(1, 7), excess, "sensor_offset")
    assert (found.onset, found.alarm) == (2, 5)
    assert beyond(np.arange(1, 7), np.full(6, np.nan), "sensor_offset") == []
