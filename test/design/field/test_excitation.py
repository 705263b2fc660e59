# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The trapezoid of current."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.field.excitation import DENSITY, Trapezoid, check_currents
from valve_twin.design.geometry import DoubleStroke, HybridPole


def test_it_goes_up_down_and_back_with_the_given_slope():
    time_s, currents = Trapezoid().record(2)
    assert time_s[-1] == pytest.approx(29e-3)
    assert len(time_s) == 291
    assert (currents[:, 1] == 1.0).all()
    assert currents[[0, 40, 80, 160, 200, 240, 290], 0] == pytest.approx([1, 2, 2, 0, 0, 1, 1])
    rates = np.abs(np.diff(currents[:, 0]) / np.diff(time_s))
    assert rates.max() == pytest.approx(250.0)


def test_a_swing_beyond_the_bias_is_refused():
    with pytest.raises(ValueError, match="swing = 2: must be at most the bias, 1"):
        Trapezoid(swing=2.0)
    with pytest.raises(ValueError, match=r"slope = -1.0: must be a number from 1e-07 to 10"):
        Trapezoid(slope=-1.0)


def test_more_times_than_can_be_computed_are_refused_at_once():
    with pytest.raises(ValueError, match=r"step = 1e-07: 2.0021e\+08 times over 20.021 s"):
        Trapezoid(step=1e-7, hold=10.0).record(2)


def test_a_current_that_melts_its_coil_is_refused_with_its_range():
    section = DoubleStroke().section()
    most = DENSITY * 0.018 * DoubleStroke().winding().height / 375.0
    check_currents(section, np.array([[most, -most], [0.0, 1.0]]))
    with pytest.raises(ValueError, match=r"current of B = -1000: must be from -428 to 428 \[A\]"):
        check_currents(section, np.array([[0.0, 0.0], [0.0, -1000.0]]))
    check_currents(HybridPole().section(), np.array([1500.0]))  # one turn: an m.m.f.
