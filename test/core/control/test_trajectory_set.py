# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The candidates and costs of the trajectory set, and the nonlinear PID beside it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.control.nonlinear_pid import PidConfig, pid_output
from valve_twin.core.control.trajectory_set import (
    HORIZON,
    MODEL_STEPS,
    TrajectorySetConfig,
    candidate,
    end_cost,
    error_cost,
)


@given(st.floats(-1.0, 1.0))
def test_candidates_hold_the_last_input_and_both_limits_and_stay_inside(last):
    weights = TrajectorySetConfig().weights()
    inputs = [candidate(weights, k, last) for k in range(7)]
    assert inputs[0] == last
    assert {-1.0, 1.0} <= set(inputs)
    assert all(-1.0 <= u <= 1.0 for u in inputs)


@given(st.floats(-1.0, 1.0), st.integers(2, 10))
def test_sizes_of_change_go_evenly_from_small_to_large(last, sizes):
    weights = TrajectorySetConfig(change=0.5, small=0.004, sizes=sizes).weights()
    inputs = [candidate(weights, k, last) for k in range(2 * sizes + 3)]
    assert inputs[0] == last
    assert inputs[-2:] == [-1.0, 1.0]
    up = [candidate(weights, 2 * k + 1, -1.0) + 1.0 for k in range(sizes)]
    down = [1.0 - candidate(weights, 2 * k + 2, 1.0) for k in range(sizes)]
    wanted = [0.004 * 125.0 ** (k / (sizes - 1)) for k in range(sizes)]
    assert up == pytest.approx(wanted, rel=1e-9)
    assert down == pytest.approx(wanted, rel=1e-9)


def test_the_usual_set_is_that_of_two_sizes():
    weights = TrajectorySetConfig().weights()
    inputs = [candidate(weights, k, 0.1) for k in range(7)]
    assert inputs == pytest.approx([0.1, 0.12, 0.08, 0.3, -0.1, -1.0, 1.0])


def test_a_decision_takes_about_900_model_steps():
    candidates = 2 * TrajectorySetConfig().sizes + 3
    assert candidates * HORIZON * MODEL_STEPS == 896


def test_an_error_beyond_the_target_weighs_more():
    w = TrajectorySetConfig().weights()
    assert error_cost(w, 0.1, -0.02) == pytest.approx(5.0 * error_cost(w, 0.1, 0.02))
    assert end_cost(w, 10.0, 0.0) == pytest.approx((10.0 * 5e-4) ** 2)


def test_a_weight_outside_its_range_is_refused_by_name():
    with pytest.raises(ValueError, match=r"TrajectorySetConfig.overshoot = 0.5: .*from 1 to"):
        TrajectorySetConfig(overshoot=0.5)


@given(st.floats(-2.0, 2.0), st.floats(-50.0, 50.0), st.floats(-1.0, 1.0), st.floats(-1.1, 1.1))
def test_the_pid_stays_inside_its_limits(error, speed, integral, place):
    output, after = pid_output(PidConfig().gains(), error, speed, integral, 1e-4, place)
    assert -1.0 <= output <= 1.0
    assert -1.0 <= after <= 1.0


def test_the_gain_of_the_pid_falls_with_the_error():
    g = PidConfig().gains()
    near, _ = pid_output(g, 1e-4, 0.0, 0.0, 1e-4, 0.0)
    far, _ = pid_output(g, 0.5, 0.0, 0.0, 1e-4, 0.0)
    assert near / 1e-4 > 4.0 * far / 0.5


def test_gain_and_damping_of_the_pid_fall_towards_the_ends():
    g = PidConfig(hold=0.0, integral_near=0.0).gains()
    middle, end = (pid_output(g, 1e-4, 0.0, 0.0, 1e-4, place)[0] for place in (0.0, -1.0))
    assert middle / end == pytest.approx(1.0 + g.gain_fall)
    middle, end = (pid_output(g, 0.0, 1.0, 0.0, 1e-4, place)[0] for place in (0.0, 1.0))
    assert middle / end == pytest.approx(1.0 + g.rate_fall)
