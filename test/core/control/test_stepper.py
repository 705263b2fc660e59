# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The stepper valve's controller: published gains, the law of the steps, the dead zone."""

import numpy as np
import pytest

from valve_twin.core.control.stepper import (
    STATE_SIZE,
    StepperConfig,
    step_delay,
    stepper_step,
    ziegler_nichols,
)


def test_the_published_gains_are_a_gain_and_two_times():
    got = ziegler_nichols(0.58, 0.032)  # 004-ZN
    assert got.gain == pytest.approx(0.35, abs=5e-3)
    assert got.integral_time_s == pytest.approx(0.02, abs=5e-3)
    assert got.derivative_time_s == pytest.approx(0.004, abs=1e-12)


@pytest.mark.parametrize(
    ("output", "delay"),
    [(0.0, 15), (0.01, 10), (-0.01, 10), (0.028, 1), (0.03, 1), (-0.03, 1), (0.5, 1), (-0.5, 1)],
)
def test_the_delay_between_steps_is_even_and_never_below_one_sample(output, delay):
    assert step_delay(output) == delay


@pytest.mark.parametrize("output", [0.0, 0.004, 0.012, 0.02, 0.4])
def test_the_speed_is_that_of_one_step_in_a_whole_number_of_samples(output):
    config = StepperConfig(gain=1.0, integral_time=1e6, derivative_time=0.0, dead_zone=0.0)
    state = np.zeros(STATE_SIZE)
    steps = [stepper_step(state, config.settings(), output + 1e-12) for _ in range(3000)]
    places = np.flatnonzero(steps)
    assert set(np.diff(places)) == {step_delay(output)}


def test_an_error_inside_the_dead_zone_makes_no_step():
    config = StepperConfig()
    state = np.zeros(STATE_SIZE)
    edge = config.settings().dead_zone
    assert all(stepper_step(state, config.settings(), 0.999 * edge) == 0 for _ in range(1000))
    assert any(stepper_step(state, config.settings(), -1.001 * edge) == -1 for _ in range(1000))


def test_refuses_a_gain_outside_its_range():
    with pytest.raises(ValueError, match=r"StepperConfig\.gain = -1\.0: must be a number from 0"):
        StepperConfig(gain=-1.0)
