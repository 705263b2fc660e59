# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.valves.press_cartridge.orifice import LINEAR_PRESSURE, root_slope, signed_root

pressures = st.floats(-3e7, 3e7)


@given(pressures)
def test_flow_is_odd_in_the_pressure_drop(drop):
    assert signed_root(-drop) == -signed_root(drop)


@given(st.floats(LINEAR_PRESSURE * 1.001, 3e7))
def test_flow_is_the_square_root_above_the_linear_part(drop):
    assert signed_root(drop) == pytest.approx(math.sqrt(drop), rel=1e-15)


@given(pressures.filter(lambda p: abs(abs(p) - LINEAR_PRESSURE) > 10.0))
def test_slope_is_the_derivative_of_the_flow(drop):
    width = 1.0
    difference = (signed_root(drop + width) - signed_root(drop - width)) / (2 * width)
    assert root_slope(drop) == pytest.approx(difference, rel=1e-6)


def test_flow_is_continuous_where_the_linear_part_ends():
    below, above = LINEAR_PRESSURE * (1 - 1e-12), LINEAR_PRESSURE * (1 + 1e-12)
    assert signed_root(above) == pytest.approx(signed_root(below), rel=1e-11)
