# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.valves.damadics.diagnosis.isolation import FAULTS
from valve_twin.validation.damadics.indices import (
    UNDEFINED,
    Zone,
    accuracy,
    decision_indices,
    mean_accuracy,
    misisolation,
)


def high(time_s, *spans):
    return sum(((time_s >= a) & (time_s < b)).astype(float) for a, b in spans)


def test_the_abrupt_case_of_the_sheet():
    t, zone = np.arange(1501.0), Zone(300.0, 900.0, 1500.0)
    strength = np.where(t > 900.0, 0.75, 0.0)
    found = decision_indices(t, high(t, (310, 316), (905, 910), (930, 1501)), strength, zone)
    assert (found.time, found.first, found.strength) == (30.0, 5.0, 0.75)
    assert found.false == pytest.approx(0.01)
    assert found.true == pytest.approx(0.95833, abs=1e-5)
    named = decision_indices(t, high(t, (960, 1501)), strength, zone)
    assert (named.time, named.false) == (60.0, 0.0)
    assert named.true == pytest.approx(0.9)
    assert misisolation(t, 2.0 * high(t, (930, 960)), zone) == pytest.approx(0.05)


def test_the_incipient_case_of_the_sheet():
    t = np.arange(2401.0)
    strength = np.clip((t - 900.0) / 900.0, 0.0, 1.0)
    found = decision_indices(t, high(t, (1035, 2401)), strength, Zone(300.0, 900.0, 2400.0))
    assert found.time == 135.0
    assert found.strength == pytest.approx(0.15)
    assert found.true == pytest.approx(0.91)


def test_a_decision_that_is_high_before_the_fault_has_no_edge_and_says_so():
    t = np.arange(1501.0)
    found = decision_indices(t, high(t, (850, 1501)), 0.0 * t, Zone(300.0, 900.0, 1500.0))
    assert (found.time, found.true, found.high_at_onset) == (UNDEFINED, 1.0, True)
    assert found.false == pytest.approx(0.0833, abs=1e-4)


def test_a_day_without_a_fault_has_false_detections_only():
    t = np.arange(1000.0)
    found = decision_indices(t, high(t, (0, 370)), 0.0 * t, Zone(300.0, 1000.0, 1000.0))
    assert (found.time, found.true) == (UNDEFINED, UNDEFINED)
    assert found.false == pytest.approx(0.1)


def test_accuracy_is_one_over_the_faults_of_a_name():
    assert (accuracy((6, 18)), accuracy(())) == (0.5, 0.0)
    assert mean_accuracy({"a": (1,), "b": (2, 3)}) == 0.75


def test_every_fault_is_in_one_elementary_diagnosis():
    assert sorted(f for faults in FAULTS.values() for f in faults) == list(range(20))
    assert mean_accuracy(FAULTS) == pytest.approx((1 / 3 + 4 / 2 + 9) / 14)
