# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rows that pass the layers above SQLite's driver are those that SQLAlchemy writes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import sqlalchemy as sa

from valve_twin.core.types import Estimate, EstimateStatus, ParameterStatus, ParameterValue
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.database import Database
from valve_twin.io.history.insert import Insert
from valve_twin.io.history.tables import CYCLE, ESTIMATE, VALVE, CycleRecord, estimate_row, to_row

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sqlalchemy.engine import Connection


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    found = Database(str(tmp_path / "h.db"))
    yield found
    found.close()


def stored(connection: Connection, table: sa.Table) -> list[tuple[Any, ...]]:
    """Return the rows without their keys, each value with its type in the file."""
    names = [c.name for c in table.columns if c.name != "id"]
    shown = ", ".join(f"{n}, typeof({n})" for n in names)
    found = connection.exec_driver_sql(f"SELECT {shown} FROM {table.name} ORDER BY rowid")
    return [tuple(row) for row in found]


def rows_of(table: sa.Table) -> list[dict[str, Any]]:
    if table is CYCLE:
        records = (
            CycleRecord(1, 10**18, 2 * 10**18, 850),
            CycleRecord(2, 0, 1, 2, 3, -1, False, "stöße: 'none'; \u221e", False, "1.0"),
        )
        return [to_row(record, 1) for record in records]
    parameter = ParameterValue("K_in", np.nan, ParameterStatus.AT_BOUND, "rests on 0")
    estimates = (
        Estimate(
            "press", "a", 1, 0, 2**62, (parameter,), EstimateStatus.PARTIAL, "x", mse_test=1 / 3
        ),
        Estimate("press", "b", 1, 0, 1, (), EstimateStatus.ACCEPTED, "", fit_test=np.float64(1.5)),
    )
    return [estimate_row(1, i, e) for i, e in enumerate(estimates)]


@pytest.mark.parametrize("table", [CYCLE, ESTIMATE], ids=lambda t: t.name)
def test_the_rows_are_those_of_sqlalchemy(database: Database, table: sa.Table) -> None:
    rows, found = rows_of(table), []
    complete = [sealed(table, row) for row in rows]
    insert, named = Insert(database, table), Insert(database, VALVE)
    for write in (insert, lambda c, _: c.execute(table.insert(), complete)):
        with database.write() as connection:
            for old in (table, VALVE):
                connection.execute(old.delete())
            named(connection, [{"name": "/v"}])
            connection.execute(sa.update(VALVE).values(id=1))
            write(connection, rows)
            found.append(stored(connection, table))
    assert found[0] == found[1]
    assert len(found[0]) == len(rows)


def test_rows_whose_key_is_taken_stay_and_are_not_counted(database: Database) -> None:
    first, second = rows_of(CYCLE)
    insert = Insert(database, CYCLE, skip_taken=True)
    with database.write() as connection:
        Insert(database, VALVE)(connection, [{"name": "/v"}])
        assert insert(connection, [first]) == 1
        assert insert(connection, [first | {"samples": 1}, second]) == 1
        assert connection.scalars(sa.select(CYCLE.c.samples)).all() == [850, 2]
