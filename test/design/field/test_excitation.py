# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The trapezoid of current."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.field.excitation import Trapezoid


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
