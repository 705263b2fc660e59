# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Who reads a history is told where it is condensed, and never reads half of each."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sa

from test.io.history.tiers.test_condense import KEEP, VALVE, store
from valve_twin.cli import main
from valve_twin.core.aging.config import AgingConfig
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.tables import CONDENSATE, CYCLE, ESTIMATE, to_row
from valve_twin.io.history.tiers import condense as module
from valve_twin.io.history.tiers.condense import condense
from valve_twin.io.history.tiers.extent import condensed, condensed_until
from valve_twin.io.history.tiers.reading import condensates, counted, undisturbed
from valve_twin.io.history.tiers.retention import Retention
from valve_twin.report.build import history_data
from valve_twin.report.page import render_report
from valve_twin.report.provenance.inputs import history_origin


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(module, "LEAST", 100)


@pytest.fixture
def history(tmp_path):
    with History(tmp_path / "h.db") as found:
        store(found, 600)
        yield found


def test_what_is_read_while_cycles_are_condensed_is_read_again(history):
    read: list[list[int]] = []

    def reading():
        first = [e.cycle for e in history.estimates(VALVE, "beside", limit=1)]
        if not read:
            condense(history, VALVE, KEEP)
        read.append(first)
        return first, next(c.cycle for c in history.cycles(VALVE))

    assert undisturbed(history, VALVE, reading) == ([288], 288)
    assert read == [[1], [288]]


def test_cycles_count_though_they_are_condensed(history):
    whole = counted(None, history.cycles(VALVE), 1200)
    done = condense(history, VALVE, KEEP)
    assert done is not None
    rest = history.cycles(VALVE)
    assert counted(done, rest, 1200 - done.estimates) == whole
    assert counted(None, []).cycles == 0


def test_the_report_counts_draws_and_names_them(history):
    before = history_data(history, VALVE, AgingConfig())
    condense(history, VALVE, KEEP)
    after = history_data(history, VALVE, AgingConfig())
    assert replace(before.totals, estimates=861) == after.totals
    page, old = render_report(after), render_report(before)
    assert "Cycles 1 to 287 are condensed to hours and days: of their 861 estimates" in page
    assert "Cycles 1 to 600, from" in page
    assert 'class="condensed"' in page
    assert "least to greatest of condensed cycles" in page
    assert 'class="condensed"' not in old
    kinds = history_origin(after).parts.keys() - history_origin(before).parts.keys()
    assert kinds == {"condensed cycles"}


def test_lines_of_the_verb_say_what_is_condensed(history, capsys):
    where = history.where
    history.close()
    assert main(["history", "condense", "--url", where, "--keep-cycles", "200"]) == 0
    assert f"{VALVE}: last cycle 600; cycles 1 to 287 are condensed" in capsys.readouterr().err
    assert main(["history", "list", "--url", where]) == 0
    assert "cycles 1 to 287 are condensed to hours and days" in capsys.readouterr().out
    assert main(["history", "verify", "--url", where]) == 0
    assert main(["history", "condense", "--url", where]) != 0
    assert "it is not said what is kept" in capsys.readouterr().err
    none = Path(where).with_name("none.db")
    assert main(["history", "condense", "--url", str(none), "--keep-cycles", "200"]) != 0
    assert "there is no such file" in capsys.readouterr().err
    assert not none.exists()


def test_an_export_holds_them(history, tmp_path):
    condense(history, VALVE, KEEP)
    history.export(tmp_path / "out")
    lines = (tmp_path / "out" / "condensates.csv").read_text().splitlines()
    assert lines[0].startswith("valve,span_s,start_ns,end_ns,cycle,last_cycle,estimator,parameter")
    spans = [len(condensates(history, VALVE, span_s=s)) for s in (3600, 86400)]
    assert len(lines) == 1 + sum(spans)
    assert '"kind": "condensate"' in (tmp_path / "out" / "history.jsonl").read_text()


def test_a_backup_holds_them(history, tmp_path):
    condense(history, VALVE, KEEP)
    with History(history.backup(tmp_path / "copy.db"), read_only=True) as copy:
        assert condensed(copy, VALVE) == condensed(history, VALVE)
        assert condensates(copy, VALVE) == condensates(history, VALVE)


