# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The event log: what enters it, who has seen it, what is kept and what goes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from valve_twin.core.aging.verdict import (
    LimitState,
    Trend,
    TrendStatus,
    Verdict,
    VerdictKind,
)
from valve_twin.core.operation.events import Event
from valve_twin.core.types import Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.log.events import Acknowledgement
from valve_twin.io.history.store import CycleRecord, History

VALVE = "/press/valve_1"


def verdict(cycle, kind, fault=""):
    return Verdict(cycle * 10**9, VALVE, kind, kind.text, f"why {cycle}", cycle, fault)


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "h.db", events_kept=20) as opened:
        opened.store(VALVE, CycleRecord(1, 0, 1, 10))
        yield opened


def codes(history, **chosen):
    return [e.code for e in history.log.events(VALVE, **chosen)]


def test_verdicts_that_change_faults_that_heal_and_maintenance_enter_the_log(history):
    for said in (
        verdict(10, VerdictKind.OK),
        verdict(11, VerdictKind.OK),
        verdict(12, VerdictKind.SENSOR, "sensor_freeze"),
        verdict(13, VerdictKind.NOT_ENOUGH_DATA),
        verdict(14, VerdictKind.SENSOR, "sensor_freeze"),
        verdict(15, VerdictKind.VALVE, "K_in"),
    ):
        history.add_verdict(VALVE, said)
    history.add_maintenance(VALVE, Maintenance(20, 16, "new sensor"))
    history.withdraw_maintenance(VALVE, 16, "wrong valve")
    found = history.log.events(VALVE)
    assert [(e.code, e.status) for e in found] == [
        ("verdict.ok", "good"),
        ("fault.sensor_freeze", "failure"),
        ("verdict.not_enough_data", "check function"),
        ("fault.sensor_freeze", "failure"),
        ("healed.sensor_freeze", "good"),
        ("limit.K_in", "maintenance required"),
        ("maintenance.marked", "good"),
        ("maintenance.withdrawn", "good"),
    ]
    assert (found[1].cycle, found[1].stamp_ns, found[1].valve) == (12, 12 * 10**9, VALVE)
    assert [e.text for e in found[-2:]] == ["new sensor", "wrong valve"]
    assert codes(history, open_only=True) == [
        "fault.sensor_freeze", "verdict.not_enough_data", "fault.sensor_freeze", "limit.K_in",
    ]  # fmt: skip
    assert [e.id for e in history.log.events(VALVE, found[2].id, 2)] == [e.id for e in found[2:4]]


def test_a_state_of_a_limit_enters_the_log_where_it_changes(history):
    known = Trend(
        0, VALVE, "K_in", "1", "cycles", TrendStatus.DRIFTING, "", 20, 1, 1.0, 20.0, level=0.89,
        warning=0.9, threshold=0.8,
    )  # fmt: skip
    said = [
        (1, LimitState.WITHIN), (2, LimitState.WARNING), (3, LimitState.NONE),
        (4, LimitState.WARNING), (5, LimitState.ALARM), (4, LimitState.WARNING),
        (6, LimitState.WITHIN),
    ]  # fmt: skip
    new = [
        history.log.add_limit(VALVE, replace(known, stamp_ns=at, limit_state=state))
        for at, state in said
    ]
    assert new == [False, True, False, False, True, False, True]
    assert [(e.code, e.status, e.stamp_ns) for e in history.log.events(VALVE)] == [
        ("limit_warning.K_in", "maintenance required", 2),
        ("limit_alarm.K_in", "out of specification", 5),
        ("limit_within.K_in", "good", 6),
    ]
    text = "K_in warning: level 0.89, warning limit 0.9, service limit 0.8"
    assert history.log.events(VALVE)[0].text == text
    other = replace(known, parameter="leak", stamp_ns=1, limit_state=LimitState.ALARM)
    assert history.log.add_limit(VALVE, other)


def test_the_entry_of_a_limit_names_the_cycle_that_ends_when_the_trend_does(history):
    known = Trend(
        7, VALVE, "K_in", "1", "cycles", TrendStatus.DRIFTING, "", 20, 1, 1.0, 20.0, level=0.89,
        warning=0.9, threshold=0.8, limit_state=LimitState.WARNING,
    )  # fmt: skip
    for cycle in (2, 3, 4):
        history.store(VALVE, CycleRecord(cycle, 2 * cycle, 2 * cycle + 1, 10))
    history.store("/other", CycleRecord(9, 6, 7, 10))
    history.log.add_limit(VALVE, known)
    history.log.add_limit(VALVE, replace(known, stamp_ns=8, limit_state=LimitState.ALARM))
    assert [e.cycle for e in history.log.events(VALVE)] == [3, 0]


