# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A detector that has learnt from four hours; the whole day is the benchmark's."""

import numpy as np
import pytest

from valve_twin.core.valves.damadics.diagnosis.detector import HOLD, learn
from valve_twin.core.valves.damadics.diagnosis.isolation import UNDECIDED, Diagnosis, isolate
from valve_twin.core.valves.damadics.record import Fault, Process, simulate

ONSET = 900


@pytest.fixture(scope="module")
def detector():
    return learn(simulate(14400, seed=11, process=Process().detuned()).signals)


@pytest.fixture(scope="module")
def watched(detector):
    """Return by fault and strength the alarms and the names of 1500 s."""
    faults = {(1, 0.5): 21, (7, 0.25): 22, (12, -0.75): 23, (17, 0.75): 24, (18, 0.25): 25,
              (19, -0.5): 26, (13, 0.5): 27, (14, -0.75): 28, (0, 0.0): 29}  # fmt: skip
    found = {}
    for (number, strength), seed in faults.items():
        given = [Fault(number, strength, float(ONSET))] if number else []
        signals = simulate(1500, given, seed=seed).signals
        alarms = detector.detect(signals)
        found[number] = alarms, isolate(detector, alarms, signals)
    return found


def test_nothing_is_raised_before_a_fault_nor_without_one(watched):
    for number, (alarms, named) in watched.items():
        assert not alarms.high[:ONSET].any(), number
        assert (named[:ONSET] == Diagnosis.NONE).all()
    assert not watched[0][0].high.any()


@pytest.mark.parametrize("number", [1, 7, 12, 13, 17, 18, 19])
def test_a_fault_is_seen_within_half_a_minute_and_stays_seen(watched, number):
    high = watched[number][0].high
    first = int(np.flatnonzero(high)[0])
    assert ONSET < first <= ONSET + 40
    assert high[first:].all()


def test_a_sensor_that_is_in_no_official_signal_is_not_seen(watched):
    assert not watched[14][0].high.any()


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (1, Diagnosis.STOP),
        (7, Diagnosis.WARM),
        (12, Diagnosis.LEAK_OR_DRIVE),
        (13, Diagnosis.SENSOR),
        (17, Diagnosis.PRESSURE),
        (18, Diagnosis.ADDED_FLOW),
        (19, Diagnosis.MORE_FLOW),
    ],
)
def test_a_fault_is_named(watched, number, name):
    alarms, named = watched[number]
    during = named[alarms.high]
    assert (during[during != UNDECIDED] == name).mean() > 0.9
    assert named[-1] == name


def test_what_was_said_does_not_change_with_what_comes_later(detector):
    signals = simulate(1300, [Fault(10, 0.5, 900.0)], seed=31).signals
    whole, part = detector.detect(signals), detector.detect(signals[:1100])
    assert np.array_equal(whole.high[:1100], part.high)
    names = [isolate(detector, a, s) for a, s in ((whole, signals), (part, signals[:1100]))]
    assert np.array_equal(names[0][:1100], names[1])


def test_an_alarm_outlives_its_cause_by_its_hold(detector):
    signals = simulate(1500, [Fault(17, 0.75, 900.0, 0.0, 930.0)], seed=32).signals
    alarms = detector.detect(signals)
    last = int(np.flatnonzero(alarms.cause)[-1])
    assert alarms.high[last : last + HOLD].all()
    assert not alarms.high[last + HOLD :].any()


def test_a_record_that_is_too_short_is_refused():
    with pytest.raises(ValueError, match="a healthy record of 900 samples: 14400 are needed"):
        learn(simulate(900, seed=1).signals)
