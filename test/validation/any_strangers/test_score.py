# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What counts as found, as right and as a false alarm."""

from valve_twin.core.diagnosis.changes.finding import Finding
from valve_twin.validation.any_strangers.draw import draw
from valve_twin.validation.any_strangers.score import JUDGED_FROM, score
from valve_twin.validation.any_strangers.troubles import Trouble
from valve_twin.validation.any_strangers.watch import Told, first_with

STRANGER = draw(73_002)
ONSET = 20


def finding(fault, alarm, rivals=()):
    return Finding(fault, rivals, "valve", 0.1, 20.0, alarm, alarm)


def told(trouble, findings, *, cycles=26, shift_ns=0):
    starts = tuple(range(0, 10 * cycles, 10))
    seen = tuple((k + 1, a + shift_ns, a + 10 + shift_ns) for k, a in enumerate(starts))
    return Told(trouble, starts, seen, cycles, tuple(findings), tuple(findings))


def slow(onset=ONSET, size="medium"):
    return Trouble("slow_up", size, 0.15, onset)


def test_the_cycle_of_which_most_has_the_trouble_is_its_first():
    assert first_with(told(slow(), ())) == ONSET
    assert first_with(told(slow(), (), shift_ns=-6)) == ONSET + 1


def test_a_trouble_is_found_within_five_cycles_and_named_by_its_class():
    found = score(STRANGER, [told(slow(), [finding("slow", ONSET + 1)])])
    assert found.delays == [2]
    assert found.shares["medium: within 5"] == [1, 1]
    assert found.shares["medium: in the first cycle"] == [0, 1]
    assert found.shares["medium: named right"] == [1, 1]
    late = score(STRANGER, [told(slow(), [finding("slow", ONSET + 5)])])
    assert late.shares["medium: within 5"] == [0, 1]


def test_a_rival_is_counted_apart_and_another_name_is_wrong():
    found = score(STRANGER, [told(slow(), [finding("delay", ONSET, ("slow_up",))])])
    assert found.shares["medium: named right"] == [0, 1]
    assert found.shares["medium: right or its rival"] == [1, 1]
    assert found.shares["medium: in the first cycle"] == [1, 1]


def test_what_is_told_before_the_trouble_does_not_find_it():
    found = score(STRANGER, [told(slow(), [finding("slow", ONSET - 1)])])
    assert found.delays == [0]


def test_what_the_cycle_shows_in_which_the_trouble_begins_finds_it():
    found = score(STRANGER, [told(slow(), [finding("slow", ONSET)], shift_ns=-6)])
    assert found.delays == [1]  # most of the cycle before has it not
    earlier = score(STRANGER, [told(slow(), [finding("slow", ONSET - 1)], shift_ns=-6)])
    assert earlier.delays == [0]


def test_a_trouble_before_anything_can_be_told_is_counted_apart():
    found = score(STRANGER, [told(slow(JUDGED_FROM - 1), ())])
    assert found.shares == {"early: found": [0, 1]}
    assert "medium: within 5" in score(STRANGER, [told(slow(JUDGED_FROM), ())]).shares


def test_whatever_is_told_of_a_sound_valve_is_a_false_alarm():
    found = score(STRANGER, [told(None, [finding("slow", 15), finding("delay", 20)])])
    assert found.shares["false alarms in cycles"] == [2, 26]
