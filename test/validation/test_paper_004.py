# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Paper 004: what can be recomputed agrees, what cannot says why."""

from __future__ import annotations

import pytest

from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.validation import Verdict
from valve_twin.validation.paper_004 import track_sine


@pytest.fixture(scope="module")
def checks(recomputed):
    return {c.quantity: c for c in recomputed("004")}


def test_nothing_that_can_be_recomputed_fails(checks):
    assert [c.quantity for c in checks.values() if c.verdict is Verdict.FAIL] == []
    assert sum(c.verdict is Verdict.PASS for c in checks.values()) == 12


def test_what_cannot_be_reproduced_says_why(checks):
    missing = [c for c in checks.values() if c.verdict is Verdict.CANNOT]
    assert len(missing) == 15
    assert all(c.note for c in missing)


def test_the_printed_transfer_function_has_its_pole_outside(checks):
    assert checks["largest pole of G(z) [1]"].obtained == pytest.approx(1.02059, abs=1e-4)


@pytest.mark.parametrize(("frequency", "degrees"), [(0.5, 3.0), (1.0, 5.0), (3.0, 9.0)])
def test_sines_of_half_a_millimetre_are_followed(frequency, degrees):
    error, phase, gain = track_sine(StepperServoPlant(), frequency, 0.5)
    assert 0.0 < phase < degrees
    assert gain == pytest.approx(1.0, abs=0.02)
    assert error < 0.1


def test_a_larger_sine_at_3_hz_meets_the_limit_of_the_drive():
    _, phase, gain = track_sine(StepperServoPlant(), 3.0, 0.8)
    assert gain == pytest.approx(0.80, abs=0.05)
    assert phase > 20.0
