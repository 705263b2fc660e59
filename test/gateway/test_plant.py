# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Many look at one history: it is opened once, and one look does not keep the others waiting."""

from __future__ import annotations

import json
import os
import sqlite3
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from starlette.requests import Request

from test.gateway.test_web import store
from test.io.history.test_fleet import estimate, record
from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.gateway import first_reading
from valve_twin.gateway import plant as module
from valve_twin.gateway.first_reading import WAITING
from valve_twin.gateway.live.told import Told
from valve_twin.gateway.plant import Plant
from valve_twin.gateway.view import LastCycle
from valve_twin.gateway.web import Site, _Pages
from valve_twin.io.errors import StoreError
from valve_twin.io.history.database import Database
from valve_twin.io.history.fleet import describe_valve, ranked
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from valve_twin.core.aging.config import AgingConfig

VALUES = {"K_in": 0.01, "K_out": 0.045, "leak": 1e-3}
PAUSES = {name: getattr(module, name) for name in ("REFRESH_S", "RETRY_S", "REST")}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    made = tmp_path / "history.sqlite"
    store(made, "/a", range(1, 4), 0.0)
    store(made, "/b", range(1, 4), 0.0)
    return made


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    for name in (*PAUSES, "BRIEF_S"):
        monkeypatch.setattr(module, name, 0.0)
    monkeypatch.setattr(module, "WAIT_S", 60.0)


def test_the_file_is_checked_once_however_often_it_is_looked_at(path, monkeypatch):
    checks = []
    check = Database._check_content

    def told(*given):
        checks.append(given)
        check(*given)

    monkeypatch.setattr(Database, "_check_content", told)
    plant = Plant(str(path))
    for _ in range(5):
        assert not plant.view().failure
    assert len(checks) == 1


def test_only_a_valve_with_something_new_is_assessed(path, monkeypatch):
    assessed = []
    describe = describe_valve

    def told(history, valve, rules):
        assessed.append(valve)
        return describe(history, valve, rules)

    monkeypatch.setattr(module, "describe_valve", told)
    plant = Plant(str(path))
    plant.view()
    store(path, "/b", range(4, 5), 0.0)
    view = plant.view()
    assert assessed == ["/a", "/b", "/b"]
    assert {row.valve: row.cycle for row in view.rows} == {"/a": 3, "/b": 4}


def test_who_looks_while_another_reads_sees_what_there_was(path, monkeypatch):
    plant = Plant(str(path))
    before = plant.view()
    store(path, "/b", range(4, 5), 0.0)
    reached, go_on = threading.Event(), threading.Event()
    describe = describe_valve

    def slow(*given):
        reached.set()
        assert go_on.wait(30)
        return describe(*given)

    monkeypatch.setattr(module, "describe_valve", slow)
    monkeypatch.setattr(module, "WAIT_S", 0.01)
    reader = threading.Thread(target=plant.view)
    reader.start()
    assert reached.wait(30)
    assert plant.view() is before
    go_on.set()
    reader.join(30)
    monkeypatch.undo()
    row = plant.view().row("/b")
    assert row is not None
    assert row.cycle == 4


def test_a_file_put_in_its_place_is_opened_anew(path, tmp_path):
    plant = Plant(str(path))
    assert plant.page("/a")
    other = tmp_path / "other.sqlite"
    store(other, "/c", range(1, 3), 0.0)
    with sqlite3.connect(other) as raw:
        raw.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    other.replace(path)
    assert [row.valve for row in plant.view().rows] == ["/c"]
    assert plant.page("/a") is None
    path.unlink()
    view = plant.view()
    assert "no such file" in view.failure
    assert [row.valve for row in view.rows] == ["/c"]


def test_a_history_that_goes_and_comes_back_is_told_once_each(path, monkeypatch, caplog):
    monkeypatch.setattr(module, "RETRY_S", 0.0)
    plant = Plant(str(path))
    assert not plant.view().failure
    aside = path.rename(path.with_name("aside"))
    for _ in range(3):
        assert "no such file" in plant.view().failure
    aside.rename(path)
    assert not plant.view().failure
    told = [r.getMessage() for r in caplog.records]
    assert told == [
        f"{path}: cannot be opened: there is no such file: check the path; what was read before "
        "is shown meanwhile",
        f"{path}: is read again",
    ]


