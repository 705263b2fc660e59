# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Copies of the history: for safe keeping (one SQLite file), for other programs (CSV, JSON).

Files appear complete or not at all: they are written beside their place and renamed.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import os
import sqlite3
from contextlib import closing
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.types import EstimateStatus, ParameterStatus
from valve_twin.io.errors import StoreError
from valve_twin.io.history.database import Database
from valve_twin.io.history.tables import (
    CYCLE,
    ESTIMATE,
    MAINTENANCE,
    METADATA,
    VALVE,
    row_estimate,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sqlalchemy.engine import Connection

    from valve_twin.core.types import Condition, Disagreement, Guard

_PAGE = 1000
"""Rows copied at a time."""


def default_backup_path(database: Database) -> Path:
    """Return a name that is free: the database's with the time (UTC) in it."""
    stem = database.file or Path(f"{database.url.database or 'history'}.db")
    moment = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    names = (
        stem.with_name(f"{stem.stem}-{moment}{tail}{stem.suffix}")
        for tail in ("", *map("-{}".format, range(2, 99)))
    )
    return next(name for name in names if not name.exists())


def back_up_sqlite(database: Database, target: Path) -> None:
    """Copy a SQLite database page by page while others write to it.

    Raises
    ------
    StoreError
        If the target exists or cannot be written.
    """
    part = _part(target)
    try:
        with database.errors("backed up"), database.engine.connect() as connection:
            source = connection.connection.driver_connection
            assert isinstance(source, sqlite3.Connection)
            with _Writing(target), closing(sqlite3.connect(part)) as copy:
                source.backup(copy)
                _seal(copy, target)
        _move(part, target)
    finally:
        part.unlink(missing_ok=True)


def copy_to_sqlite(database: Database, target: Path) -> None:
    """Copy any database into a SQLite file, row by row, all from one state.

    Raises
    ------
    StoreError
        If the target exists or cannot be written.
    """
    part = _part(target)
    try:
        copy = Database(str(part))
        with database.read() as source, copy.write() as sink:
            for table in METADATA.sorted_tables:
                sink.execute(table.delete())
                rows = (
                    source.execution_options(yield_per=_PAGE).execute(sa.select(table)).mappings()
                )
                for page in rows.partitions(_PAGE):
                    sink.execute(table.insert(), [dict(row) for row in page])
        copy.close()
        with _Writing(target), closing(sqlite3.connect(part)) as connection:
            _seal(connection, target)
        _move(part, target)
    finally:
        for tail in ("", "-wal", "-shm"):
            Path(f"{part}{tail}").unlink(missing_ok=True)


def export_files(database: Database, folder: Path) -> list[Path]:
    """Write the files of `History.export`, all from one state of the database."""
    writers = {
        "cycles.csv": _write_cycles,
        "estimates.csv": _write_estimates,
        "maintenance.csv": _write_maintenance,
        "history.jsonl": _write_json_lines,
    }
    with database.read() as connection, _Writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, write in writers.items():
            part = folder / f".{name}.part"
            try:
                write(connection, part)
                os.replace(part, folder / name)
            finally:
                part.unlink(missing_ok=True)
    return [folder / name for name in writers]


class _Writing:
    """Turn the system's errors about a target into one line."""

    def __init__(self, target: Path) -> None:
        self._target = target

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: object, err: BaseException | None, __: object) -> None:
        if isinstance(err, (OSError, sqlite3.Error)):
            why = err.strerror if isinstance(err, OSError) and err.strerror else str(err)
            msg = (
                f"{self._target}: cannot be written: {why}: check the folder, its access rights"
                " and the free space"
            )
            raise StoreError(msg) from err


def _part(target: Path) -> Path:
    if target.exists():
        msg = f"{target}: exists already and is not overwritten: name another file"
        raise StoreError(msg)
    return target.with_name(f".{target.name}.{os.getpid()}.part")


def _seal(copy: sqlite3.Connection, target: Path) -> None:
    copy.execute("PRAGMA journal_mode=DELETE")  # one file, readable from read-only media
    problem = copy.execute("PRAGMA quick_check(1)").fetchone()[0]
    if problem != "ok":
        msg = f"{target}: the copy is damaged ({problem}): check the disk, then try again"
        raise StoreError(msg)


