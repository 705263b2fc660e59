# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults of a stored history: what beside the features decides whether one is told."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.features import ESTIMATOR, NOISE
from valve_twin.core.diagnosis.history import diagnose
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue


def estimate(cycle, estimator=ESTIMATOR, noise=None, code=""):
    return Estimate(
        model="press_cartridge",
        estimator=estimator,
        cycle=cycle,
        start_ns=cycle * 30 * 10**9,
        end_ns=cycle * 30 * 10**9 + 25 * 10**9,
        parameters=() if noise is None else (ParameterValue(NOISE, noise),),
        status=EstimateStatus.REFUSED if code else EstimateStatus.PARTIAL,
        reason="",
        reason_code=code,
    )


@pytest.mark.parametrize(
    ("apart", "code", "told"),
    [
        (None, "", True),
        (19, RefusalCode.IMPLAUSIBLE, False),  # the noise begins with cycle 20
        (30, RefusalCode.IMPLAUSIBLE, False),
        (10, RefusalCode.IMPLAUSIBLE, True),  # long before
        (19, RefusalCode.NO_MOTION, True),
    ],
)
def test_a_noise_is_not_told_about_cycles_whose_signals_do_not_belong_together(apart, code, told):
    rng = np.random.default_rng(3)
    history = [
        estimate(c, noise=(1e-4 if c < 20 else 4e-4) * float(rng.uniform(0.95, 1.05)))
        for c in range(1, 26)
        if c != apart
    ]
    if apart is not None:
        history.append(estimate(apart, "output_error", code=code.value))
    found = [f.fault for f in diagnose(history, ()).findings]
    assert ("sensor_noise" in found) is told


@pytest.mark.parametrize(
    ("newest", "told"), [(1, ""), (2, "the newest 2 cycles are of no product")]
)
def test_cycles_of_a_new_product_are_compared_with_nothing(newest, told):
    longer = [
        replace(estimate(c, noise=1e-4), end_ns=c * 30 * 10**9 + 28 * 10**9)
        for c in range(31, 31 + newest)
    ]
    doubt = diagnose([*(estimate(c, noise=1e-4) for c in range(1, 31)), *longer], ()).doubt
    assert doubt.startswith(f"no reference yet: {told}") if told else not doubt
