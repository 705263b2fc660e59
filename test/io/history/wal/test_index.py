# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The index of a log in use is truncated, deleted or replaced: no process dies, no row is lost."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.wal.index import IndexWatch, State

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

_OTHER = """
import logging, sys
logging.basicConfig(stream=sys.stderr)
from valve_twin.io.history.store import CycleRecord, History
path, valve = sys.argv[1:3]
with History(path, read_only=valve == "reader") as history:
    print("open", flush=True)
    for cycle, line in enumerate(sys.stdin, 1):
        if valve == "reader":
            print(len(history.cycles(line.strip())), flush=True)
        else:
            print(history.store(valve, CycleRecord(cycle, 0, cycle, 850)), flush=True)
"""


class Other:
    """A process of its own that stores a cycle, or reads, whenever it is asked."""

    def __init__(self, file: Path, valve: str) -> None:
        self.valve, self._errors = valve, Path(f"{file}.{valve.strip('/')}.log")
        with self._errors.open("w") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _OTHER, str(file), valve],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
        self.stored = 0
        self._answer()

    def store(self, times: int = 1) -> None:
        for _ in range(times):
            assert self.ask("") == "True"
            self.stored += 1

    def ask(self, line: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        return self._answer()

    def end(self) -> str:
        """End it; return what it logged."""
        self._process.communicate()
        assert self._process.returncode == 0, self._errors.read_text()
        return self._errors.read_text()

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        assert line, (self._process.wait(), self._errors.read_text())
        return line


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Callable[[str], Other]]:
    made: list[Other] = []

    def make(valve: str) -> Other:
        made.append(Other(tmp_path / "history.db", valve))
        return made[-1]

    yield make
    for one in made:
        one.kill()


def cut(index: Path, size_b: int) -> None:
    os.truncate(index, size_b)


def delete(index: Path, _: int) -> None:
    index.unlink()


def replace(index: Path, size_b: int) -> None:
    index.with_name("new").write_bytes(bytes(size_b))
    os.replace(index.with_name("new"), index)


HARM = [(cut, 0), (cut, 100), (delete, 0), (replace, 32768)]
IDS = [f"{harm.__name__}_{size_b}" for harm, size_b in HARM]


def require_all(file: Path, *others: Other) -> None:
    """Require of a database that nobody has open any more that it is whole and has all rows."""
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        names = connection.execute(
            "SELECT name FROM cycle JOIN valve ON valve.id = valve_id"
        ).fetchall()
    assert Counter(name for (name,) in names) == {o.valve: o.stored for o in others}
    with History(file, read_only=True) as history:
        assert history.verify().damaged == []


@pytest.mark.parametrize(("harm", "size_b"), HARM, ids=IDS)
def test_whoever_has_it_open_goes_on_and_says_so(harm, size_b, other, tmp_path):
    file, first, second = tmp_path / "history.db", other("/a"), other("/b")
    reader = other("reader")
    first.store(5)
    second.store(3)
    assert reader.ask("/a") == "5"
    harm(Path(f"{file}-shm"), size_b)
    assert reader.ask("/a") == "5"
    first.store(2)
    third = other("/c")
    third.store(2)
    second.store(2)
    first.store(2)
    assert reader.ask("/a") == "9"
    assert reader.ask("/b") == "5"
    told = "".join(one.end() for one in (first, second, third, reader))
    assert "its index (-shm) was" in told
    require_all(file, first, second, third)


@pytest.mark.parametrize("size_b", [136, 500, 5000])
def test_whoever_comes_next_restores_what_was_cut_behind_its_head(size_b, other, tmp_path):
    file, first = tmp_path / "history.db", other("/a")
    first.store(20)
    cut(Path(f"{file}-shm"), size_b)
    second = other("/b")  # SQLite makes it as long as it was, with nothing in it
    second.store(5)
    first.store(5)
    first.end()
    second.end()
    require_all(file, first, second)


@pytest.mark.parametrize("stays", [True, False])
@pytest.mark.parametrize(("harm", "size_b"), HARM[2:], ids=IDS[2:])
def test_what_a_newcomer_stored_meanwhile_is_kept(harm, size_b, stays, other, tmp_path):
    file, first = tmp_path / "history.db", other("/a")
    first.store(5)
    harm(Path(f"{file}-shm"), size_b)
    second = other("/b")
    second.store(4)
    if not stays:
        second.end()
    first.store(3)
    if stays:
        second.store(2)
        second.end()
    first.end()
    require_all(file, first, second)


