# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A history of the schema before the present one is upgraded whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import sqlalchemy as sa

from test.io.history.test_store import bits, both, record
from valve_twin.cli import main
from valve_twin.core.types import Maintenance
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import SCHEMA_TABLE, SCHEMA_VERSION

if TYPE_CHECKING:
    from collections.abc import Iterator

    Answers = list[tuple[int, str]]

UPGRADER = Path(__file__).with_name("upgrader.py")
VALVES = ("/a", "/b", "/c")
CYCLES = 4
ALL = str(CYCLES * len(VALVES))
BEFORE = "0010"
BACK = (
    "ALTER TABLE valve DROP COLUMN check_sum",
    f"UPDATE {SCHEMA_TABLE} SET version_num = '{BEFORE}'",
)
"""What makes a history of the schema before of one of the present schema."""


def fill(url: str) -> None:
    with History(url) as history:
        for valve in VALVES:
            for number in range(1, CYCLES + 1):
                history.store(valve, record(number), both(number))
            history.add_maintenance(valve, Maintenance(5, 2, "seal"))


@pytest.fixture(scope="module")
def old(tmp_path_factory):
    path = tmp_path_factory.mktemp("old") / "old.sqlite"
    fill(str(path))
    with closing(sqlite3.connect(path)) as connection, connection:
        for statement in BACK:
            connection.execute(statement)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")
    return path


@pytest.fixture
def file(old, tmp_path):
    return Path(shutil.copy(old, tmp_path / "history.sqlite"))


@pytest.fixture
def served(server):
    """Return the URL of a history of the schema before on a server, in a place of its own."""
    engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
    url = f"{server}&options=-csearch_path%3Dolder"
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP SCHEMA IF EXISTS older CASCADE")
        connection.exec_driver_sql("CREATE SCHEMA older")
    fill(url)
    with engine.begin() as connection:
        connection.exec_driver_sql("SET search_path = older")
        for statement in BACK:
            connection.exec_driver_sql(statement)
    yield url
    engine.dispose()


class Upgraders:
    """Programs that open a history, and may be killed on the way."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def open(self, url: object, *, kill_at: int = 0, largest: int = 0, count: int = 1) -> Answers:
        """Return the exit code of each and what it said."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([str(url), kill_at, largest, count]) + "\n")
        self._process.stdin.flush()
        return [(code, said) for code, said in json.loads(self._process.stdout.readline())]


@pytest.fixture(scope="module")
def upgraders(root: Path) -> Iterator[Upgraders]:
    environment = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, str(UPGRADER)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as process:
        yield Upgraders(process)
        process.kill()


def version(file: Path) -> str:
    with closing(sqlite3.connect(file)) as connection:
        return str(connection.execute(f"SELECT version_num FROM {SCHEMA_TABLE}").fetchone()[0])


def check_whole(url: object) -> None:
    """Open it here; all that was stored is there, as it was, and can be gone on with."""
    with History(str(url)) as history:
        assert history.valves() == list(VALVES)
        assert history.verify().damaged == []
        expected = [bits(e) for n in range(1, CYCLES + 1) for e in both(n)]
        for valve in VALVES:
            assert [bits(e) for e in history.estimates(valve)] == expected
            assert len(history.cycles(valve)) == CYCLES
            assert history.maintenance(valve) == [Maintenance(5, 2, "seal")]
        assert history.store(VALVES[0], record(CYCLES + 1), both(CYCLES + 1))


def kill_at_each(url: object, upgraders: Upgraders) -> int:
    """Kill a program at each statement of the upgrade in turn; return how many died."""
    for number in range(1, 100):
        ((code, said),) = upgraders.open(url, kill_at=number)
        if code == 0:
            assert said == ALL
            return number - 1
        assert code == -signal.SIGKILL
    msg = "it comes to no end"
    raise AssertionError(msg)


def test_killed_at_any_statement_the_next_one_finds_all(file, upgraders):
    assert kill_at_each(file, upgraders) >= 4
    assert version(file) == SCHEMA_VERSION
    check_whole(file)


def test_killed_on_a_server_too(served, upgraders):
    assert kill_at_each(served, upgraders) >= 4
    check_whole(served)