def test_a_new_file_in_its_place_gets_them_too(history, tmp_path):
    condense(history, VALVE, KEEP)
    done, days = condensed(history, VALVE), condensates(history, VALVE)
    kept = [(e.cycle, e.estimator) for e in history.estimates(VALVE)]
    file = Path(history.where)
    with History(tmp_path / "new.db"):
        pass
    shutil.move(tmp_path / "new.db", file)
    history.store(VALVE, CycleRecord(601, 601 * 10**12, 601 * 10**12 + 1, 800))
    assert condensed(history, VALVE) == done
    assert condensates(history, VALVE) == days
    assert [(e.cycle, e.estimator) for e in history.estimates(VALVE)] == kept
    assert [c.cycle for c in history.cycles(VALVE)] == list(range(288, 602))
    assert not history.verify().damaged


def test_a_condensed_copy_in_its_place_gets_only_what_came_since(history, tmp_path):
    copy = history.backup(tmp_path / "copy.db")
    with History(copy) as other:
        condense(other, VALVE, Retention(cycles=200))
    shutil.move(copy, history.where)
    history.store(VALVE, CycleRecord(601, 601 * 10**12, 601 * 10**12 + 1, 800))
    assert condensed_until(history, VALVE) == 287
    assert [c.cycle for c in history.cycles(VALVE)] == list(range(288, 602))


def refused_on_page(history):
    page = render_report(history_data(history, VALVE, AgingConfig(max_candidates=60)))
    listed = re.findall(r"the newest (\d+) of ((?:at least )?\d+)", page)
    return re.findall(r"((?:at least )?\d+) refused", page)[0], listed


def test_refused_cycles_count_though_they_are_condensed(history):
    rough = replace(history.cycles(VALVE)[-1], cycle=601, accepted=False, reason="cut off")
    history.store(VALVE, rough, [])
    assert refused_on_page(history) == ("13", [])
    condense(history, VALVE, KEEP)
    kept = sum(c.cycle % 50 == 0 for c in history.cycles(VALVE)) + 1
    assert refused_on_page(history) == ("13", [(str(kept), "13")])
    history.store(VALVE, replace(rough, cycle=602), [])
    assert refused_on_page(history)[0] == "14"


def without_refused(history):
    """Leave a condensed history as an older version left it."""
    with history.writing(VALVE) as (connection, _):
        connection.execute(sa.delete(CONDENSATE).where(CONDENSATE.c.parameter == "refused"))


def test_refused_cycles_that_an_older_version_condensed_are_no_exact_number(history):
    condense(history, VALVE, KEEP)
    without_refused(history)
    kept = str(sum(c.cycle % 50 == 0 for c in history.cycles(VALVE)))
    assert refused_on_page(history) == (f"at least {kept}", [(kept, f"at least {kept}")])


def test_days_of_an_older_version_stay_counted_beside_those_of_now(history):
    """Of its days what was not accepted counts, of others all that nothing was learnt from."""
    rough = replace(history.cycles(VALVE)[6], accepted=False, reason="cut off")
    with history.writing(VALVE) as (connection, valve_id):
        row = to_row(rough, valve_id)
        connection.execute(sa.delete(CYCLE).where(CYCLE.c.cycle == 7))
        connection.execute(CYCLE.insert(), sealed(CYCLE, row))
    condense(history, VALVE, KEEP)
    without_refused(history)
    store(history, 600, 601)
    before = refused_on_page(history)[0]
    assert before == "at least 20"
    condense(history, VALVE, KEEP)
    assert refused_on_page(history)[0] == before


def test_a_page_claims_no_sound_past_that_an_older_version_condensed(history):
    condense(history, VALVE, KEEP)
    without_refused(history)
    for table in (CYCLE, ESTIMATE):
        with history.writing(VALVE) as (connection, _):
            connection.execute(sa.delete(table).where(table.c.cycle % 50 == 0))
    page = render_report(history_data(history, VALVE, AgingConfig(max_candidates=60)))
    assert "No cycle was refused." not in page
    assert "No cycle was refused since those that are condensed; of some of these" in page
