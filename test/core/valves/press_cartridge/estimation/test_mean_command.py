# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The command at which the inflow gain holds, under offset and noise of the logged command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, EstimateStatus
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options


@pytest.fixture(scope="module")
def frames():
    return to_frames(next(iter(simulate_cycles(MODEL.simulation(), 1, 0))))


def gains(frames, change, estimator):
    """Return (K_in, v_in_mean) with `change` added to the logged inflow command."""
    inputs = frames.inputs.copy()
    inputs[:, 0] += change
    options = complete_options(MODEL, {"lag": 2, "estimators": [estimator]})
    estimates = MODEL.estimate(Cycle(1, 0.03, replace(frames, inputs=inputs)), options)
    (found,) = [e for e in estimates if e.estimator == estimator]
    assert found.status is not EstimateStatus.REFUSED
    return found.value("K_in"), found.value("v_in_mean")


@pytest.mark.parametrize("estimator", ["output_error", "kalman"])
def test_an_offset_or_noise_of_the_command_takes_no_return_stroke_for_inflow(frames, estimator):
    gain, mean = gains(frames, 0.0, estimator)
    noise = 1e-5 * np.random.default_rng(1).standard_normal(len(frames))
    for change in (1e-5, 1e-3, noise):
        other_gain, other_mean = gains(frames, change, estimator)
        # the offset of 1e-3 itself moves the mean by so much, and the gain by 0.2 to 0.8 %
        assert other_mean == pytest.approx(mean, abs=1.5e-3)
        assert other_gain == pytest.approx(gain, rel=0.01)
