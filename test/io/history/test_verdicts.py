# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The history keeps a verdict where it says something new, and gives it back as it was."""

import pytest

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.io.history.store import History

VALVE = "/press/valve_1"


def verdict(cycle, kind=VerdictKind.OK, evidence="largest drift: K_in +0.1 % of new", fault=""):
    return Verdict(cycle * 10**9, VALVE, kind, kind.text, evidence, cycle, fault)


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "history.sqlite") as made:
        yield made


def test_what_is_stored_comes_back(history, tmp_path):
    evidence = "leak of the chamber, size 0.0003 1/s, since cycle 40"
    leak = verdict(41, VerdictKind.VALVE, evidence, "leak")
    assert history.add_verdict(VALVE, verdict(12))
    assert history.add_verdict(VALVE, leak)
    with History(tmp_path / "history.sqlite", read_only=True) as again:
        assert again.verdicts(VALVE) == [verdict(12), leak]
        assert again.verdicts(VALVE, first_cycle=13) == [leak]
        assert again.verdicts("/press/valve_2") == []


def test_the_same_verdict_is_kept_once(history):
    assert history.add_verdict(VALVE, verdict(12))
    assert not history.add_verdict(VALVE, verdict(13, evidence="largest drift: K_in +0.2 %"))
    assert [v.cycle for v in history.verdicts(VALVE)] == [12]


def test_another_fault_under_the_same_word_is_news(history):
    kind = VerdictKind.SENSOR
    offset = "offset of the position sensor, size 0.001, since cycle 41"
    more = "offset of the position sensor, size 0.0012, since cycle 41"
    freeze = "freezing position sensor, size 1, since cycle 60"
    told = [
        history.add_verdict(VALVE, verdict(cycle, kind, text, fault))
        for cycle, text, fault in (
            (41, offset, "sensor_offset"),
            (42, more, "sensor_offset"),
            (60, freeze, "sensor_freeze"),
        )
    ]
    assert told == [True, False, True]


def test_the_fault_counts_and_not_the_words_of_the_evidence(history):
    kind, words = VerdictKind.VALVE, "K_in -13.9 % of new, 40 cycles left"
    assert history.add_verdict(VALVE, verdict(41, kind, words, "K_in"))
    other = "K_in in other words, beyond its threshold"
    assert not history.add_verdict(VALVE, verdict(42, kind, other, "K_in"))
    assert history.add_verdict(VALVE, verdict(43, kind, words, "leak"))


def test_a_monitor_that_repeats_an_old_verdict_changes_nothing(history):
    history.add_verdict(VALVE, verdict(12))
    history.add_verdict(VALVE, verdict(41, VerdictKind.SUPPLY, "drop of the supply pressure"))
    assert not history.add_verdict(VALVE, verdict(12))
    assert not history.add_verdict(VALVE, verdict(41))
    assert [v.cycle for v in history.verdicts(VALVE)] == [12, 41]


def test_each_valve_has_its_own(history):
    assert history.add_verdict(VALVE, verdict(12))
    assert history.add_verdict("/press/valve_2", verdict(3))
    assert [v.cycle for v in history.verdicts("/press/valve_2")] == [3]
