# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the topics say goes before the history, and only while somebody says it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.faults.ne107 import Ne107
from valve_twin.gateway.live.told import UNSTORED, Told
from valve_twin.gateway.metrics import exposition
from valve_twin.gateway.plain import plain_words
from valve_twin.gateway.view import LastCycle, NodeFault, View
from valve_twin.io.history.fleet import FleetRow

A, B = "/press/a", "/press/b"
STORED = FleetRow(A, "first_order", VerdictKind.OK, "all is well", Ne107.GOOD.value, cycle=20)
OTHER = FleetRow("/elsewhere", "first_order", VerdictKind.OK, "sound", Ne107.GOOD.value)
VIEW = View((OTHER, STORED), "history", 1, courses={A: (1.0, 2.0, 3.0)})
WORD = Verdict(1, A, VerdictKind.SENSOR, "sensor", "it freezes", 21)


@pytest.fixture
def told():
    return Told({A: "first_order", B: "first_order"})


def over(told: Told, view: View = VIEW) -> View:
    return told.over(view, lambda _: AgingConfig())


def row_of(view: View, valve: str) -> FleetRow:
    found = view.row(valve)
    assert found is not None
    return found


def test_nothing_said_is_the_history(told):
    assert replace(over(told), live=False) == VIEW


def test_a_verdict_ranks_its_valve_and_keeps_what_is_stored(told):
    told.judge(A, WORD)
    view = over(told)
    assert [row.valve for row in view.rows] == [A, "/elsewhere"]
    row = row_of(view, A)
    assert (row.verdict, row.evidence, row.cycle) == (VerdictKind.SENSOR, "it freezes", 20)
    assert row.ne107 == Ne107.OUT_OF_SPECIFICATION.value
    assert view.verdicts[A] is WORD
    told.judge(A, None)
    assert row_of(over(told), A) is STORED


def test_what_a_node_tells_is_not_stale_where_the_history_cannot_be_read(told):
    assert not over(told).is_stale(A)
    gone = replace(VIEW, failure="no disk")
    assert over(told, gone).is_stale(A)
    told.judge(A, WORD)
    view = over(told, gone)
    assert [row.valve for row in view.rows if view.is_stale(row.valve)] == ["/elsewhere"]
    assert plain_words(view, row_of(view, "/elsewhere"))["stale"] is True
    shown = exposition(view).decode()
    assert f'valve_twin_cycle{{valve="{A}"}} 20.0' in shown
    assert "/elsewhere" not in shown


def test_the_same_words_are_the_same_objects(told):
    told.judge(A, WORD)
    first = over(told)
    told.judge(A, Verdict(1, A, VerdictKind.SENSOR, "sensor", "it freezes", 21))
    assert over(told) is first
    told.close_cycle(A, LastCycle(22))
    second = over(told)
    assert second is not first
    assert second.made_of(row_of(second, A))[0] is row_of(first, A)
    assert row_of(second, A).cycle == 20  # what is read by the number has to be stored
    assert second.last == {A: LastCycle(22)}


def test_a_history_read_anew_is_laid_under_what_was_said(told):
    told.judge(A, WORD)
    over(told)
    later = replace(VIEW, rows=(OTHER, replace(STORED, cycle=21)))
    row = row_of(over(told, later), A)
    assert (row.cycle, row.verdict) == (21, VerdictKind.SENSOR)


def test_a_valve_that_is_not_stored_yet_is_there_as_soon_as_it_is_spoken_of(told):
    told.close_cycle(B, LastCycle(1))
    row = row_of(over(told), B)
    assert (row.evidence, row.ne107) == (UNSTORED, Ne107.CHECK_FUNCTION.value)
    told.close_cycle(B, None)
    assert over(told).row(B) is None


def test_faults_are_listed_worst_first_and_belong_to_the_valve_they_run_below(told):
    told.report("1", [NodeFault("/rec", "", "recorder.loss"), NodeFault("/x", "", "new.one")])
    told.report("2", [NodeFault(f"{B}/player", "", "input.silent"), NodeFault("/t", A, "x.y")])
    view = over(told)
    assert [f.code for f in view.faults] == ["input.silent", "recorder.loss", "new.one", "x.y"]
    assert view.faults[2].ne107 is Ne107.CHECK_FUNCTION  # not known here
    assert [f.code for f in view.faults_of(B)] == ["input.silent"]
    assert [f.code for f in view.faults_of(A)] == ["x.y"]
    assert row_of(view, A) is STORED
    told.report("2", ())
    assert [f.code for f in over(told).faults] == ["recorder.loss", "new.one"]


def test_only_what_is_said_of_a_valve_counts_as_news_of_it(told):
    before = told.number(A), told.number(B)
    told.close_cycle(A, LastCycle(3))
    told.report("1", [NodeFault("/t", A, "x.y")])
    told.report("1", [NodeFault("/t", A, "x.y")])
    assert (told.number(A) - before[0], told.number(B) - before[1]) == (2, 0)