def test_a_single_failed_reading_is_passed_over_and_the_next_one_in_a_row_is_told(
    path, monkeypatch, caplog
):
    """Of one reading that failed every device of Sparkplug died, for a second."""
    monkeypatch.setattr(module, "BRIEF_S", 60.0)
    plant = Plant(str(path))
    aside = path.with_name("aside")
    for _ in range(2):
        before = plant.view()
        path.rename(aside)
        assert plant.view() is before
        aside.rename(path)
        assert not plant.view().failure
    assert not caplog.records
    path.rename(aside)
    assert not plant.view().failure
    assert "no such file" in plant.view().failure
    assert "no such file" in plant.view().failure
    assert len(caplog.records) == 1


def test_what_is_passed_over_is_told_once_what_is_shown_is_old(path, monkeypatch):
    """Of a large file, checked anew at length, it was shown as live until the next reading."""
    monkeypatch.setattr(module, "BRIEF_S", 60.0)
    plant = Plant(str(path))
    plant.view()
    monkeypatch.setattr(module, "RETRY_S", 600.0)
    path.rename(path.with_name("aside"))
    assert not plant.view().failure
    plant._read_s -= 61.0
    for found in (plant.view(), plant.news(), plant.glance()):
        assert "no such file" in found.failure
        assert [row.valve for row in found.rows] == ["/a", "/b"]


def test_a_valve_of_a_history_whose_failed_opening_is_passed_over_is_none_unknown(
    path, monkeypatch
):
    """Its report was none (404), where it said why the history cannot be read."""
    monkeypatch.setattr(module, "BRIEF_S", 60.0)
    plant = Plant(str(path))
    assert plant.page("/a")
    monkeypatch.setattr(module, "RETRY_S", 600.0)
    other = path.with_name("other")
    other.write_bytes(b"no database" * 5000)
    other.replace(path)
    assert not plant.view().failure
    for ask in (plant.page, plant.details, plant.first_cycle):
        with pytest.raises(StoreError, match="is not a database"):
            ask("/a")


def test_a_failed_reading_behind_an_old_one_is_told_at_once(path, monkeypatch):
    monkeypatch.setattr(module, "BRIEF_S", 60.0)
    plant = Plant(str(path))
    plant.view()
    plant._read_s -= 61.0  # nobody has looked since
    path.rename(path.with_name("aside"))
    assert "no such file" in plant.view().failure


def test_a_log_that_is_deleted_is_let_go_for_the_twin_to_make_another(path, caplog):
    """What was deleted stayed open: the twin had mended it, and nothing could be read any more."""
    with History(path) as twin:
        twin.store("/a", record(4), (estimate(4, VALUES),))
        plant = Plant(str(path))
        assert {r.valve: r.cycle for r in plant.view().rows}["/a"] == 4
        Path(f"{path}-wal").unlink()
        lost = plant.view()
        assert "its write-ahead log (-wal) was deleted or cut: a twin that w" in lost.failure
        assert {r.valve: r.cycle for r in lost.rows}["/a"] == 4
        twin.store("/a", record(5), (estimate(5, VALUES),))
        back = plant.view()
        assert not back.failure
        assert {r.valve: r.cycle for r in back.rows}["/a"] == 5
    assert len(caplog.records) == 2


def test_a_history_that_cannot_be_read_is_let_go_for_whoever_mends_it(path, monkeypatch):
    """The files of a cut log stayed in use, so that nobody could begin a new one."""
    store(path, "/a", range(4, 5), 0.0)
    plant = Plant(str(path))
    plant.view()
    store(path, "/a", range(5, 8), 0.0)
    os.truncate(f"{path}-wal", 0)
    for _ in range(module.MOST_TRIES):
        assert "disk I/O error" in plant.view().failure
    with pytest.raises(StoreError, match="I/O error"):
        plant.estimates("/a", 1, 10)
    store(path, "/a", range(5, 7), 0.0)
    assert {r.valve: r.cycle for r in plant.view().rows}["/a"] == 6
    assert not plant.view().failure


def test_a_history_that_is_not_there_yet_is_told_by_who_waits_for_it(path, caplog):
    aside = path.rename(path.with_name("aside"))
    plant = Plant(str(path), waits=True)
    for _ in range(3):
        assert "no such file" in plant.view().failure
    aside.rename(path)
    assert len(plant.view().rows) == 2
    assert [r.getMessage() for r in caplog.records] == [
        f"{path}: cannot be opened: there is no such file: check the path; waiting",
        f"{path}: is read",
    ]


