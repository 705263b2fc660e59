# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Of a long history only what is new is read, and what is said of it is what all of it says."""

from dataclasses import replace

import numpy as np
import pytest
import sqlalchemy as sa

from valve_twin.bench.data.years import features, life
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.types import EstimateStatus, Maintenance
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.io.history.aging import reading
from valve_twin.io.history.aging.bulk import add_rows
from valve_twin.io.history.fleet import describe_valve
from valve_twin.io.history.store import CycleRecord, History

VALVE = "/v"
CONFIG = AgingConfig(max_candidates=60)


def store(path, estimates, valve=VALVE):
    with History(path) as history:
        for e in estimates:
            record = CycleRecord(e.cycle, e.start_ns, e.end_ns, 800)
            history.store(valve, record, [replace(e, estimator="whitened")])


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Keep what was read of short histories too, and read them by small pages."""
    monkeypatch.setattr(reading, "WORTH", 50)
    monkeypatch.setattr(reading, "PAGE", 64)
    monkeypatch.setattr(reading, "_NEW", 10)


@pytest.fixture
def path(tmp_path):
    store(tmp_path / "h.db", life(150))
    return tmp_path / "h.db"


@pytest.fixture
def read(monkeypatch):
    """Return a list that gets the cycle of each estimate that is read."""
    cycles: list[int] = []

    def counted(state, rows):
        cycles.extend(row["cycle"] for row in rows)
        add_rows(state, rows)

    monkeypatch.setattr(reading, "add_rows", counted)
    return cycles


@pytest.fixture(scope="module")
def sudden():
    """Return estimates and features of a press that leaks from cycle 121 on."""
    signature = next(s for s in MODEL.signatures().signatures if s.fault == "leak")
    shown = [*features(120), *features(30, 121, wrong=np.array(signature.change))]
    return list(zip(life(150), shown, strict=True))


def store_all(path, lived):
    with History(path) as history:
        for estimates in lived:
            e = estimates[0]
            history.store(VALVE, CycleRecord(e.cycle, e.start_ns, e.end_ns, 800), estimates)


def monitored(lived, events=()):
    """Return the verdict of one that gets the estimates as they come."""
    every = [e for estimates in lived for e in estimates]
    return assess(every, events, CONFIG, parameters=MODEL.parameters, valve=VALVE).verdict


def verdict_of(path):
    with History(path, read_only=True) as history:
        return describe_valve(history, VALVE, CONFIG).verdict


def test_a_sudden_fault_is_told_as_by_the_monitor(tmp_path, sudden):
    path = tmp_path / "h.db"
    words = []
    for first, last in ((0, 120), (120, 121), (121, 124), (124, 135), (135, 150)):
        store_all(path, sudden[first:last])
        verdict = verdict_of(path)
        assert verdict == monitored(sudden[:last])
        words.append((verdict.kind.text, verdict.fault))
    (kept,) = path.parent.glob("h.db-aging*")
    kept.unlink()
    assert verdict_of(path) == verdict
    assert words[0] == ("ok", "")
    assert words[2:] == [("valve", "leak")] * 3


def test_a_mark_ends_a_sudden_fault_also_where_it_was_read_before(tmp_path, sudden):
    path = tmp_path / "h.db"
    store_all(path, sudden)
    assert verdict_of(path).fault == "leak"
    event = Maintenance(stamp_ns=1, cycle=130, note="new seal", new_reference=True)
    with History(path) as history:
        history.add_maintenance(VALVE, event)
    verdict = verdict_of(path)
    assert verdict == monitored(sudden, (event,))
    assert not verdict.fault


def test_a_cycle_refused_by_another_estimator_counts_as_for_the_monitor(tmp_path, sudden):
    path = tmp_path / "h.db"
    refused = [
        (
            e,
            f,
            replace(
                e,
                estimator="whitened",
                used_by_trend=False,
                status=EstimateStatus.REFUSED,
                parameters=(),
                reason="the position does not belong to the commands",
                reason_code=RefusalCode.IMPLAUSIBLE.value,
            ),
        )
        for e, f in sudden[:60]
    ]
    store_all(path, refused)
    with History(path, read_only=True) as history:
        known = reading.read_known(history, VALVE, "press_cartridge", CONFIG)
    assert known.state.past().apart == tuple(range(1, 61))


def said(path):
    with History(path, read_only=True) as history:
        return repr(describe_valve(history, VALVE, CONFIG))


def anew(path):
    """Return what is said by one that kept nothing."""
    for kept in path.parent.glob(f"{path.name}-aging*"):
        kept.unlink()
    return said(path)


def test_what_was_read_is_not_read_again(path, read):
    first = said(path)
    assert read == list(range(1, 151))
    read.clear()
    assert said(path) == first
    assert not read
    store(path, life(20, 151))
    later = said(path)
    assert read == list(range(151, 171))
    assert later == anew(path)


def test_a_short_history_leaves_no_file(tmp_path):
    store(tmp_path / "h.db", life(20))
    said(tmp_path / "h.db")
    assert not list(tmp_path.glob("*aging*"))


def test_a_cycle_that_came_late_for_before_is_not_overlooked(path, read):
    said(path)
    store(path, life(20, 400))
    said(path)
    store(path, life(30, 300))
    read.clear()
    found = said(path)
    assert len(read) == 200
    assert found == anew(path)


def test_another_history_under_the_same_name_is_read_anew(path, read):
    said(path)
    for file in path.parent.glob("h.db*"):
        if "aging" not in file.name:
            file.unlink()
    store(path, [replace(e, mse_test=1.0) for e in life(160)])
    read.clear()
    found = said(path)
    assert len(read) == 160
    assert found == anew(path)


def test_cycles_of_another_valve_change_nothing(path, read):
    first = said(path)
    store(path, life(30), "/other")
    read.clear()
    assert said(path) == first
    assert not read


def test_maintenance_marked_for_a_cycle_before_is_not_overlooked(path, read):
    said(path)
    event = Maintenance(stamp_ns=1, cycle=70, note="new seal", new_reference=True)
    with History(path) as history:
        history.add_maintenance(VALVE, event)
    read.clear()
    found = said(path)
    assert len(read) == 150
    assert found == anew(path)


def test_beside_a_history_of_somebody_else_nothing_is_left(path, read, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: path.stat().st_uid + 1)
    first = said(path)
    assert not list(path.parent.glob("*aging*"))
    read.clear()
    assert said(path) == first
    assert len(read) == 150


def test_where_no_file_tells_its_user_nothing_is_left(path, read, monkeypatch):
    monkeypatch.delattr("os.geteuid")
    assert said(path)
    assert not list(path.parent.glob("*aging*"))


def test_what_cannot_be_kept_is_read_anew_without_a_word(path, read, recwarn):
    history_only = said(path)
    (kept,) = path.parent.glob("*-aging*")
    kept.unlink()
    kept.mkdir()
    read.clear()
    assert said(path) == history_only
    assert len(read) == 150
    assert not list(path.parent.glob(".*"))
    assert not recwarn.list


def test_a_damaged_file_is_replaced(path, read):
    first = said(path)
    (kept,) = path.parent.glob("*-aging*")
    kept.write_bytes(kept.read_bytes()[:-3])
    assert said(path) == first
    read.clear()
    assert said(path) == first
    assert not read


def test_a_damaged_row_is_left_out_as_ever(path, read):
    with sa.create_engine(f"sqlite:///{path}").begin() as connection:
        connection.execute(sa.text("UPDATE estimate SET mse_test = 5 WHERE cycle = 64"))
    first = said(path)
    assert 64 not in read
    read.clear()
    assert said(path) == first
    assert not read
