# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Old cycles become hours and days, and nothing that is said of a valve changes by it."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa

from valve_twin.bench.data.years import features, life
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.past.condensate import DAY_S, HOUR_S, OF_CYCLES
from valve_twin.core.past.state import AgingState
from valve_twin.core.types import EstimateStatus, Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.fleet import describe_valve
from valve_twin.io.history.insert import Insert
from valve_twin.io.history.store import CycleRecord, CycleTakenError, History
from valve_twin.io.history.tables import (
    CONDENSATE,
    CONDENSED,
    CYCLE,
    ESTIMATE,
    estimate_row,
    to_row,
)
from valve_twin.io.history.tiers import condense as module
from valve_twin.io.history.tiers.condense import condense
from valve_twin.io.history.tiers.extent import condensed, condensed_until
from valve_twin.io.history.tiers.reading import condensates
from valve_twin.io.history.tiers.retention import Retention
from valve_twin.report.build import history_data

VALVE = "/v"
CONFIG = AgingConfig(max_candidates=60)
PERIOD_NS = 600 * 10**9  # 144 cycles a day
KEEP = Retention(cycles=200)


def lived(cycles, first=1):
    """Yield a life of long cycles: estimates for the trend, features, and others beside them."""
    for n, (e, f) in enumerate(
        zip(life(cycles, first), features(cycles, first), strict=True), first
    ):
        start_ns = n * PERIOD_NS
        own = replace(e, start_ns=start_ns, end_ns=start_ns + 25 * 10**9)
        refused = replace(own, status=EstimateStatus.REFUSED, reason="no motion", parameters=())
        beside = replace(own, estimator="beside", used_by_trend=False)
        shown = replace(f, start_ns=own.start_ns, end_ns=own.end_ns)
        yield [refused if n % 50 == 0 else own, beside, shown]


def store(history, cycles, first=1, valve=VALVE):
    """Store many cycles in one transaction."""
    insert_cycle = Insert(history._database, CYCLE)
    insert_estimates = Insert(history._database, ESTIMATE)
    with history.writing(valve) as (connection, valve_id):
        for estimates in lived(cycles, first):
            e = estimates[0]
            record = CycleRecord(e.cycle, e.start_ns, e.end_ns, 800, lost=e.cycle % 2)
            insert_cycle(connection, [to_row(record, valve_id)])
            insert_estimates(
                connection, [estimate_row(valve_id, i, e) for i, e in enumerate(estimates)]
            )


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Let little be kept and condense little at a time, so that short histories show all of it."""
    monkeypatch.setattr(module, "LEAST", 100)
    monkeypatch.setattr(module, "A_TIME", 300)
    monkeypatch.setattr(module, "_PAGE", 64)


def thinned(monkeypatch):
    """Let what is known of aging be thinned early."""
    monkeypatch.setattr(AgingState.__init__, "__defaults__", (64, 32))


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Return a history of 1000 cycles that nobody changes."""
    path = tmp_path_factory.mktemp("filled") / "h.db"
    with History(path) as found:
        store(found, 1000)
    return path


@pytest.fixture
def history(tmp_path, filled):
    shutil.copy(filled, tmp_path / "h.db")
    with History(tmp_path / "h.db") as found:
        yield found


def said(history):
    """Return all that is said of a valve by fleet and report."""
    data = history_data(history, VALVE, CONFIG)
    return repr(describe_valve(history, VALVE, CONFIG)), repr(data.assessment)


def rows(history, table):
    return [tuple(r.values()) for r in history.select(sa.select(table))]


@pytest.mark.parametrize("thin", [False, True])
def test_what_is_said_of_a_valve_is_what_it_was(history, monkeypatch, thin):
    if thin:
        thinned(monkeypatch)
    event = Maintenance(stamp_ns=1, cycle=300, note="new seal", new_reference=True)
    history.add_maintenance(VALVE, event)
    before = said(history)
    done = condense(history, VALVE, KEEP)
    assert done is not None
    assert done.cycle == condensed_until(history, VALVE) == 719  # the day of 800 stays whole
    assert said(history) == before
    store(history, 300, 1001)
    with History(history.where.replace("h.db", "whole.db")) as whole:
        store(whole, 1000)
        store(whole, 300, 1001)
        whole.add_maintenance(VALVE, event)
        after = said(whole)
    assert said(history) == after
    condense(history, VALVE, KEEP)
    assert condensed_until(history, VALVE) > 719
    assert said(history) == after