def test_an_acknowledgement_stays_with_its_entry_and_is_one_itself(history):
    history.add_verdict(VALVE, verdict(2, VerdictKind.SENSOR, "sensor_freeze"))
    history.add_verdict(VALVE, verdict(3, VerdictKind.SUPPLY, "supply_drop"))
    first = history.log.events(VALVE)[0]
    by = Acknowledgement("J. Doe", "cable renewed", 77)
    assert history.log.acknowledge(VALVE, first.id, by) == 1
    assert history.log.acknowledge(VALVE, first.id, by) == 0
    seen = history.log.events(VALVE)[0]
    assert (seen.acknowledged, seen.acknowledged_by, seen.acknowledged_at_ns) == (
        True, "J. Doe", 77,
    )  # fmt: skip
    assert codes(history, open_only=True) == ["fault.supply_drop"]
    assert history.log.acknowledge(VALVE, 0, Acknowledgement("night shift")) == 1
    assert codes(history, open_only=True) == []
    assert codes(history)[-1] == "event.acknowledged"
    assert history.verify().damaged == []
    for number, who, what in (
        (first.id, " ", "who is empty"),
        (first.id, "x" * 201, "201 bytes, 200 at most"),
        (10**9, "me", "there is no entry 1000000000"),
        (2**63, "me", "there is no entry 9223372036854775808"),
        (2**64 - 1, "me", "there is no entry 18446744073709551615"),
        (0, "m\udce9", r"who 'm\\udce9' is no text in UTF-8"),
        (0, "m\0e", r"who 'm\\x00e' is no text in UTF-8"),
    ):
        with pytest.raises(StoreError, match=what):
            history.log.acknowledge(VALVE, number, Acknowledgement(who))
    with pytest.raises(StoreError, match="2049 bytes, 2048 at most"):
        history.log.acknowledge(VALVE, 0, Acknowledgement("me", "n" * 2049))
    with pytest.raises(StoreError, match="there is no entry"):
        history.log.acknowledge("/other/valve", first.id, Acknowledgement("me"))


def test_old_entries_go_but_no_failure_that_nobody_has_seen(history):
    """Two failures, one of them seen; then three times as many entries as are kept."""
    for number in (1, 2):
        history.log.add(VALVE, Event(number, number, "fault.sensor_freeze", "failure", "frozen"))
    unseen, seen = history.log.events(VALVE)
    history.log.acknowledge(VALVE, seen.id, Acknowledgement("me"))
    for number in range(60):
        history.log.add(VALVE, Event(number, number, "twin.start", "good", "starts"))
    found = history.log.events(VALVE)
    assert len(found) == 21
    assert found[0] == unseen
    assert {e.code for e in found[1:]} == {"twin.start"}


def test_the_last_stroke_test_stays_however_many_entries_follow(history):
    for stamp in (5, 9, 7):
        history.log.add_stroke(VALVE, Event(stamp, 0, "stroke_test.pass", "good", "tested"))
    for number in range(100):
        history.log.add(VALVE, Event(number, number, "twin.start", "good", "starts"))
    assert [e.stamp_ns for e in history.log.strokes(VALVE)] == [9]
    assert len(history.log.events(VALVE)) == 21


def test_a_number_beyond_all_lists_nothing(history):
    history.log.add(VALVE, Event(1, 1, "twin.start", "good", "starts"))
    assert history.log.events(VALVE, 2**64 - 1) == []


def test_an_entry_is_one_line_whatever_somebody_writes(history):
    history.log.add(VALVE, Event(1, 1, "fault.sensor_freeze", "failure", "frozen"))
    history.log.acknowledge(VALVE, 1, Acknowledgement("J.\nDoe", "seen\r\n2: forged"))
    history.add_maintenance(VALVE, Maintenance(2, 1, "new seal\nand spring", False))
    found = Verdict(3, VALVE, VerdictKind.SENSOR, "sensor", "why\n" * 5000, 2, "sensor_freeze")
    history.add_verdict(VALVE, found)
    texts = [e.text for e in history.log.events(VALVE)[1:]]
    assert texts[:2] == ["J. Doe has seen entry 1: seen 2: forged", "new seal and spring"]
    assert not any("\n" in text for text in texts)
    assert max(map(len, texts)) <= 4096


def test_a_failure_that_comes_and_goes_does_not_fill_the_log(history):
    """Thrice the kept number of failures of two kinds, then of as many kinds; nobody looks."""
    for number in range(60):
        name = "sensor_freeze" if number % 3 else "supply_drop"
        history.log.add(VALVE, Event(number, number, f"fault.{name}", "failure", "again"))
    found = history.log.events(VALVE)
    assert [e.cycle for e in found] == [0, 1, *range(40, 60)]  # the first of each, the newest
    for number in range(60, 120):
        history.log.add(VALVE, Event(number, number, f"limit.{number}", "failure", "new"))
    found = history.log.events(VALVE)
    assert len(found) == 40
    assert [e.cycle for e in found[20:]] == list(range(100, 120))
