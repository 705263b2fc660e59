# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The log of a database in use is truncated: it is noticed, and written back."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from valve_twin.io.history.wal import copy as copies
from valve_twin.io.history.wal.copy import LogCopy
from valve_twin.io.history.wal.frames import read_index

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.io.history.wal.frames import Index


class Written:
    """A database that is written to, and the copy of its log."""

    def __init__(self, file: Path) -> None:
        self.file, self.log = file, f"{file}-wal"
        self.connection = sqlite3.connect(file, isolation_level=None)
        self.connection.execute("PRAGMA journal_mode=WAL")
        self.connection.execute("CREATE TABLE cycle (text TEXT)")
        self.copy = LogCopy(self.log)
        assert self.copy.is_whole()

    def write(self, size: int = 5000) -> None:
        self.connection.execute("INSERT INTO cycle VALUES (?)", ("x" * size,))

    def rows(self) -> int:
        """Count what another program finds, after it has looked through all pages."""
        with closing(sqlite3.connect(self.file)) as other:
            assert other.execute("PRAGMA integrity_check").fetchone() == ("ok",)
            return int(other.execute("SELECT count(*) FROM cycle").fetchone()[0])


@pytest.fixture
def written(tmp_path: Path) -> Iterator[Written]:
    found = Written(tmp_path / "a.db")
    yield found
    found.copy.close()
    found.connection.close()


def test_the_copy_is_the_log_through_many_that_are_taken_in(written: Written):
    for _ in range(1500):  # 6 MB: more than a log
        written.write()
        assert written.copy.is_whole(grown=True)
    content = written.copy.content
    assert 100_000 < len(content) < 6_000_000
    assert Path(written.log).read_bytes()[: len(content)] == content


@pytest.mark.parametrize("left", [0, 10, 32, 5000, -100, -4120], ids=str)
@pytest.mark.parametrize("on", [0, 1, 3], ids=lambda n: f"{n}_more")
def test_a_cut_is_noticed_and_written_back(written: Written, left: int, on: int):
    for _ in range(10):
        written.write()
        assert written.copy.is_whole(grown=True)
    os.truncate(written.log, left if left >= 0 else os.stat(written.log).st_size + left)
    for _ in range(on):
        written.write()
    assert not written.copy.is_whole()
    assert written.copy.restore()
    assert written.copy.is_whole()
    assert written.rows() == 10 + on


def test_a_cut_before_what_was_just_written_was_seen_is_no_growth(written: Written):
    written.write()
    assert written.copy.is_whole(grown=True)
    known = os.stat(written.log).st_size
    written.write()
    os.truncate(written.log, known)
    assert not written.copy.is_whole(grown=True)
    assert not written.copy.restore()  # nobody has it
    assert len(written.copy.content) == known


@pytest.mark.parametrize("mode", ["PASSIVE", "FULL", "RESTART", "TRUNCATE"])
def test_a_log_that_another_program_took_in_is_whole(written: Written, mode: str):
    for _ in range(3):
        written.write()
        assert written.copy.is_whole(grown=True)
        with closing(sqlite3.connect(written.file)) as other:
            other.execute(f"PRAGMA wal_checkpoint({mode})")
        assert written.copy.is_whole()
    assert written.rows() == 3


def test_a_transaction_that_is_taken_back_is_no_loss(written: Written):
    written.connection.execute("PRAGMA cache_size=2")  # spills into the log before the end
    for end in ("ROLLBACK", "COMMIT", "ROLLBACK", "COMMIT"):
        written.connection.execute("BEGIN")
        for _ in range(30):
            written.write()
        assert written.copy.is_whole()
        written.connection.execute(end)
        assert written.copy.is_whole(grown=end == "COMMIT")
    assert written.rows() == 60


