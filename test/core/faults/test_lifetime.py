# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults are confirmed, counted on edges, healed and cleared as their table says."""

import math
import re
from pathlib import Path

import pytest

from valve_twin.core.faults.kinds import FAULT_KINDS, with_fault_table
from valve_twin.core.faults.lifetime import FaultBook, FaultKind, Moment, Severity, Status

SLOW = FaultKind("a.slow", Severity.WARN, "m", "r", confirm_s=2.0, heal_s=3.0)
OFTEN = FaultKind("a.often", Severity.ERROR, "m", "r", confirm_count=3, heal_s=5.0)
AT_ONCE = FaultKind("a.at_once", Severity.STALE, "m", "r", heal_s=0.0)


def at(seconds: float) -> Moment:
    return Moment(seconds, round(1e9 * (seconds + 1000.0)))


@pytest.fixture
def book():
    return FaultBook((SLOW, OFTEN, AT_ONCE))


def statuses(book):
    return [f.status for f in book.faults()]


def test_a_condition_is_confirmed_when_it_has_lasted(book):
    book.report("a.slow", "x", at(0))
    book.report("a.slow", "x", at(1))
    assert statuses(book) == [Status.PENDING]
    assert book.changes() == []
    book.report("a.slow", "y", at(2))
    fault = book.faults()[0]
    assert fault.is_active
    assert (fault.count, fault.evidence) == (1, "y")
    assert (fault.first_ns, fault.last_ns) == (at(0).stamp_ns, at(2).stamp_ns)


def test_a_suspicion_that_passes_leaves_no_trace(book):
    book.report("a.slow", "x", at(0))
    book.passed("a.slow", at(1))
    assert book.faults() == []
    book.report("a.slow", "x", at(2))
    assert statuses(book) == [Status.PENDING]  # the two seconds begin anew


def test_events_are_added_up_to_the_confirmation(book):
    book.report("a.often", "x", at(0), events=2)
    assert statuses(book) == [Status.PENDING]
    book.report("a.often", "x", at(0.1))
    assert statuses(book) == [Status.CONFIRMED]


def test_rare_events_are_not_added_up(book):
    for i in range(4):
        book.report("a.often", "x", at(6.0 * i))
        book.step(at(6.0 * i + 5.5))
    assert book.faults() == []


def test_the_count_rises_on_edges_only(book):
    for i in range(10):
        book.report("a.at_once", "x", at(i))
    book.passed("a.at_once", at(10))
    book.report("a.at_once", "x", at(11))
    fault = book.faults()[0]
    assert (fault.count, fault.events) == (2, 11)
    assert (fault.first_ns, fault.last_ns) == (at(0).stamp_ns, at(11).stamp_ns)
    assert [f.status for f in book.changes()] == [
        Status.CONFIRMED,
        Status.HEALED,
        Status.CONFIRMED,
    ]
    assert book.changes() == []


def test_healing_waits_until_nothing_was_reported_for_long_enough(book):
    for t in (0, 1, 2):
        book.report("a.slow", "x", at(t))
    book.passed("a.slow", at(4))
    assert statuses(book) == [Status.CONFIRMED]
    book.report("a.slow", "x", at(4.5))
    book.passed("a.slow", at(6))
    assert statuses(book) == [Status.CONFIRMED]
    book.step(at(7.5))
    assert statuses(book) == [Status.HEALED]


def test_a_healed_fault_keeps_its_history_through_a_new_suspicion(book):
    for t in (0, 1, 2):
        book.report("a.slow", "x", at(t))
    book.step(at(9))
    book.report("a.slow", "x", at(10))
    assert statuses(book) == [Status.PENDING]
    book.passed("a.slow", at(11))
    fault = book.faults()[0]
    assert (fault.status, fault.count, fault.first_ns) == (Status.HEALED, 1, at(0).stamp_ns)


def test_what_never_heals_by_itself_heals_when_it_is_seen_to_be_absent():
    kind = FaultKind("a.refused", Severity.WARN, "m", "r", confirm_count=2, heal_s=math.inf)
    book = FaultBook((kind,))
    book.report("a.refused", "x", at(0))
    book.step(at(1e6))
    book.report("a.refused", "x", at(1e6))
    book.step(at(2e6))
    assert statuses(book) == [Status.CONFIRMED]
    book.passed("a.refused", at(2e6))
    assert statuses(book) == [Status.HEALED]


def test_valves_and_subjects_are_kept_apart(book):
    book.report("a.at_once", "x", at(0), unit="/v1", subject="/t")
    book.report("a.at_once", "x", at(0), unit="/v2", subject="/t")
    book.passed("a.at_once", at(1), unit="/v1", subject="/t")
    assert [(f.unit, f.is_active) for f in book.faults()] == [("/v1", False), ("/v2", True)]
    assert [f.key for f in book.faults("/v2")] == ["a.at_once./t"]


def test_what_is_cleared_and_lasts_is_counted_anew(book):
    book.report("a.at_once", "x", at(0), unit="/v1")
    book.report("a.often", "x", at(0), unit="/v2", events=3)
    assert book.clear(unit="/v1") == 1
    assert [f.unit for f in book.faults()] == ["/v2"]
    book.report("a.at_once", "x", at(5), unit="/v1")
    assert book.faults("/v1")[0].count == 1
    assert book.faults("/v1")[0].first_ns == at(5).stamp_ns
    assert book.clear(code="a.often") == 1
    assert book.clear() == 1
    assert book.faults() == []


def test_an_unknown_code_is_refused(book):
    with pytest.raises(ValueError, match="is unknown; add it"):
        book.report("a.b", "x", at(0))


def test_the_documented_table_is_that_of_the_code():
    text = (Path(__file__).parents[3] / "docs/faults.md").read_text(encoding="utf-8")
    assert with_fault_table(text) == text, "write it anew: tools/run tools/parameters"


def test_every_kind_has_a_stable_code_a_meaning_and_a_remedy():
    codes = [k.code for k in FAULT_KINDS]
    assert len(set(codes)) == len(codes)
    for kind in FAULT_KINDS:
        assert re.fullmatch(r"[a-z]+\.[a-z_]+", kind.code), kind.code
        assert kind.meaning.endswith(".")
        assert kind.remedy.endswith(".")
        assert kind.confirm_count >= 1
        assert kind.confirm_s >= 0.0
        assert kind.heal_s >= 0.0