def _move(part: Path, target: Path) -> None:
    with _Writing(target):
        with open(part, "rb") as file:
            os.fsync(file.fileno())
        os.replace(part, target)


def _rows(connection: Connection, table: sa.Table) -> Iterator[Mapping[str, Any]]:
    order = [table.c[name] for name in ("cycle", "position", "id") if name in table.c]
    query = sa.select(VALVE.c.name.label("valve"), table).join(
        VALVE, VALVE.c.id == table.c.valve_id
    )
    result = connection.execution_options(yield_per=_PAGE).execute(
        query.order_by(VALVE.c.name, *order)
    )
    hidden = {"id", "valve_id", "position"}
    for row in result.mappings():
        yield {name: value for name, value in row.items() if name not in hidden}


def _write_csv(path: Path, columns: list[str], rows: Iterator[Mapping[str, Any]]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([row[name] for name in columns] for row in rows)


def _write_cycles(connection: Connection, path: Path) -> None:
    _write_csv(
        path,
        ["valve", *(c.name for c in CYCLE.c if c.name != "valve_id")],
        _rows(connection, CYCLE),
    )


def _write_maintenance(connection: Connection, path: Path) -> None:
    columns = ["valve", *(c.name for c in MAINTENANCE.c if c.name not in {"id", "valve_id"})]
    _write_csv(path, columns, _rows(connection, MAINTENANCE))


def _write_estimates(connection: Connection, path: Path) -> None:
    parameter = [
        "parameter",
        "value",
        "standard_error",
        "lower_95",
        "upper_95",
        "parameter_status",
        "parameter_reason",
    ]
    shared = ["valve", "cycle", "estimator", "model", "start_ns", "end_ns", "status", "reason"]
    rest = [
        "mse_test", "mse_train", "fit_test", "fit_train", "condition_number", "lag", "noise_sigma",
        "samples_used", "samples_masked_seat", "samples_masked_stuck", "samples_masked_stale",
        "samples_masked_bad", "missed_cycles", "used_by_trend", "reproducible",
    ]  # fmt: skip
    long = (
        {**row, **values}
        for row in map(_flat_estimate, _rows(connection, ESTIMATE))
        for values in row.pop("parameters") or [dict.fromkeys(parameter)]
    )
    _write_csv(path, [*shared, *parameter, *rest], long)


def _write_json_lines(connection: Connection, path: Path) -> None:
    with open(path, "w", encoding="utf-8") as file:
        for kind, table in (
            ("cycle", CYCLE),
            ("estimate", ESTIMATE),
            ("maintenance", MAINTENANCE),
        ):
            for row in _rows(connection, table):
                content = _flat_estimate(row) if table is ESTIMATE else dict(row)
                file.write(json.dumps({"kind": kind, **content}, allow_nan=False) + "\n")


def _flat_estimate(row: Mapping[str, Any]) -> dict[str, Any]:
    estimate = row_estimate(row)
    masked = zip(("seat", "stuck", "stale", "bad"), json.loads(row["samples_masked"]), strict=True)
    packed = {"samples_masked", "findings"}
    flat = {name: _finite(value) for name, value in row.items() if name not in packed}
    flat |= {f"samples_masked_{name}": count for name, count in masked}
    flat["status"] = EstimateStatus(row["status"]).name
    flat["parameters"] = [
        {
            "parameter": p.name,
            "value": _finite(p.value),
            "standard_error": _finite(p.standard_error),
            "lower_95": _finite(p.lower_95),
            "upper_95": _finite(p.upper_95),
            "parameter_status": ParameterStatus(p.status).name,
            "parameter_reason": p.reason,
        }
        for p in estimate.parameters
    ]
    flat["trend_reason"] = estimate.trend_reason
    flat["disagreements"] = _rows_of(estimate.disagreements)
    flat["guards"] = _rows_of(estimate.guards)
    flat["conditions"] = _rows_of(estimate.conditions)
    return flat


def _rows_of(values: Sequence[Condition | Disagreement | Guard]) -> list[dict[str, object]]:
    return [{k: _finite(v) for k, v in dataclasses.asdict(value).items()} for value in values]


def _finite(value: object) -> object:
    """Return NaN as None (JSON null, an empty CSV cell) and the infinities as words."""
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)