def test_on_a_full_disk_it_stays_what_it_was_and_says_why(file, upgraders):
    size, refused = file.stat().st_size, 0
    for largest in range(1, size + 200_000, 5003):
        ((code, said),) = upgraders.open(file, largest=largest)
        assert code == 0, (largest, said)
        if said == ALL:
            break
        assert said.startswith(f"refused: {file}: cannot be "), said
        assert len(said.splitlines()) == 1
        refused += 1
        assert version(file) == BEFORE
    assert refused > 4
    check_whole(file)


def test_by_several_at_once(file, upgraders):
    assert upgraders.open(file, count=6) == [(0, ALL)] * 6
    check_whole(file)


def test_by_several_at_once_on_a_server(served, upgraders):
    assert upgraders.open(served, count=6) == [(0, ALL)] * 6
    check_whole(served)


def test_beside_a_reader_who_sees_what_he_began_with(file, upgraders):
    with closing(sqlite3.connect(file)) as writer:
        writer.execute("PRAGMA journal_mode=WAL")
    with closing(sqlite3.connect(file, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        assert reader.execute("SELECT count(*) FROM cycle").fetchone() == (CYCLES * len(VALVES),)
        assert upgraders.open(file) == [(0, ALL)]
        assert reader.execute(f"SELECT version_num FROM {SCHEMA_TABLE}").fetchone() == (BEFORE,)
    check_whole(file)


def test_beside_a_reader_on_a_server_it_waits_says_so_and_goes_on_later(served, upgraders):
    engine = sa.create_engine(served.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as reader:
        reader.exec_driver_sql("SELECT count(*) FROM valve")
        ((code, said),) = upgraders.open(served)
        assert code == 0
        assert "another program holds a lock" in said
        assert len(said.splitlines()) == 1
    engine.dispose()
    check_whole(served)


@pytest.mark.parametrize("left_out", [1, 60, 200, 2000, 4095, 4096, 9000, 60_000, 10**9])
def test_of_a_copy_cut_short_nothing_false_is_shown(file, upgraders, left_out, capsys):
    whole = file.read_bytes()
    file.write_bytes(whole[:-left_out] or b"SQLite")
    ((code, said),) = upgraders.open(file)
    assert code == 0, said
    assert len(said.splitlines()) == 1
    if said != ALL:
        assert said.startswith(f"refused: {file}: "), said
    else:
        truth = {bits(e) for n in range(1, CYCLES + 1) for e in both(n)}
        with History(file, read_only=True) as history:
            assert set(history.valves()) <= set(VALVES)
            for valve in VALVES:
                assert {bits(e) for e in history.estimates(valve)} <= truth
    assert main(["history", "verify", "--url", str(file)]) == 1
    out, err = capsys.readouterr()
    assert str(file) in out + err
    assert "Traceback" not in err


def test_what_was_damaged_before_is_named_after_it(file, upgraders):
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("UPDATE estimate SET fit_test = 1.0 WHERE id = 3")
        connection.execute("UPDATE estimate SET fit_test = 1.0, check_sum = 0 WHERE id = 5")
    assert upgraders.open(file) == [(0, ALL)]
    with History(file, read_only=True) as history:
        assert len(history.verify().damaged) == 2


def test_of_rows_without_check_sums_what_cannot_be_read_is_named(file, upgraders):
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("UPDATE estimate SET parameters = '{' WHERE id = 3")
        connection.execute("ALTER TABLE maintenance DROP COLUMN withdrawn")
        connection.execute("ALTER TABLE maintenance DROP COLUMN withdrawn_note")
        for table in ("cycle", "estimate", "maintenance", "verdict"):
            connection.execute(f"ALTER TABLE {table} DROP COLUMN check_sum")
        for table in ("counters", "event", "condensate", "condensed"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute(f"UPDATE {SCHEMA_TABLE} SET version_num = '0006'")
    assert upgraders.open(file) == [(0, ALL)]
    with History(file, read_only=True) as history:
        (line,) = history.verify().damaged
        assert "table estimate, row 3, " in line
        assert sum(len(history.estimates(v)) for v in VALVES) == 2 * CYCLES * len(VALVES) - 1
