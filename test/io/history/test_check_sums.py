# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import sqlite3
from contextlib import closing

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.types import Estimate, EstimateStatus, Maintenance, ParameterStatus
from valve_twin.core.types import ParameterValue as Value
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import SEALED
from valve_twin.io.history.store import CycleRecord, History
from valve_twin.io.history.tables import CONDENSATE, CONDENSED, COUNTERS, EVENT, UNSUMMED

VALVE = "/press/valve_1"
CYCLES = 12
ROWS = 2 * CYCLES + 3


def estimate(cycle):
    values = (Value("K_in", 0.1 * cycle, ParameterStatus.OK, "", 1e-3, -0.0, 1 / 3),)
    return Estimate(
        "press_cartridge", "oe", cycle, 0, cycle, values, EstimateStatus.ACCEPTED, "good",
        mse_test=float("nan"), fit_test=97.0,
    )  # fmt: skip


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "history.sqlite"
    with History(path) as history:
        for cycle in range(1, CYCLES + 1):
            history.store(VALVE, CycleRecord(cycle, 0, cycle, 850), [estimate(cycle)])
        history.add_maintenance(VALVE, Maintenance(5, 3, "new seal", new_reference=True))
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")
    return path


def change(path, text):
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(text)


def test_a_sound_history_is_verified(file, capsys):
    assert main(["history", "verify", "--url", str(file)]) == 0
    assert capsys.readouterr().out == f"{ROWS} rows, 0 damaged\n"


@pytest.mark.parametrize(
    ("text", "table"),
    [
        ("UPDATE cycle SET samples = 851 WHERE cycle = 7", "cycle"),
        ("UPDATE cycle SET cycle = 70 WHERE cycle = 7", "cycle"),
        ("UPDATE estimate SET fit_test = 97.5 WHERE cycle = 7", "estimate"),
        ("UPDATE estimate SET mse_test = 0.0 WHERE cycle = 7", "estimate"),
        ("UPDATE estimate SET parameters = replace(parameters, '0.7', '0.8')", "estimate"),
        ("UPDATE estimate SET reason = CAST(x'ff' AS TEXT) WHERE cycle = 7", "estimate"),
        ("UPDATE maintenance SET note = 'old seal'", "maintenance"),
        ("UPDATE estimate SET check_sum = 1 WHERE cycle = 7", "estimate"),
    ],
)
def test_a_changed_row_is_named_and_never_shown(text, table, file, capsys, caplog):
    change(file, text)
    assert main(["history", "verify", "--url", str(file)]) == 1
    out = capsys.readouterr().out
    assert f"table {table}, " in out
    assert f"{ROWS} rows, 1 damaged" in out
    with History(file, read_only=True) as history:
        cycles = [c.cycle for c in history.cycles(VALVE)]
        estimates = [e.cycle for e in history.estimates(VALVE)]
        events = history.maintenance(VALVE)
    left = {"cycle": cycles, "estimate": estimates}
    for name, numbers in left.items():
        wanted = [n for n in range(1, CYCLES + 1) if n != 7 or name != table]
        assert numbers == wanted
    assert len(events) == (table != "maintenance")
    assert f"table {table}, " in caplog.text


def test_the_rows_of_an_older_history_are_sealed_when_it_is_upgraded(file):
    with closing(sqlite3.connect(file)) as connection, connection:
        later = {COUNTERS, EVENT, CONDENSATE, CONDENSED}  # which the older version did not have
        for table in later:
            connection.execute(f"DROP TABLE {table.name}")
        for table in set(SEALED) - later:
            connection.execute(f"ALTER TABLE {table.name} DROP COLUMN check_sum")
        connection.execute("ALTER TABLE valve DROP COLUMN check_sum")
        for name in UNSUMMED["maintenance"]:
            connection.execute(f"ALTER TABLE maintenance DROP COLUMN {name}")
        connection.execute("UPDATE valve_twin_schema SET version_num = '0006'")
    with History(file) as history:
        found = history.verify()
        assert (found.rows, found.damaged) == (ROWS - 1, [])
        assert history.estimates(VALVE)[6].fit_test == 97.0


def test_a_flipped_byte_of_the_file_is_never_shown(file, caplog):
    sound = file.read_bytes()
    with History(file, read_only=True) as history:
        truth = {e.cycle: e for e in history.estimates(VALVE)}
        records = {c.cycle: c for c in history.cycles(VALVE)}
    rng = np.random.default_rng(3)
    named = refused = 0
    for _ in range(400):
        data = bytearray(sound)
        data[int(rng.integers(100, len(data)))] ^= 1 << int(rng.integers(8))
        file.write_bytes(data)
        caplog.clear()
        try:
            with History(file, read_only=True) as history:
                estimates = history.estimates(VALVE)
                cycles = history.cycles(VALVE)
                assert set(history.valves()) <= {VALVE}
        except StoreError:
            refused += 1
            continue
        assert all(truth[e.cycle] == e for e in estimates)
        assert all(records[c.cycle] == c for c in cycles)
        named += bool(caplog.text)
    assert named
    assert refused


def test_a_row_whose_check_sum_is_zero_is_named_as_any_other(file):
    change(file, "UPDATE estimate SET check_sum = 0 WHERE cycle = 7")
    with History(file, read_only=True) as history:
        assert 7 not in [e.cycle for e in history.estimates(VALVE)]
        assert len(history.verify().damaged) == 1


def test_a_page_goes_on_behind_damaged_rows_and_their_numbers_stay_taken(file):
    change(file, "UPDATE estimate SET fit_test = 1.5 WHERE cycle IN (2, 3, 4)")
    change(file, f"UPDATE cycle SET samples = 1 WHERE cycle >= {CYCLES - 1}")
    with History(file, read_only=True) as history:
        page = history.estimates(VALVE, limit=3)
        assert [e.cycle for e in page] == [1, 5, 6]
        assert [c.cycle for c in history.cycles(VALVE, limit=CYCLES)] == list(range(1, CYCLES - 1))
        assert history.last_cycle(VALVE) == CYCLES
        record = history.last_record(VALVE)
        assert record is not None
        assert record.cycle == CYCLES - 2