def test_who_only_ends_takes_nothing_along(other, tmp_path):
    file, first = tmp_path / "history.db", other("/a")
    first.store(5)
    Path(f"{file}-shm").unlink()
    second = other("/b")
    second.store(4)
    second.kill()
    first.end()
    require_all(file, first, second)


def test_log_and_index_may_go_together(other, tmp_path):
    file, first = tmp_path / "history.db", other("/a")
    first.store(5)
    Path(f"{file}-shm").unlink()
    Path(f"{file}-wal").unlink()
    first.store(3)
    first.end()
    require_all(file, first)


def test_several_parts_of_a_process_give_the_old_one_up_before_there_is_a_new_one(tmp_path):
    file = tmp_path / "history.db"
    with History(file) as one, History(file) as two:
        one.store("/a", CycleRecord(1, 0, 1, 850))
        two.store("/b", CycleRecord(1, 0, 1, 850))
        Path(f"{file}-shm").unlink()
        with pytest.raises(StoreError, match="another part of this process uses the old one"):
            one.store("/a", CycleRecord(2, 0, 2, 850))
        assert two.store("/b", CycleRecord(2, 0, 2, 850))
        assert one.store("/a", CycleRecord(2, 0, 2, 850))
        assert [len(two.cycles(v)) for v in ("/a", "/b")] == [2, 2]


def test_who_may_not_write_the_folder_sees_twins_come_and_go(tmp_path, monkeypatch, caplog):
    file = tmp_path / "history.db"
    with History(file) as history:
        history.store("/a", CycleRecord(1, 0, 1, 850))
    monkeypatch.setattr("valve_twin.io.history.wal.watch._can_write", lambda _: False)
    with History(file, read_only=True) as reader:
        for cycle in range(2, 6):
            with History(file) as history:
                history.store("/a", CycleRecord(cycle, 0, cycle, 850))
                assert len(reader.cycles("/a")) == cycle
                assert not reader.moved
            if cycle > 3:
                assert len(reader.cycles("/a")) == cycle
    assert caplog.messages == []


def test_an_index_is_watched_from_when_it_is_used(tmp_path, caplog):
    file = tmp_path / "history.db"
    with History(file) as history:
        history.store("/a", CycleRecord(1, 0, 1, 850))
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")
    with History(file, read_only=True) as reader:
        for cycle in range(2, 5):
            with History(file) as history:
                assert not reader.moved
                history.store("/a", CycleRecord(cycle, 0, cycle, 850))
            assert not reader.moved
        assert len(reader.cycles("/a")) == 4
    assert caplog.messages == []


@pytest.mark.parametrize("read_only", [False, True])
def test_an_index_that_goes_while_it_is_opened_is_not_taken_for_the_next(
    read_only, other, tmp_path, monkeypatch, caplog
):
    file, first = tmp_path / "history.db", other("/a")
    first.store(2)
    adopt = IndexWatch.adopt

    def go_first(watch):
        monkeypatch.undo()
        Path(f"{file}-shm").unlink()
        first.store(2)  # it makes a new one
        adopt(watch)

    monkeypatch.setattr(IndexWatch, "adopt", go_first)
    with History(file, read_only=read_only) as history:
        assert len(history.cycles("/a")) == 4
        first.store(3)
        assert len(history.cycles("/a")) == 7
    first.end()
    require_all(file, first)
    assert [m for m in caplog.messages if "was deleted or replaced" in m]


def test_what_is_open_can_be_read_and_closed_where_the_folder_cannot_be_looked_at(
    tmp_path, monkeypatch
):
    file = tmp_path / "history.db"
    history = History(file)
    history.store("/a", CycleRecord(1, 0, 1, 850))
    real = os.stat

    def refuse(path, *args, **kwargs):
        if str(path).startswith(str(file)):
            raise PermissionError(13, "Permission denied")
        return real(path, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", refuse)
        assert len(history.cycles("/a")) == 1
        with pytest.raises(StoreError, match="Permission denied"):
            history.store("/a", CycleRecord(2, 0, 2, 850))
        history.close()
    with History(file) as history:
        assert history.store("/a", CycleRecord(2, 0, 2, 850))


@pytest.mark.parametrize("left", [0, 32768, 40000])
def test_an_index_of_many_parts_is_as_long_as_before(left, tmp_path):
    file = tmp_path / "a.db"
    with closing(sqlite3.connect(file, isolation_level=None)) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA wal_autocheckpoint=0")
        connection.execute("CREATE TABLE cycle (text TEXT)")
        watch = IndexWatch(f"{file}-wal")
        rows = [("x" * 9000,) for _ in range(2500)]
        connection.execute("BEGIN")
        connection.executemany("INSERT INTO cycle VALUES (?)", rows)
        connection.execute("COMMIT")
        watch.adopt()
        assert watch.state() is State.SOUND
        size_b = os.stat(f"{file}-shm").st_size
        assert size_b > 40000
        os.truncate(f"{file}-shm", left)
        assert watch.state() is State.CUT
        watch.restore()
        assert watch.state() is State.SOUND
        assert os.stat(f"{file}-shm").st_size == size_b
        assert connection.execute("SELECT count(*) FROM cycle").fetchone() == (len(rows),)
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)