def test_a_valve_that_cannot_be_assessed_says_so_and_spoils_no_other(path, monkeypatch):
    describe = describe_valve

    def broken(history: History, valve: str, rules: AgingConfig):
        if valve == "/a":
            raise KeyError(valve)
        return describe(history, valve, rules)

    monkeypatch.setattr(module, "describe_valve", broken)
    view = Plant(str(path)).view()
    assert not view.failure
    rows = {row.valve: row for row in view.rows}
    assert "cannot be assessed (KeyError" in rows["/a"].evidence
    assert rows["/b"].cycle == 3


def test_a_damaged_value_is_the_valves_own(path):
    with sqlite3.connect(path) as raw:
        raw.execute("UPDATE cycle SET start_ns = x'00' WHERE valve_id = 1")
    rows = {row.valve: row for row in Plant(str(path)).view().rows}
    assert rows["/b"].cycle == 3
    assert len(rows) == 2


def test_who_comes_during_the_first_reading_is_not_told_that_there_is_nothing(path, monkeypatch):
    monkeypatch.setattr(module, "WAIT_S", 0.0)
    plant = Plant(str(path))
    reached, go_on = threading.Event(), threading.Event()
    describe = describe_valve

    def slow(*given):
        reached.set()
        assert go_on.wait(60.0)
        return describe(*given)

    monkeypatch.setattr(module, "describe_valve", slow)
    seen: list[int] = []
    first, second = (
        threading.Thread(target=lambda: seen.append(len(plant.view().rows))) for _ in range(2)
    )
    first.start()
    assert reached.wait(60.0)
    second.start()
    second.join(0.2)
    assert seen == []
    go_on.set()
    first.join(60.0)
    second.join(60.0)
    assert seen == [2, 2]


def test_a_machine_without_a_thread_to_spare_shows_what_there_was(path, monkeypatch):
    plant = Plant(str(path))
    before = plant.view()

    def none(_: threading.Thread) -> None:
        msg = "can't start new thread"
        raise RuntimeError(msg)

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", none)
        assert plant.view() is before
    assert plant.view().rows == before.rows
    assert not plant._reading.locked()


def test_a_history_that_does_not_answer_any_more_is_told(path, monkeypatch):
    plant = Plant(str(path))
    before = plant.view()
    monkeypatch.setattr(module, "WAIT_S", 0.0)
    monkeypatch.setattr(module, "LATE_S", 0.05)
    store(path, "/b", range(4, 5), 0.0)
    go_on = threading.Event()
    describe = describe_valve

    def slow(*given):
        assert go_on.wait(60.0)
        return describe(*given)

    monkeypatch.setattr(module, "describe_valve", slow)
    end = time.monotonic() + 60.0
    while not (late := plant.view()).failure:
        assert time.monotonic() < end
    assert late.rows == before.rows
    assert "history.sqlite: does not answer for " in late.failure
    go_on.set()
    while [row.cycle for row in plant.view().rows if row.valve == "/b"] != [4]:
        assert time.monotonic() < end
    assert not plant.view().failure


def test_who_looks_during_a_long_first_reading_sees_what_there_is(path, monkeypatch):
    turn = threading.Event()
    found = Plant._state

    def slow(plant: Plant, history, valve: str, mark):
        turn.wait(30.0)
        return found(plant, history, valve, mark)

    monkeypatch.setattr(Plant, "_state", slow)
    plant = Plant(f"sqlite:///{path}")
    begun = plant.glance()
    assert not begun.whole
    assert len(begun.rows) >= 1
    assert {row.evidence for row in begun.rows} == {WAITING}
    turn.set()
    whole = plant.view()
    assert whole.whole
    assert plant.glance().rows == whole.rows
    assert WAITING not in {row.evidence for row in whole.rows}


