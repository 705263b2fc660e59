# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The law of one sample is the free run of the prediction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from test.core.valves import blocks
from valve_twin.core.valves.hybrid_actuator.law import LAW
from valve_twin.core.valves.hybrid_actuator.model import HybridActuatorModel
from valve_twin.core.valves.hybrid_actuator.parameters import HybridActuatorOptions

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PERIOD_S = 2e-4
VALUES = {"spring_rate": 18500.0, "damping": 3.4, "magnet_force": 126.0}


def voltages_and_currents(count: int = 500) -> FloatArray:
    """Return the signals (N, 4) [1] of an opening with its bounces, and of a closing."""
    made = np.zeros((count, 4))
    made[40:70, 3] = -0.2 * np.hanning(30)  # releases the closed seat
    made[60:110, 2] = 0.5 * np.hanning(50)  # catches at the open one
    made[280:310, 2] = -0.2 * np.hanning(30)
    made[300:350, 3] = 0.5 * np.hanning(50)
    return made


def free_run(
    values: dict[str, float], inputs: FloatArray, model: HybridActuatorModel
) -> FloatArray:
    """Return the free run of the prediction [1] from the closed seat."""
    return blocks.free_run(model, values, PERIOD_S, inputs)


@pytest.mark.parametrize(
    "options",
    [
        HybridActuatorOptions(),
        HybridActuatorOptions(kernel="linear", gas_force=5.0, coulomb_friction=1.0),
        HybridActuatorOptions(kernel="saturating_fit", mass=0.14),
    ],
    ids=lambda options: options.kernel,
)
def test_the_law_is_the_free_run_of_the_prediction(options):
    model, inputs = HybridActuatorModel(options=options), voltages_and_currents()
    assert model.law_lag(VALUES, 7, PERIOD_S) == 0
    taken = {**model.law_values(VALUES, PERIOD_S), **VALUES}
    p = np.array([taken[q.name] for q in LAW.parameters])
    x, found = np.zeros(LAW.states), np.zeros(len(inputs))
    assert LAW.rest is not None
    LAW.rest(x, inputs[0], p)
    for n in range(1, len(inputs)):
        LAW.step(x, inputs[n], p, PERIOD_S)
        found[n] = x[0]
    wanted = free_run(VALUES, inputs, model)
    assert (wanted[1], wanted[1:].max(), wanted[-1]) == (0.0, 1.0, 0.0)
    np.testing.assert_array_equal(found[1:], wanted[1:])


def test_a_data_sheet_that_cannot_be_is_refused():
    options = HybridActuatorOptions(kernel="saturating_fit", residual_gap=1e-5)
    with pytest.raises(ValueError, match="pole at c2"):
        HybridActuatorModel(options=options).law_values(VALUES, PERIOD_S)
