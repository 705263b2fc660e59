# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Figures of step responses whose rise, overshoot and settling are known in closed form."""

import math

import numpy as np
import pytest

from valve_twin.core.types import FloatArray
from valve_twin.core.valves.double_solenoid.step_response import BAND, BANDS, judge_step

PERIOD_S = 1e-5
TIME_S: FloatArray = PERIOD_S * np.arange(8001, dtype=np.float64)
LAG_S = 2e-3


def lag(end: float = 1.0) -> FloatArray:
    """Return the step response of a first-order lag that ends off its setpoint."""
    found: FloatArray = end * (1.0 - np.exp(-TIME_S / LAG_S))
    return found


def test_a_lag_rises_and_settles_as_its_time_constant_says():
    found = judge_step(TIME_S, lag())
    assert found.rise_s == pytest.approx(LAG_S * math.log(9.0), abs=2 * PERIOD_S)
    assert found.settling_s == pytest.approx(-LAG_S * math.log(BAND), abs=2 * PERIOD_S)
    assert found.graded_s == pytest.approx(-LAG_S * np.mean(np.log(BANDS)), abs=2 * PERIOD_S)
    assert found.overshoot == 0.0


def test_what_goes_beyond_is_told_over_the_step():
    damped: FloatArray = 1.0 - np.exp(-TIME_S / LAG_S) * np.cos(TIME_S / LAG_S)
    assert judge_step(TIME_S, damped).overshoot == pytest.approx(
        np.exp(-0.75 * np.pi) * np.sqrt(0.5), abs=1e-3
    )


def test_an_end_just_beyond_the_narrowest_band_costs_that_band_alone():
    followed = TIME_S[-1]
    within, beyond = (judge_step(TIME_S, lag(end)).graded_s for end in (0.9901, 0.9899))
    assert within < beyond < within + followed / len(BANDS)
    wider = [b for b in BANDS if b > 0.0101]
    others = sum(-LAG_S * math.log((b - 0.0101) / 0.9899) for b in wider)
    assert beyond == pytest.approx((followed + others) / len(BANDS), abs=2 * PERIOD_S)


def test_what_never_settles_is_infinite_and_counts_as_long_as_it_was_followed():
    found = judge_step(TIME_S, np.zeros_like(TIME_S))
    assert math.isnan(found.rise_s)
    assert math.isinf(found.settling_s)
    assert found.graded_s == pytest.approx(TIME_S[-1])