def test_it_is_the_same_however_often_it_is_condensed(history, tmp_path):
    with History(history.backup(tmp_path / "other.db")) as other:
        for keep in (800, 500, 200):
            condense(history, VALVE, Retention(cycles=keep))
        condense(other, VALVE, KEEP)
        for table in (CONDENSED, CYCLE):
            assert rows(history, table) == rows(other, table)
        assert len(rows(history, ESTIMATE)) == len(rows(other, ESTIMATE))
        assert sorted(map(repr, condensates(history, VALVE))) == sorted(
            map(repr, condensates(other, VALVE))
        )


def test_what_the_trend_holds_stays_to_the_last_bit(history, monkeypatch):
    thinned(monkeypatch)
    before = {(e.cycle, e.estimator): repr(e) for e in history.estimates(VALVE)}
    condense(history, VALVE, KEEP)
    kept = {(e.cycle, e.estimator): repr(e) for e in history.estimates(VALVE)}
    assert kept == {key: before[key] for key in kept}
    old = [key for key in kept if key[0] <= 719]
    assert {name for _, name in old} == {"output_error", "features"}
    assert 64 <= sum(name == "output_error" for _, name in old) < 400
    assert [c.cycle for c in history.cycles(VALVE)] == list(range(720, 1001))


def test_hours_and_days_say_what_the_cycles_said(history):
    whole = history.estimates(VALVE, "output_error")
    condense(history, VALVE, Retention(cycles=200, hours_for_days=1e4))
    for span_s, day in ((DAY_S, 2), (HOUR_S, 50)):
        found = condensates(history, VALVE, parameter="leak", estimator="output_error",
                            span_s=span_s)  # fmt: skip
        one = next(c for c in found if c.start_ns // (span_s * 10**9) == day)
        own = [e for e in whole if e.start_ns // (span_s * 10**9) == day]
        given = [e for e in own if e.status is not EstimateStatus.REFUSED]
        values = np.array([p.value for e in given for p in e.parameters if p.name == "leak"])
        assert (one.cycle, one.last_cycle) == (given[0].cycle, given[-1].cycle)
        assert (one.minimum, one.maximum) == (values.min(), values.max())
        assert one.mean == pytest.approx(values.mean(), rel=1e-14)
        assert one.median == pytest.approx(np.median(values), rel=1e-14)
        assert one.quantile_95 == pytest.approx(np.quantile(values, 0.95), rel=1e-14)
        assert one.usable == len(values)
    lost = condensates(history, VALVE, parameter="lost", estimator=OF_CYCLES)
    assert sum(c.count for c in lost) == 719
    assert sum(c.count * c.mean for c in lost) == pytest.approx(360.0)
    done = condensed(history, VALVE)
    assert done is not None
    assert (done.first_cycle, done.cycles, done.lost, done.samples) == (1, 719, 360, 719 * 800)
    assert done.estimates == 3 * 719


def test_old_hours_go_and_their_days_stay(history):
    condense(history, VALVE, Retention(cycles=200, hours_for_days=3.0))
    hours = condensates(history, VALVE, parameter="leak", estimator="output_error", span_s=HOUR_S)
    days = condensates(history, VALVE, parameter="leak", estimator="output_error")
    assert len(days) == 5
    assert 0 < len(hours) < 100
    store(history, 1000, 1001)
    condense(history, VALVE, Retention(cycles=200, hours_for_days=0.0))
    assert not condensates(history, VALVE, span_s=HOUR_S)
    assert len(condensates(history, VALVE, parameter="leak", estimator="output_error")) > 5


def test_days_count_from_the_newest_cycle_and_both_rules_keep(history):
    condense(history, VALVE, Retention(cycles=500, days=1.0))
    assert condensed_until(history, VALVE) == 431
    condense(history, VALVE, Retention(days=3.0))
    assert condensed_until(history, VALVE) == 431
    condense(history, VALVE, Retention(days=2.0))
    assert condensed_until(history, VALVE) == 575


def test_a_stamp_from_before_the_clock_was_set_lets_nothing_young_go(history):
    with history.writing(VALVE) as (connection, _):
        late = sa.update(CYCLE).where(CYCLE.c.cycle == 890)
        connection.execute(late.values(start_ns=0, end_ns=25 * 10**9))
    done = condense(history, VALVE, Retention(days=5.0))
    assert done is not None
    assert done.cycle == 143


@pytest.mark.parametrize("ahead", [1, 5])
def test_a_clock_that_ran_ahead_makes_no_cycle_older(history, ahead):
    """Stamps of the newest cycles lie ten years ahead."""
    with history.writing(VALVE) as (connection, _):
        newest = sa.update(CYCLE).where(CYCLE.c.cycle > 1000 - ahead)
        shift_ns = 3650 * 86_400 * 10**9
        connection.execute(newest.values(end_ns=CYCLE.c.end_ns + shift_ns))
    done = condense(history, VALVE, Retention(days=5.0))
    assert done is not None
    assert done.cycle == 143


def test_cycles_of_a_clock_ahead_of_this_machine_are_young(history, monkeypatch):
    now_ns = history.last_record(VALVE).end_ns - 5 * 86_400 * 10**9
    monkeypatch.setattr("time.time_ns", lambda: now_ns)
    assert condense(history, VALVE, Retention(days=5.0)) is None


def test_condensing_elsewhere_meanwhile_stops_it_and_nothing_said_changes(history):
    before = said(history)
    with History(history.where) as other:

        def elsewhere(_):
            condense(other, VALVE, Retention(cycles=400))

        with pytest.raises(StoreError, match="meanwhile"):
            condense(history, VALVE, KEEP, elsewhere)
    assert said(history) == before
    condense(history, VALVE, KEEP)
    assert said(history) == before


def test_remarks_are_never_touched(history):
    history.add_maintenance(VALVE, Maintenance(1, 100, "new seal", new_reference=True))
    history.add_verdict(VALVE, Verdict(1, VALVE, VerdictKind.OK, "ok", "fine", 150))
    before = history.maintenance(VALVE), history.verdicts(VALVE), history.log.events(VALVE)
    condense(history, VALVE, KEEP)
    after = history.maintenance(VALVE), history.verdicts(VALVE), history.log.events(VALVE)
    assert before == after
    assert all(before)


def test_a_condensed_cycle_is_never_stored_again(history):
    condense(history, VALVE, KEEP)
    with pytest.raises(CycleTakenError, match=r"cycle 719 .* or condensed"):
        history.store(VALVE, CycleRecord(719, 1, 2, 800))
    history.store(VALVE, CycleRecord(1001, 1001 * PERIOD_NS, 1001 * PERIOD_NS + 1, 800))
    assert history.last_cycle(VALVE) == 1001


def test_a_cycle_stored_late_meanwhile_stops_it_and_loses_nothing(history, monkeypatch):
    with history.writing(VALVE) as (connection, _):
        connection.execute(sa.delete(CYCLE).where(CYCLE.c.cycle == 5))

    def stored(state):
        with History(history.where) as other:
            other.store(VALVE, CycleRecord(5, 5 * PERIOD_NS, 5 * PERIOD_NS + 1, 800))
        return "x"

    monkeypatch.setattr(module, "state_text", stored)
    with pytest.raises(StoreError, match="meanwhile: try again"):
        condense(history, VALVE, KEEP)
    assert condensed_until(history, VALVE) == 0
    assert len(history.cycles(VALVE)) == 1000


def test_a_damaged_row_stays_and_is_named(history):
    with history.writing(VALVE) as (connection, _):
        connection.execute(ESTIMATE.update().where(ESTIMATE.c.id == 7).values(lag=3))
        connection.execute(CYCLE.update().where(CYCLE.c.cycle == 9).values(lost=3))
    condense(history, VALVE, KEEP)
    found = history.verify()
    assert len(found.damaged) == 2
    done = condensed(history, VALVE)
    assert done is not None
    assert done.cycles == 718


def test_check_sums_cover_condensates(history):
    condense(history, VALVE, KEEP)
    assert not history.verify().damaged
    with history.writing(VALVE) as (connection, _):
        connection.execute(CONDENSATE.update().where(CONDENSATE.c.id == 3).values(maximum=9.0))
        connection.execute(CONDENSED.update().values(lost=1))
    assert [line.split(":")[1] for line in history.verify().damaged] == [
        " table condensate, row 3, cycle 1",
        " table condensed, cycle 719",
    ]
    with pytest.raises(StoreError, match="is damaged: put the last backup in its place"):
        condense(history, VALVE, KEEP)


def test_a_state_of_another_version_is_made_anew_from_what_was_kept(history):
    before = said(history)
    condense(history, VALVE, KEEP)
    row = dict(history.select(sa.select(CONDENSED))[0])
    with history.writing(VALVE) as (connection, _):
        connection.execute(CONDENSED.update().values(sealed(CONDENSED, row | {"state": "x"})))
    assert said(history) == before


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (Retention(), "it is not said what is kept"),
        (Retention(cycles=-1), "are 0 to"),
        (Retention(cycles=10**30), "are 0 to"),
        (Retention(days=-1.0), "are 0 to"),
        (Retention(days=float("nan")), "are 0 to"),
        (Retention(cycles=1, hours_for_days=-1.0), "days for which hours are kept"),
    ],
)
def test_a_rule_that_says_nothing_is_refused(history, wrong, why):
    with pytest.raises(StoreError, match=why):
        condense(history, VALVE, wrong)


