# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The history keeps what is remarked on a valve: verdicts where they say something new, events."""

import dataclasses
import os
import sqlite3
from contextlib import closing

import pytest

from valve_twin.core.aging.verdict import Verdict, VerdictKind, held_back
from valve_twin.core.types import Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import UNSUMMED

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


def test_a_verdict_that_waits_for_a_cycle_is_no_news(history):
    history.add_verdict(VALVE, verdict(12))
    waiting = held_back(verdict(13), 4.2)
    assert waiting.kind is VerdictKind.NOT_ENOUGH_DATA
    assert not history.add_verdict(VALVE, waiting)
    assert not history.add_verdict(VALVE, verdict(14))
    assert history.add_verdict(VALVE, verdict(15, VerdictKind.VALVE, fault="leak"))
    assert [v.cycle for v in history.verdicts(VALVE)] == [12, 15]


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


class TestWithdrawnEvents:
    SEAL = Maintenance(5, 10, "new seal", new_reference=True)

    def withdrawn(self, note="the other valve was meant"):
        return dataclasses.replace(self.SEAL, withdrawn=True, withdrawn_note=note)

    def test_it_stays_in_the_record_as_withdrawn(self, history, tmp_path):
        history.add_maintenance(VALVE, self.SEAL)
        note = "the other valve was meant"
        assert history.withdraw_maintenance(VALVE, 10, note) == self.withdrawn()
        with History(tmp_path / "history.sqlite", read_only=True) as again:
            assert again.maintenance(VALVE) == [self.withdrawn()]
            assert again.verify().damaged == []

    @pytest.mark.parametrize(
        ("cycle", "note", "why"),
        [
            (11, "why", "a maintenance event at cycle 11 is not there: in force are .* 7"),
            (10, "why", "cycle 10 was withdrawn already: the other valve was meant: .* 7"),
            (7, " ", "the note is empty: say why it is withdrawn"),
            (7, "ü" * 1025, "the note has 2050 bytes, 2048 at most"),
        ],
    )
    def test_what_makes_no_sense_is_refused(self, history, cycle, note, why):
        history.add_maintenance(VALVE, self.SEAL)
        history.add_maintenance(VALVE, Maintenance(4, 7, "new pilot"))
        history.withdraw_maintenance(VALVE, 10, "the other valve was meant")
        before = history.maintenance(VALVE)
        with pytest.raises(StoreError, match=why):
            history.withdraw_maintenance(VALVE, cycle, note)
        with pytest.raises(StoreError, match="is not there: in force are those at cycle none"):
            history.withdraw_maintenance("/press/valve_2", 7, "no such valve")
        assert history.maintenance(VALVE) == before

    def test_of_two_at_a_cycle_the_newest_goes_first_and_a_new_mark_stands(self, history):
        history.add_maintenance(VALVE, self.SEAL)
        swap = Maintenance(5, 10, "sensor swap")
        history.add_maintenance(VALVE, swap)
        assert history.withdraw_maintenance(VALVE, 10, "a").note == "sensor swap"
        assert history.withdraw_maintenance(VALVE, 10, "b").note == "new seal"
        assert history.add_maintenance(VALVE, swap)
        assert [(e.note, e.withdrawn) for e in history.maintenance(VALVE)] == [
            ("new seal", True), ("sensor swap", True), ("sensor swap", False),
        ]  # fmt: skip

    @pytest.mark.parametrize(
        "change",
        [
            "withdrawn = 0",
            "withdrawn_note = ''",
            "withdrawn_note = 'somebody else'",
            "withdrawn = 0, withdrawn_note = ''",
        ],
    )
    def test_a_changed_withdrawal_is_named_and_never_shown(self, history, tmp_path, change):
        history.add_maintenance(VALVE, self.SEAL)
        history.withdraw_maintenance(VALVE, 10, "the other valve was meant")
        with closing(sqlite3.connect(tmp_path / "history.sqlite")) as connection, connection:
            connection.execute(f"UPDATE maintenance SET {change}")
        assert history.maintenance(VALVE) == []
        assert "table maintenance" in history.verify().damaged[0]

    def test_who_looks_again_and_again_sees_that_something_changed(self, history):
        history.add_maintenance(VALVE, self.SEAL)
        before = history.marks().valves[VALVE]
        history.withdraw_maintenance(VALVE, 10, "the other valve was meant")
        assert history.marks().valves[VALVE] != before

    def test_the_sums_of_events_from_before_withdrawals_hold(self, history, tmp_path):
        history.add_maintenance(VALVE, self.SEAL)
        history.close()
        with closing(sqlite3.connect(tmp_path / "history.sqlite")) as connection, connection:
            before = connection.execute("SELECT check_sum FROM maintenance").fetchall()
            for name in UNSUMMED["maintenance"]:
                connection.execute(f"ALTER TABLE maintenance DROP COLUMN {name}")
            for table in ("counters", "event", "condensate", "condensed"):
                connection.execute(f"DROP TABLE {table}")
            connection.execute("ALTER TABLE valve DROP COLUMN check_sum")
            connection.execute("UPDATE valve_twin_schema SET version_num = '0007'")
        with History(tmp_path / "history.sqlite") as upgraded:
            assert upgraded.maintenance(VALVE) == [self.SEAL]
            assert upgraded.verify().damaged == []
            assert upgraded.withdraw_maintenance(VALVE, 10, "x").withdrawn
        with closing(sqlite3.connect(tmp_path / "history.sqlite")) as connection:
            assert connection.execute("SELECT check_sum FROM maintenance").fetchall() != before

    @pytest.mark.parametrize("first", [True, False])
    def test_a_file_put_in_its_place_gets_the_withdrawal_and_no_second_event(
        self, tmp_path, first
    ):
        path, aside = tmp_path / "in_use.sqlite", tmp_path / "other.sqlite"
        with History(path) as history:
            history.add_maintenance(VALVE, self.SEAL)
            if not first:
                history.withdraw_maintenance(VALVE, 10, "early")
            history.backup(aside)
            if first:
                history.withdraw_maintenance(VALVE, 10, "late")
            else:
                with History(aside) as other:
                    assert other.maintenance(VALVE)[0].withdrawn
            os.replace(aside, path)
            history.repair()
            (event,) = history.maintenance(VALVE)
            assert (event.withdrawn, event.withdrawn_note) == (True, "late" if first else "early")
            assert history.verify().damaged == []
