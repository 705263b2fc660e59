# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of one sample is the free run of the prediction, whole samples of the delay apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.valves.press_cartridge.law import LAW
from valve_twin.core.valves.press_cartridge.model import PressCartridgeModel
from valve_twin.core.valves.press_cartridge.parameters import PressCartridgeOptions

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PERIOD_S = 0.03
VALUES = {"pole": 0.35, "K_in": 0.021, "K_in_slope": -0.004, "v_in_mean": 0.6, "K_out": 0.026,
          "K_out_slope": -0.003, "leak": 0.01, "delay": 2.4}  # fmt: skip
OPTIONS = PressCartridgeOptions(v_offset_in=0.05, v_offset_out=0.1, upper_seat=0.95, v_ref=0.4)


def commands(count: int = 400) -> FloatArray:
    """Return v_in and v_out (N, 2) of a press: filling beyond the upper seat, then emptying."""
    made = np.zeros((count, 2))
    made[5:150, 0] = np.random.default_rng(3).uniform(0.2, 0.8, 145)
    made[170:380, 1] = np.random.default_rng(4).uniform(0.15, 0.8, 210)
    return made


def free_run(values: dict[str, float], inputs: FloatArray) -> FloatArray:
    """Return the free run of the prediction [1] from the lower seat."""
    model = PressCartridgeModel(options=OPTIONS)
    return blocks.free_run(model, values, PERIOD_S, inputs)


@pytest.mark.parametrize("delay", [1.0, 2.4, 3.0])
def test_the_law_is_the_free_run_of_the_prediction(delay):
    values, inputs = VALUES | {"delay": delay}, commands()
    model = PressCartridgeModel(options=OPTIONS)
    taken = {**model.law_values(values, PERIOD_S), **values}
    p = np.array([taken[q.name] for q in LAW.parameters])
    lag, x, found = model.law_lag(values, 0, PERIOD_S), np.zeros(LAW.states), np.zeros(len(inputs))
    assert lag == int(delay)
    for n in range(lag, len(inputs)):
        LAW.step(x, inputs[n - lag], p, PERIOD_S)
        found[n] = x[0]
    wanted = free_run(values, inputs)
    assert np.ptp(wanted) == OPTIONS.upper_seat
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_delay_below_a_sample_is_one_sample_of_the_law():
    model = PressCartridgeModel()
    for delay in (0.0, 0.4):
        assert model.law_lag({"delay": delay}, 3, PERIOD_S) == 0
        assert model.law_values({"delay": delay}, PERIOD_S)["delay_part"] == 0.0
    assert model.law_lag({}, 3, PERIOD_S) == 3
