# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What other structures say ends in the limits and in the reason."""

import numpy as np
import pytest

from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.core.valves.positioner.check.doubt import doubted
from valve_twin.core.valves.positioner.check.rivals import Rival, Rivals

NOISE = 1e-3


def rivals(*terms, left=NOISE, moved=0.3):
    best = Rival(np.zeros(12), (3.0, 3.0), 1.0, terms)
    return Rivals(np.array([moved, *np.zeros(6)]), best, left, 0.0)


def estimate(*parameters):
    return Estimate(
        model="positioner",
        estimator="output_error",
        cycle=1,
        start_ns=0,
        end_ns=1,
        parameters=parameters,
        status=EstimateStatus.ACCEPTED,
        reason="accepted",
    )


def test_limits_hold_what_the_structure_may_have_done_and_the_reason_names_it():
    before = estimate(ParameterValue("rate_rising", 4.0))
    (p,) = doubted(before, rivals("velocity_lag"), NOISE).parameters
    assert (p.lower_95, p.value, p.upper_95) == pytest.approx((3.7, 4.0, 4.3))
    assert "second_order" in p.reason


def test_without_a_structure_that_follows_there_is_no_interval():
    lost = rivals("stiction", left=3.0 * NOISE)
    before = estimate(ParameterValue("rate_rising", 4.0))
    (p,) = doubted(before, lost, NOISE).parameters
    assert p.value == 4.0  # it still predicts
    assert np.isinf(p.upper_95)
    assert p.reason.startswith("no interval")


def test_what_rests_on_a_bound_is_left_alone():
    before = estimate(ParameterValue("rate_rising", 4.0, ParameterStatus.AT_BOUND, "bound"))
    assert doubted(before, rivals("stiction"), NOISE) == before
