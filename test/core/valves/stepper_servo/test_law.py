# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of one sample is the free run of the prediction, whole samples of the delay apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.valves.stepper_servo.law import LAW
from valve_twin.core.valves.stepper_servo.model import StepperServoModel

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PERIOD_S = 0.01
VALUES = {"backlash": 0.012, "offset": 0.003, "delay": 0.034}


def motor_and_flow(count: int = 600) -> FloatArray:
    """Return counted motor positions that turn round again and again, and a flow (N, 2) [1]."""
    made = np.full((count, 2), 0.3)
    steps = np.random.default_rng(5).choice([-1.0, 1.0], (count - 60) // 20).repeat(20) / 210.0
    made[60:, 0] = np.clip(0.3 + np.cumsum(steps), 0.0, 1.0)
    made[:, 1] = 0.7
    return made


def free_run(values: dict[str, float], inputs: FloatArray, start: float) -> FloatArray:
    """Return the free run of the prediction [1]; NaN as long as its line fills."""
    return blocks.free_run(StepperServoModel(), values, PERIOD_S, inputs, start)


@pytest.mark.parametrize("delay", [0.01, 0.034, 0.05])
def test_the_law_is_the_free_run_of_the_prediction(delay):
    values, inputs, start = VALUES | {"delay": delay}, motor_and_flow(), 0.302
    model = StepperServoModel()
    taken = {**model.law_values(values, PERIOD_S), **values}
    p = np.array([taken[q.name] for q in LAW.parameters])
    lag, x, found = model.law_lag(values, 9, PERIOD_S), np.zeros(LAW.states), [start] * 600
    assert lag == int(delay / PERIOD_S)
    x[0] = start
    assert LAW.rest is not None
    LAW.rest(x, inputs[0], p)
    for n in range(lag, len(inputs)):
        LAW.step(x, inputs[n - lag], p, PERIOD_S)
        found[n] = x[0]
    wanted = free_run(values, inputs, start)
    assert np.ptp(wanted[lag + 1 :]) > 0.2
    np.testing.assert_allclose(found[lag + 1 :], wanted[lag + 1 :], atol=1e-12)


def test_a_delay_below_a_sample_is_one_sample_of_the_law():
    model = StepperServoModel()
    for delay in (0.0, 0.004):
        assert model.law_lag({"delay": delay}, 3, PERIOD_S) == 0
        assert model.law_values({"delay": delay}, PERIOD_S) == {"delay_part": 0.0}