def test_what_is_written_by_another_program_is_taken_in(written: Written):
    with closing(sqlite3.connect(written.file, isolation_level=None)) as other:
        for _ in range(5):
            other.execute("INSERT INTO cycle VALUES ('y')")
            written.write()
            assert written.copy.is_whole(grown=True)
        os.truncate(written.log, 0)
        assert not written.copy.is_whole()
        assert written.copy.restore()
    assert written.rows() == 10


def test_the_index_names_the_frames_in_force(written: Written):
    written.write()
    index = read_index(written.log)
    assert index is not None
    assert 32 + index.frames * (24 + 4096) == os.stat(written.log).st_size
    assert written.copy.is_whole(grown=True)
    assert index.salts == written.copy.content[16:24]
    assert read_index(f"{written.file}none-wal") is None


def test_a_log_longer_than_what_is_kept_is_whole_until_it_is_cut(
    written: Written, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(copies, "MOST_B", 300_000)
    with closing(sqlite3.connect(written.file, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM cycle").fetchone()  # the log cannot be taken in
        for _ in range(100):
            written.write(20_000)  # many frames at once
            assert written.copy.is_whole(grown=True)
        assert len(written.copy.content) <= 300_000 < os.stat(written.log).st_size
        os.truncate(written.log, os.stat(written.log).st_size - 5000)
        assert not written.copy.is_whole(grown=True)
        assert not written.copy.restore()


@pytest.mark.parametrize("mode", ["RESTART", "TRUNCATE"])
def test_a_log_that_is_begun_anew_while_it_is_read_is_whole(
    written: Written, monkeypatch: pytest.MonkeyPatch, mode: str
):
    for _ in range(5):
        written.write()
    assert written.copy.is_whole(grown=True)
    overtaken: list[Index | None] = []

    def read_and_be_overtaken(log: str) -> Index | None:
        index = read_index(log)
        if not overtaken:
            overtaken.append(index)
            written.connection.execute(f"PRAGMA wal_checkpoint({mode})")
            written.write()
        return index

    monkeypatch.setattr(copies, "read_index", read_and_be_overtaken)
    assert written.copy.is_whole(grown=True)  # nothing grew since, as it seems
    assert overtaken
    assert written.rows() == 6


def test_nobody_writes_while_a_log_is_written_back(
    written: Written, monkeypatch: pytest.MonkeyPatch
):
    written.write()
    assert written.copy.is_whole(grown=True)
    overtaken: list[Index | None] = []

    def read_and_be_overtaken(log: str) -> Index | None:
        with closing(sqlite3.connect(written.file, timeout=0)) as other:
            with pytest.raises(sqlite3.OperationalError, match="locked"):
                other.execute("BEGIN IMMEDIATE")
            assert other.execute("PRAGMA wal_checkpoint(RESTART)").fetchone()[0] == 1
            overtaken.append(read_index(log))
        return overtaken[-1]

    monkeypatch.setattr(copies, "read_index", read_and_be_overtaken)
    assert written.copy.restore()
    assert overtaken
    monkeypatch.undo()
    assert written.copy.is_whole()
    assert written.rows() == 1


def test_what_a_killed_writer_left_is_not_written_over_what_came_after(written: Written):
    written.write()
    assert written.copy.is_whole(grown=True)
    end, index = os.stat(written.log).st_size, Path(f"{written.file}-shm").read_bytes()[:96]
    written.write()
    assert written.copy.is_whole(grown=True)  # knows a transaction whose writer then dies
    shm = os.open(f"{written.file}-shm", os.O_RDWR)
    os.pwrite(shm, index, 0)
    written.connection.execute("INSERT INTO cycle VALUES ('of another one')")
    os.pwrite(written_log := os.open(written.log, os.O_RDWR), b"\0" * 32, 0)
    log = os.pread(written_log, 1 << 20, 0)
    assert not written.copy.is_whole()
    assert written.copy.restore()
    assert os.pread(written_log, 1 << 20, 0)[end:] == log[end:]
    assert written.connection.execute("SELECT max(text) FROM cycle").fetchone()[0][0] == "x"
    assert written.rows() == 2
    os.close(written_log)
    os.close(shm)