_FOREIGN = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1])
print(connection.execute("SELECT count(*) FROM cycle").fetchone()[0])
"""


@pytest.mark.parametrize("left_b", [0, 136, 5000, 20_000])
@pytest.mark.parametrize("opens", ["the writer", "a new process"])
def test_an_index_that_another_program_met_cut_is_told_and_nothing_is_lost(
    left_b, opens, tmp_path, caplog
):
    """It makes it as long again: zeros stood for frames, and every cycle of the log was lost."""
    file = tmp_path / "h.sqlite"
    with History(file) as history:
        for cycle in range(1, 40):
            history.store("/v", CycleRecord(cycle, 0, cycle, 850))
        os.truncate(f"{file}-shm", left_b)
        shown = subprocess.run(
            [sys.executable, "-c", _FOREIGN, file], capture_output=True, text=True, check=False
        )
        assert os.stat(f"{file}-shm").st_size == 32768
        if opens == "a new process":
            done = subprocess.run(
                [sys.executable, "-c", _READ, file], capture_output=True, text=True, check=True
            )
            assert done.stdout.strip() == "39"
        assert history.store("/v", CycleRecord(40, 0, 40, 850))
        told = [*history.notices, *caplog.messages]
    assert shown.stdout.strip() in {"39", ""}
    if opens == "the writer" and left_b:
        assert any("its index (-shm) was truncated" in text for text in told)
    with History(file, read_only=True) as history:
        assert [c.cycle for c in history.cycles("/v")] == list(range(1, 41))
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)


_READ = """
import sys
from valve_twin.io.history.store import History
with History(sys.argv[1], read_only=True) as history:
    print(len(history.cycles("/v")))
"""


def test_a_look_at_a_sound_index_finds_every_frame(tmp_path):
    """Also while it grows over a region, is taken in, and begins anew."""
    file = tmp_path / "h.sqlite"
    with History(file) as history, closing(sqlite3.connect(file)) as other:
        watch = IndexWatch(f"{file}-wal")
        watch.adopt()
        other.execute("CREATE TABLE filled (x)")
        other.execute("PRAGMA wal_autocheckpoint = 100000")
        for turn in range(12):
            other.execute("INSERT INTO filled VALUES (zeroblob(3500000))")
            other.commit()
            assert watch.state() is State.SOUND
            assert not watch._lacks_frames()
            if turn in {5, 9}:
                other.execute("PRAGMA wal_checkpoint(RESTART)")
                assert not watch._lacks_frames()
        assert os.stat(f"{file}-shm").st_size > 32768
        assert history.store("/v", CycleRecord(1, 0, 1, 850))


@pytest.mark.skipif(sys.platform != "linux", reason="an index is looked at on Linux")
def test_a_history_that_is_opened_often_keeps_no_index_of_before_open(tmp_path):
    """Each opening kept a deleted index open for good: after a thousand none was possible."""
    with History(tmp_path / "held.sqlite") as held:
        held.store("/v", CycleRecord(1, 0, 1, 850))
        for number in range(25):
            with History(tmp_path / "h.sqlite") as history:
                history.store("/v", CycleRecord(number + 1, 0, number + 1, 850))
        files = [os.path.realpath(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")]
        assert sum(str(tmp_path / "h.sqlite") in file for file in files) <= 12
        with closing(sqlite3.connect(tmp_path / "held.sqlite", timeout=0.0)) as other:
            assert held.store("/v", CycleRecord(2, 0, 2, 850))  # its locks are what they were
            assert other.execute("SELECT count(*) FROM cycle").fetchone() == (2,)
