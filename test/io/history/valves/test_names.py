# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import sqlite3
from contextlib import closing

import pytest
import sqlalchemy as sa

from valve_twin.cli import main
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleRecord, History

VALVE, OTHER = "/press/valve_1", "/press/valve_0"
CYCLES = 5


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "history.sqlite"
    with History(path) as history:
        for cycle in range(1, CYCLES + 1):
            history.store(VALVE, CycleRecord(cycle, 0, cycle, 850))
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")
    return path


def change(path, text):
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(text)


def none_is_found_as(valve, file):
    """Rename the valve past its check sum; return whether nothing is found under the new name."""
    change(file, f"UPDATE valve SET name = '{valve}'")
    with History(file, read_only=True) as history:
        return not (history.cycles(valve) or history.estimates(valve) or history.last_cycle(valve))


def test_no_byte_turns_one_valve_into_another(file, tmp_path, capsys, caplog):
    assert none_is_found_as(OTHER, file)
    assert "table valve, row 1: " in caplog.text
    with History(file) as history:
        assert history.valves() == []
        assert history.marks() == ({}, [1])
        assert [c.cycle for c in history.cycles(VALVE)] == list(range(1, CYCLES + 1))
        assert history.store(VALVE, CycleRecord(CYCLES + 1, 0, CYCLES + 1, 850))
        with pytest.raises(StoreError, match="stands where another valve stood"):
            history.store(OTHER, CycleRecord(1, 0, 1, 850))
        exported = history.export(tmp_path / "csv")
    assert all(OTHER not in path.read_text() for path in exported)
    capsys.readouterr()
    assert main(["history", "verify", "--url", str(file)]) == 1
    assert f"'{OTHER}' is not its name" in capsys.readouterr().out


def test_a_key_that_changed_turns_no_valve_into_another(file, caplog):
    with History(file) as history:
        history.store(OTHER, CycleRecord(1, 0, 1, 850))
    change(file, "UPDATE valve SET id = 3 - id + 10")
    change(file, "UPDATE valve SET id = id - 10")
    with History(file, read_only=True) as history:
        assert history.valves() == []
        assert history.cycles(VALVE) == history.cycles(OTHER) == []
    assert caplog.text.count("table valve, row ") == 2


def test_whichever_byte_of_a_name_changes_its_rows_are_found_and_it_is_named(file, capsys):
    sound, name = file.read_bytes(), VALVE.encode()
    places = [i for i in range(len(sound)) if sound.startswith(name, i)]
    assert len(places) == 2  # the table and the index of names
    for at in [place + i for place in places for i in range(len(name))]:
        data = bytearray(sound)
        data[at] ^= 1
        file.write_bytes(data)
        assert main(["history", "verify", "--url", str(file)]) == 1
        assert "index" in capsys.readouterr().out
        with History(file, read_only=True) as history:
            assert [c.cycle for c in history.cycles(VALVE)] == list(range(1, CYCLES + 1))
            assert set(history.valves()) <= {VALVE}


def test_names_of_an_older_history_are_sealed_when_it_is_upgraded(file):
    change(file, "ALTER TABLE valve DROP COLUMN check_sum")
    change(file, "UPDATE valve_twin_schema SET version_num = '0010'")
    with History(file) as history:
        assert history.valves() == [VALVE]
    assert none_is_found_as(OTHER, file)
    with History(file) as history:
        assert len(history.cycles(VALVE)) == CYCLES


def test_a_name_from_a_twin_of_before_is_believed(file):
    change(file, "UPDATE valve SET check_sum = 0")
    with History(file) as history:
        assert history.valves() == [VALVE]
        assert len(history.cycles(VALVE)) == CYCLES
        assert history.verify().damaged == []


def test_a_server_finds_rows_by_their_proof(server):
    engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"))
    with History(server) as history:
        for cycle in range(1, CYCLES + 1):
            history.store(VALVE, CycleRecord(cycle, 0, cycle, 850))
        with engine.begin() as connection:
            connection.execute(sa.text(f"UPDATE valve SET name = '{OTHER}'"))
        assert history.valves() == []
        assert history.cycles(OTHER) == []
        assert len(history.cycles(VALVE)) == CYCLES
        with pytest.raises(StoreError, match="stands where another valve stood"):
            history.store(OTHER, CycleRecord(1, 0, 1, 850))
        assert len(history.verify().damaged) == 1
    engine.dispose()
