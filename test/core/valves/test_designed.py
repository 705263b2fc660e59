# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a designed solenoid gives a valve, and which valve takes one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from test.core.physics.test_coenergy_tables import MAP
from valve_twin.core.valves.designed import Designed, Surroundings, find_designable

SECOND = (0.55e-3, 0.045e-6, 0.43e-3, 0.028e-6)
SLOWER = (0.25e-3, 0.010e-6, 0.75e-3, 0.090e-6)
FOUND = Designed(MAP, 2.0, 0.08, 1e-3, SECOND, SLOWER, Surroundings())


def test_the_largest_current_is_that_of_the_power_or_of_the_map():
    assert FOUND.largest_current == pytest.approx((15.0 / 2.0) ** 0.5)
    assert replace(FOUND, around=Surroundings(power=200.0)).largest_current == 3.0


def test_a_model_that_takes_no_design_says_so():
    assert find_designable().name == find_designable("double_solenoid").name
    with pytest.raises(ValueError, match="model 'first_order' takes no designed solenoid"):
        find_designable("first_order")