def test_every_page_shows_what_a_first_reading_has_and_does_not_look_whole(path, monkeypatch):
    reached, go_on = threading.Event(), threading.Event()
    found = Plant._state

    def slow(plant: Plant, history, valve: str, mark):
        if valve == "/b":
            reached.set()
            assert go_on.wait(60.0)
        return found(plant, history, valve, mark)

    monkeypatch.setattr(Plant, "_state", slow)
    plant = Plant(str(path), nameplates={"/a": {"tag": "XV-7"}})
    pages = _Pages(plant, Site())

    def ask(name: str = "") -> Request:
        return Request({"type": "http", "method": "GET", "path": "/", "root_path": "",
                        "path_params": {"name": name}, "query_string": b"", "headers": [],
                        "scheme": "http", "server": ("127.0.0.1", 1)})  # fmt: skip

    try:
        plant.glance()
        assert reached.wait(60.0)
        told = json.loads(bytes(pages.valves(ask()).body))
        assert told["whole"] is False
        of = {valve["valve"]: valve for valve in told["valves"]}
        assert [p["parameter"] for p in of["/a"]["parameters"]] == ["K_in", "K_out", "leak"]
        assert of["/a"]["nameplate"] == {"tag": "XV-7"}
        assert of["/b"]["evidence"] == WAITING
        assert json.loads(bytes(pages.one(ask("b")).body))["evidence"] == WAITING
        metrics = bytes(pages.metrics(ask()).body).decode()
        assert "valve_twin_history_whole 0.0" in metrics
        assert 'valve="/a"' in metrics
        assert 'valve="/b"' not in metrics
        assert "<svg" in bytes(pages.valve(ask("a")).body).decode()
        assert WAITING in bytes(pages.valve(ask("b")).body).decode()
        assert pages.valve(ask("nobody")).status_code == 404
        assert pages.report(ask("a")).status_code == 200
        assert pages.health(ask()).status_code == 200
        monkeypatch.setattr(module, "LATE_S", 0.0)
        assert "does not answer" in plant.glance().failure  # stuck at a valve is told, too
        monkeypatch.setattr(module, "LATE_S", 30.0)
    finally:
        go_on.set()
    assert pages.report(ask("b")).status_code == 200  # waits for its turn
    metrics = bytes(pages.metrics(ask()).body).decode()
    assert "valve_twin_history_whole 1.0" in metrics
    assert 'valve="/b"' in metrics


def test_a_first_reading_ranks_for_who_looks_and_not_for_every_valve(path, monkeypatch):
    reached, go_on = threading.Semaphore(0), threading.Semaphore(0)
    found, rank, sizes = Plant._state, ranked, list[int]()

    def slow(plant: Plant, history, valve: str, mark):
        reached.release()
        assert go_on.acquire(timeout=60.0)
        return found(plant, history, valve, mark)

    def told(rows, order):
        sizes.append(len(rows))
        return rank(rows, order)

    monkeypatch.setattr(Plant, "_state", slow)
    monkeypatch.setattr(first_reading, "ranked", told)
    monkeypatch.setattr(module, "REFRESH_S", 60.0)
    for valve in ("/c", "/d"):
        store(path, valve, range(1, 2), 0.0)
    plant = Plant(str(path))
    assert plant.where == str(path)
    assert plant.news().rows == ()
    for looks in (0, 3, 0, 1):
        assert reached.acquire(timeout=60.0)
        shown = [plant.glance() for _ in range(looks)]
        assert len({id(view) for view in shown}) == min(looks, 1)
        assert plant.news() is module._NOTHING
        go_on.release()
    assert plant.view().whole
    assert plant.news().whole
    assert sizes == [4, 4, 4]  # for the three looks at once, the one, and the end


def test_a_first_reading_that_goes_on_is_waited_for_however_long(path, monkeypatch):
    found, go_on, looks = Plant._state, threading.Event(), list[float]()

    def slow(plant: Plant, history, valve: str, mark):
        assert go_on.wait(60.0)
        return found(plant, history, valve, mark)

    def now_s() -> float:  # a clock on which it is never late
        looks.append(0.0)
        if len(looks) > 20:
            go_on.set()
        return 0.0

    monkeypatch.setattr(Plant, "_state", slow)
    clock = SimpleNamespace(monotonic=now_s, thread_time=time.thread_time, time_ns=time.time_ns)
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(module, "LATE_S", 0.01)
    assert len(Plant(str(path)).view().rows) == 2
    assert go_on.is_set()