def test_nothing_is_condensed_of_a_young_or_unknown_valve(history):
    assert condense(history, "/none", KEEP) is None
    assert condense(history, VALVE, Retention(cycles=5000)) is None
    assert len(history.cycles(VALVE)) == 1000


def test_a_day_of_very_many_cycles_is_taken_in_parts(history, monkeypatch):
    monkeypatch.setattr(module, "A_TIME", 10)
    monkeypatch.setattr(module, "_MOST_OF_A_DAY", 100)
    before = said(history)
    condense(history, VALVE, KEEP)
    assert condensed_until(history, VALVE) == 719
    assert said(history) == before


def test_nothing_is_lost_when_it_is_killed_at_any_moment(history, root):
    """Kill it again and again; what is said of the valve and its cycles stay what they were."""
    file, before = history.where, said(history)
    history.close()
    command = [sys.executable, str(Path(__file__).parent / "kill_me.py"), str(file)]
    environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    random = np.random.default_rng(7)
    killed = 0
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        for keep in range(900, 200, -70):
            parent.stdin.write(f"{keep}\n")
            parent.stdin.flush()
            child = int(parent.stdout.readline())
            time.sleep(float(random.uniform(0.0, 0.12)))
            with suppress(ProcessLookupError):  # it may be done by now
                os.kill(child, signal.SIGKILL)
            killed += parent.stdout.readline().strip() == "killed"
            with History(file) as left:
                until, done = condensed_until(left, VALVE), condensed(left, VALVE)
                assert [c.cycle for c in left.cycles(VALVE)] == list(range(until + 1, 1001))
                assert (done.cycles if done else 0) == until
        parent.stdin.close()
    with History(file) as left:
        assert not left.verify().damaged
        assert said(left) == before
        condense(left, VALVE, KEEP)
        assert said(left) == before
    assert killed >= 3


def test_postgresql_condenses_as_sqlite_does(history, server):
    with History(server) as other:
        store(other, 1000)
        before = said(other)[1]
        condense(other, VALVE, KEEP)
        condense(history, VALVE, KEEP)
        assert said(other)[1] == before == said(history)[1]
        assert [repr(c) for c in condensates(other, VALVE)] == [
            repr(c) for c in condensates(history, VALVE)
        ]
        assert not other.verify().damaged
