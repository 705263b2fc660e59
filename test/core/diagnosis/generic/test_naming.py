# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults named by what explains the motion of their cycles."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.finding import UNKNOWN, Finding
from valve_twin.core.diagnosis.config import OF_ANY_VALVE
from valve_twin.core.diagnosis.generic.explained import NAMED
from valve_twin.core.diagnosis.generic.naming import renamed
from valve_twin.core.diagnosis.generic.signatures import signatures_of
from valve_twin.core.valves.registry import get_model

ONSET, CYCLES = 15, np.arange(1, 25)


def table():
    """Return the signatures of a first-order valve: derived once a process, and by no import."""
    found = signatures_of(get_model("first_order"))
    assert found is not None
    return found


def finding(fault, *, onset=ONSET, end=-1):
    return Finding(fault, (), "valve", 0.1, 9.0, onset, onset + 2, end)


def shown(*, scatter=0.01, fall=0.0, **more):
    """How much faults explain: at random before, by so much more from the onset on."""
    rng = np.random.default_rng(4)
    rows = 0.1 + scatter * rng.standard_normal((len(CYCLES), len(NAMED)))
    for name, value in more.items():
        rows[CYCLES >= ONSET, NAMED.index(name)] += value
    rows[CYCLES == ONSET] += fall
    return rows


def vectors(fault="delay", size=2.0):
    change = next(s.change for s in table().signatures if s.fault == fault)
    rows = np.zeros((len(CYCLES), len(table().features)))
    rows[CYCLES >= ONSET] = size * np.array(change)
    return rows


def named(found, rows, **more):
    return renamed([found], CYCLES, vectors(), rows, table(), OF_ANY_VALVE, **more)[0]


@pytest.mark.parametrize("wrong", ["lost_motion", "sensor_gain", UNKNOWN])
def test_what_explains_more_than_before_names_it(wrong):
    found = named(finding(wrong), shown(delay=1.0))
    small = next(s.severity for s in table().signatures if s.fault == "delay")
    assert (found.fault, found.part, found.rivals) == ("delay", "valve", ())
    assert found.severity == pytest.approx(2.0 * small, rel=0.3)
    assert (found.onset, found.alarm, found.end) == (ONSET, ONSET + 2, -1)


def test_what_explains_nearly_as_much_is_named_with_it():
    found = named(finding("lost_motion"), shown(delay=1.0, slow=0.85, slow_up=0.4))
    assert (found.fault, found.rivals) == ("delay", ("slow",))


@pytest.mark.parametrize("fault", ["sensor_freeze", "sensor_noise", "sensor_offset", "no_motion"])
def test_what_no_motion_shows_keeps_its_name(fault):
    assert named(finding(fault), shown(delay=1.0)) == finding(fault)


def test_the_name_by_signatures_stays_where_it_explains_a_third_or_nothing_does():
    found = finding("lost_motion")
    beside = named(found, shown(delay=1.0, lost_motion=0.5, slow=0.4, slow_up=0.3))
    assert beside == replace(found, rivals=("delay", "slow"))
    assert named(found, shown(delay=0.1)) == found
    assert named(found, shown(scatter=0.5, delay=0.5)) == found


def test_the_cycle_of_the_onset_is_left_out():
    assert named(finding("lost_motion"), shown(delay=1.0, fall=-5.0)).fault == "delay"


def test_features_that_were_stored_without_it_keep_their_names():
    rows = shown(delay=1.0)
    rows[:12] = np.nan
    assert named(finding("lost_motion"), rows) == finding("lost_motion")
    assert named(finding("lost_motion"), np.full_like(rows, np.nan)).fault == "lost_motion"


def test_what_was_before_maintenance_is_no_measure():
    found = finding("lost_motion")
    assert named(found, shown(delay=1.0), restarts=[ONSET - 2]) == found
    assert named(found, shown(delay=1.0), restarts=[3]).fault == "delay"


def test_cycles_of_another_fault_are_no_measure():
    early = finding("sensor_freeze", onset=5, end=12)
    rows = shown(delay=1.0)
    rows[4:11] += 1.0
    both = renamed([early, finding("lost_motion")], CYCLES, vectors(), rows, table(), OF_ANY_VALVE)
    assert [f.fault for f in both] == ["sensor_freeze", "delay"]