def test_a_first_glance_without_a_thread_to_be_had_reads_itself(path, monkeypatch):
    def refuse(_: threading.Thread) -> None:
        msg = "can't start new thread"
        raise RuntimeError(msg)

    plant = Plant(str(path))
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", refuse)
        assert len(plant.glance().rows) == 2
    assert not plant._reading.locked()
    assert len(plant.view().rows) == 2


def test_a_first_reading_that_fails_keeps_what_was_assessed(path, monkeypatch):
    assessed, broken, later = list[str](), ["/b"], threading.Event()
    found = Plant._state

    def fails_once(plant: Plant, history: History, valve: str, mark):
        kept = plant._states.get(valve)
        if valve in broken:
            broken.remove(valve)
            msg = "history.sqlite: disk I/O error"
            raise StoreError(msg)
        if valve == "/b":
            assert later.wait(60.0)
        state = found(plant, history, valve, mark)
        if state is not kept:
            assessed.append(valve)
        return state

    monkeypatch.setattr(Plant, "_state", fails_once)
    monkeypatch.setattr(module, "WAIT_S", 0.05)
    plant = Plant(str(path))
    failed = plant.view()
    assert "disk I/O error" in failed.failure
    assert {row.valve: row.evidence == WAITING for row in failed.rows} == {"/a": False, "/b": True}
    again = plant.glance()  # begins the next reading, which has what the first one had
    assert {row.valve: row.evidence == WAITING for row in again.rows} == {"/a": False, "/b": True}
    assert plant.news().rows == ()  # of faces that tell changes: nothing before all are known
    assert not plant.news().whole
    later.set()
    whole = plant.view()
    assert whole.whole
    assert not whole.failure
    assert assessed == ["/a", "/b"]
    assert plant.news().rows == whole.rows


def test_a_history_that_goes_away_during_a_first_reading_leaves_what_was_assessed(
    path, monkeypatch
):
    found, where = Plant._state, path.with_suffix(".away")

    def moves_away(plant: Plant, history: History, valve: str, mark):
        if valve == "/b":
            path.rename(where)
            msg = "history.sqlite: disk I/O error"
            raise StoreError(msg)
        return found(plant, history, valve, mark)

    with monkeypatch.context() as patch:
        patch.setattr(Plant, "_state", moves_away)
        plant = Plant(str(path))
        assert "disk I/O error" in plant.view().failure
    gone = plant.view()
    assert "no such file" in gone.failure
    assert [row.valve for row in gone.rows if row.evidence != WAITING] == ["/a"]
    where.rename(path)
    assert plant.page("/b")  # is waited for
    assert plant.view().whole


def test_a_history_that_was_locked_is_read_again_a_second_after_its_release(path, monkeypatch):
    for name, pause in PAUSES.items():
        monkeypatch.setattr(module, name, pause)
    now_s = [100.0]
    clock = SimpleNamespace(
        monotonic=lambda: now_s[0], thread_time=time.thread_time, time_ns=time.time_ns
    )
    monkeypatch.setattr(module, "time", clock)
    plant = Plant(str(path))
    assert not plant.view().failure
    store(path, "/b", range(4, 5), 0.0)

    def locked(*_):
        now_s[0] += 5.0  # who waits for a lock needs no processor
        msg = "the database is locked"
        raise StoreError(msg)

    with monkeypatch.context() as patch:
        patch.setattr(module, "describe_valve", locked)
        now_s[0] += 10.0
        assert "locked" in plant.view().failure
    now_s[0] += module.RETRY_S
    view = plant.view()
    row = view.row("/b")
    assert row is not None
    assert (view.failure, row.cycle) == ("", 4)


def test_every_face_gets_what_the_topics_say_and_what_is_stored_keeps_its_number(path):
    told = Told({"/a": "press_cartridge"})
    plant = Plant(str(path), told=told)
    stored = plant.view().row("/a")
    assert stored is not None
    told.judge("/a", Verdict(1, "/a", VerdictKind.SENSOR, "sensor", "it freezes", 9))
    told.close_cycle("/a", LastCycle(9))
    for look in (plant.glance, plant.news, plant.view):
        view = look()
        row = view.row("/a")
        assert row is not None
        assert (row.evidence, row.cycle) == ("it freezes", stored.cycle)  # faces read up to it
        other = view.row("/b")
        assert other is not None
        assert other == plant._states["/b"][1].row
    told.judge("/a", None)
    assert plant.view().row("/a") == stored
