# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The experiments of paper 004 notice another valve."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.valves.stepper_servo.plant import StepperServoPlant
from valve_twin.validation.bench_004 import scan, track_square, velocity_sweep

PLANT = StepperServoPlant()


def test_a_scan_reads_backlash_and_dead_band_to_a_step():
    found = scan(replace(PLANT, backlash=0.16e-3, band_lower=0.5e-3, band_upper=1.6e-3))
    assert found.backlash == pytest.approx(0.16, abs=0.011)
    assert found.closed == pytest.approx((0.5, 1.6), abs=0.011)
    assert found.regulated[1] == pytest.approx(0.3, abs=0.021)


def test_the_sweep_ends_at_full_speed_and_turns():
    time_s, spool, speed = velocity_sweep(PLANT)
    half = len(time_s) // 2
    assert speed[half - 1] == pytest.approx(10.0)
    assert speed[-1] == pytest.approx(-10.0)
    assert np.argmax(spool) >= half


def test_steps_that_the_drive_can_follow_end_where_they_should():
    reference, spool = track_square(PLANT, 1.0, (0.5, 1.5))
    late = np.flatnonzero(np.diff(reference))[2:]
    assert spool[late] == pytest.approx(reference[late], abs=0.011)
