# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Inserts that are compiled once; with SQLite they pass all layers above its driver."""

from __future__ import annotations

import sqlite3
from importlib import import_module
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.tables import (
    CHECK_SUM,
    CONDENSED,
    CYCLE,
    ESTIMATE,
    estimate_row,
    to_row,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sqlalchemy.engine import Connection

    from valve_twin.core.types import Estimate
    from valve_twin.io.history.database import Database
    from valve_twin.io.history.tables import CycleRecord


class Insert:
    """The way of each cycle to the disk: 0.8 of the time that SQLAlchemy takes with SQLite.

    Parameters
    ----------
    database : Database
        Where to.
    table : Table
        Of rows that give every column but the table's own key `id` and the check sum.
    skip_taken : bool
        Leave rows alone whose key is taken.
    """

    def __init__(self, database: Database, table: sa.Table, *, skip_taken: bool = False) -> None:
        kind = "sqlite" if database.is_sqlite else "postgresql"  # that one is slow to import
        insert = import_module(f"sqlalchemy.dialects.{kind}").insert(table)
        if skip_taken:
            insert = insert.on_conflict_do_nothing()
        self._table = table
        self._statement = insert.execution_options(preserve_rowcount=True)
        names = [c.name for c in table.columns if c.name != "id"]
        compiled = self._statement.compile(database.engine, column_keys=names)
        self._text = str(compiled) if database.is_sqlite else ""

    def __call__(self, connection: Connection, rows: list[dict[str, Any]]) -> int:
        """Insert rows in the running transaction; return how many were inserted."""
        if CHECK_SUM in self._table.c:
            rows = [sealed(self._table, row) for row in rows]
        if not self._text:
            return connection.execute(self._statement, rows).rowcount
        driver = connection.connection.driver_connection
        assert isinstance(driver, sqlite3.Connection)
        return driver.executemany(self._text, rows).rowcount


def check_estimates(record: CycleRecord, estimates: Sequence[Estimate]) -> None:
    """Raise ValueError where an estimate is of another cycle or an estimator occurs twice."""
    for estimate in estimates:
        if estimate.cycle != record.cycle:
            msg = f"estimate of cycle {estimate.cycle} given with cycle {record.cycle}"
            raise ValueError(msg)
    names = [e.estimator for e in estimates]
    if len(set(names)) != len(names):
        msg = f"cycle {record.cycle} has an estimator twice: {names}"
        raise ValueError(msg)


_CONDENSED = sa.select(CONDENSED.c.cycle).where(CONDENSED.c.valve_id == sa.bindparam("valve"))
_CONDENSED_TEXT = "SELECT cycle FROM condensed WHERE valve_id = ?"


def is_condensed(connection: Connection, valve_id: int, cycle: int) -> bool:
    """Return whether a valve's cycles are condensed up to this one or further.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction.
    valve_id, cycle : int
        Key of the valve's row in table `valve`, and number of the cycle [1].
    """
    driver = connection.connection.driver_connection
    if isinstance(driver, sqlite3.Connection):  # 3 us instead of 50
        until = next(driver.execute(_CONDENSED_TEXT, (valve_id,)), (None,))[0]
    else:
        until = connection.scalar(_CONDENSED, {"valve": valve_id})
    return until is not None and cycle <= until


def is_stored(
    read: Callable[[sa.Select[Any]], Sequence[Mapping[str, Any]]],
    valve_id: int,
    record: CycleRecord,
    estimates: Sequence[Estimate],
) -> bool:
    """Return whether exactly this cycle is stored.

    Parameters
    ----------
    read : callable
        Returns the rows of a query.
    valve_id : int
        Key of the valve's row in table `valve`.
    record : CycleRecord
        The cycle; a row is there under its number, or it is condensed.
    estimates : sequence of Estimate
        One an estimator.
    """
    row = to_row(record, valve_id)
    rows = [estimate_row(valve_id, i, e) for i, e in enumerate(estimates)]
    key = {"valve_id": valve_id, "cycle": row["cycle"]}
    stored = next(iter(read(sa.select(CYCLE).filter_by(**key))), None)
    if stored is None or any(
        stored[name] != value for name, value in row.items() if name != "software"
    ):
        return False
    kept = read(sa.select(ESTIMATE).filter_by(**key).order_by(ESTIMATE.c.position))
    return len(kept) == len(rows) and all(
        old[name] == value
        for old, new in zip(kept, rows, strict=True)
        for name, value in new.items()
    )
