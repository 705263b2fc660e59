# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Copies of the history: for safe keeping (one SQLite file), for other programs (CSV, JSON).

Files appear complete or not at all: they are written beside their place and renamed.
"""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import re
import shutil
import sqlite3
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.records import columns, fields, flat
from valve_twin.core.types import Estimate
from valve_twin.io.errors import StoreError, unwritable
from valve_twin.io.history.check_sums import sound_rows
from valve_twin.io.history.database import Database
from valve_twin.io.history.errors import explain
from valve_twin.io.history.tables import (
    CHECK_SUM,
    CONDENSATE,
    CYCLE,
    ESTIMATE,
    MAINTENANCE,
    METADATA,
    VALVE,
    row_estimate,
)
from valve_twin.io.history.valves.names import sound_names
from valve_twin.io.limits import no_formula
from valve_twin.io.whole import part_of, placed, sync_file, sync_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from sqlalchemy.engine import Connection

_BACKUP_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,119}")
_FLOOR = 1 << 28
"""Room that a backup leaves on the disk [B]."""

_PAGE = 1000
"""Rows copied at a time."""

_HIDDEN = {"id", "valve_id", "position", CHECK_SUM}
"""Columns that mean nothing outside the database."""


def default_backup_path(database: Database) -> Path:
    """Return a name that is free: the database's with the time (UTC) in it."""
    stem = database.file or Path(f"{database.url.database or 'history'}.db")
    moment = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    names = (
        stem.with_name(f"{stem.stem}-{moment}{tail}{stem.suffix}")
        for tail in ("", *map("-{}".format, range(2, 99)))
    )
    return next(name for name in names if not name.exists())


@dataclass(frozen=True, slots=True)
class BackupRules:
    """Where copies go that somebody else asks for, and how many there may be.

    Attributes
    ----------
    folder : str
        Below it they are written; empty = `backups` beside the database, or in the working
        directory where that is no file.
    most : int
        Files that may be there [1].
    """

    folder: str
    most: int


def requested_backup_path(database: Database, rules: BackupRules, name: str) -> Path:
    """Return where a copy goes that is asked for from outside.

    Parameters
    ----------
    database : Database
        What is copied.
    rules : BackupRules
        Where to.
    name : str
        Name of the file; empty = that of the database with the time in it.

    Raises
    ------
    StoreError
        If it is more than a name, is taken, or there is no room for it.
    """
    beside = database.file.parent if database.file else Path.cwd()
    folder = (Path(rules.folder) if rules.folder else beside / "backups").absolute()
    if name and not _BACKUP_NAME.fullmatch(name):
        msg = (
            f"{name[:80]!r} is no name for a backup: it goes to {folder} under letters, digits, "
            "'.', '_' and '-', 120 at most; leave it empty for the date"
        )
        raise StoreError(msg)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [file.name for file in folder.iterdir()]
        free = shutil.disk_usage(folder).free
        size = database.file.stat().st_size if database.file else 0
    except OSError as err:
        msg = f"{folder}: cannot take a backup ({err.strerror}): check backup_folder"
        raise StoreError(msg) from err
    if len(names) >= rules.most:
        left = sum(name.startswith(".") and name.endswith(".part") for name in names)
        hidden = f", first the {left} of backups that were ended (.*.part)" if left else ""
        msg = (
            f"{folder}: {len(names)} files are there, backups_kept is {rules.most}: take some "
            f"away{hidden}"
        )
        raise StoreError(msg)
    if free < size + _FLOOR:
        msg = f"{folder}: {free >> 20} MB are free, the backup needs {size >> 20}: make room"
        raise StoreError(msg)
    target = folder / (name or default_backup_path(database).name)
    if os.path.lexists(target):
        msg = f"{target}: exists already; give another name"
        raise StoreError(msg)
    return target


def back_up_sqlite(database: Database, target: Path) -> None:
    """Copy a SQLite database page by page while others write to it.

    Raises
    ------
    StoreError
        If the target exists or cannot be written.
    """
    with _writing(target), placed(target, _part(target)) as part:
        with database.errors("backed up"), database.engine.connect() as connection:
            source = connection.connection.driver_connection
            assert isinstance(source, sqlite3.Connection)
            with _writing(target), closing(sqlite3.connect(part)) as copy:
                source.backup(copy)
                _seal(copy, target)
        sync_file(part)
    _keep_names(target.parent)


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
        with _writing(target), closing(sqlite3.connect(part)) as connection:
            _seal(connection, target)
        with _writing(target), placed(target, part):
            sync_file(part)
        _keep_names(target.parent)
    finally:
        for tail in ("", "-wal", "-shm"):
            Path(f"{part}{tail}").unlink(missing_ok=True)


def export_files(database: Database, folder: Path) -> list[Path]:
    """Write the files of `History.export`, all from one state of the database."""
    writers: dict[str, Callable[[Connection, Path], None]] = {
        "cycles.csv": partial(_write_table, CYCLE),
        "estimates.csv": _write_estimates,
        "maintenance.csv": partial(_write_table, MAINTENANCE),
        "condensates.csv": partial(_write_table, CONDENSATE),
        "history.jsonl": _write_json_lines,
    }
    with database.read() as connection, _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        parts = {name: folder / f".{name}.part" for name in writers}
        try:
            for name, write in writers.items():
                write(connection, parts[name])
                sync_file(parts[name])
            for name in writers:
                if (folder / name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f"{name} is a folder")
            _replace(parts, folder)  # nothing is replaced before all is written
            _keep_names(folder)
        finally:
            for part in parts.values():
                with suppress(OSError):
                    part.unlink(missing_ok=True)
    return [folder / name for name in writers]


def _replace(parts: Mapping[str, Path], folder: Path) -> None:
    """Put files in their places; where one cannot be, say which are of now by then."""
    new: list[str] = []
    try:
        for name, part in parts.items():
            os.replace(part, folder / name)
            new.append(name)
    except OSError as err:
        if not new:
            raise
        old = ", ".join(name for name in parts if name not in new)
        msg = f"{unwritable(folder, err)}; of now are {', '.join(new)}, as before {old}"
        raise StoreError(msg) from err


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    """Turn the system's errors about a target into one line."""
    try:
        yield
    except OSError as err:
        raise StoreError(unwritable(target, err)) from err
    except sqlite3.Error as err:
        msg = f"{target}: cannot be written: {explain(err, sqlite=True)}"
        raise StoreError(msg) from err


def _part(target: Path) -> Path:
    if target.exists():
        msg = f"{target}: exists already and is not overwritten: name another file"
        raise StoreError(msg)
    return part_of(target)


def _keep_names(folder: Path) -> None:
    """Put the names in a folder on disk: else a power cut takes that of a backup just told of."""
    with suppress(OSError):  # some network file systems keep their names in their own way
        sync_folder(folder)


def _seal(copy: sqlite3.Connection, target: Path) -> None:
    copy.execute("PRAGMA journal_mode=DELETE")  # one file, readable from read-only media
    problem = copy.execute("PRAGMA quick_check(1)").fetchone()[0]
    if problem != "ok":
        msg = f"{target}: the copy is damaged ({problem}): check the disk, then try again"
        raise StoreError(msg)


def _rows(connection: Connection, table: sa.Table) -> Iterator[Mapping[str, Any]]:
    order = [table.c[name] for name in ("cycle", "position", "id") if name in table.c]
    names = sound_names(connection, "the export")
    query = sa.select(table).join(VALVE, VALVE.c.id == table.c.valve_id)
    result = connection.execution_options(yield_per=_PAGE).execute(
        query.order_by(VALVE.c.name, *order)
    )
    for row in sound_rows(table, map(dict, result.mappings()), "the export"):
        if row["valve_id"] in names:
            own = {name: value for name, value in row.items() if name not in _HIDDEN}
            yield {"valve": names[row["valve_id"]], **own}


def _write_csv(path: Path, columns: list[str], rows: Iterator[Mapping[str, Any]]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows([no_formula(row[name]) for name in columns] for row in rows)


def _write_table(table: sa.Table, connection: Connection, path: Path) -> None:
    names = [c.name for c in table.c if c.name not in _HIDDEN]
    _write_csv(path, ["valve", *names], _rows(connection, table))


def _write_estimates(connection: Connection, path: Path) -> None:
    own = [c.name for c in columns(Estimate) if not c.many and c.name != "trend_reason"]
    shared = ["cycle", "estimator", "model", "start_ns", "end_ns", "status", "reason"]
    parameter = list(_PARAMETER)
    long = (
        {**row, **values}
        for row in map(_flat_estimate, _rows(connection, ESTIMATE))
        for values in row.pop("parameters") or [dict.fromkeys(parameter)]
    )
    rest = [name for name in own if name not in shared]
    _write_csv(path, ["valve", *shared, *parameter, *rest], long)


def _write_json_lines(connection: Connection, path: Path) -> None:
    kinds = {
        "cycle": CYCLE,
        "estimate": ESTIMATE,
        "maintenance": MAINTENANCE,
        "condensate": CONDENSATE,
    }
    with open(path, "w", encoding="utf-8") as file:
        for kind, table in kinds.items():
            for row in _rows(connection, table):
                content = _flat_estimate(row) if table is ESTIMATE else dict(row)
                file.write(json.dumps({"kind": kind, **content}, allow_nan=False) + "\n")


def _parameter_columns() -> dict[str, str]:
    """Return the fields of a parameter by their names in an export, the numbers first."""
    found = [c for c in columns(Estimate) if c.field == "parameters"]
    numbers = [c.part for c in found if c.kind is float]
    words = [c.part for c in found if c.kind is not float and c.part != "name"]
    return {"parameter": "name", **{n: n for n in numbers}, **{f"parameter_{w}": w for w in words}}


_PARAMETER = _parameter_columns()


def _flat_estimate(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of table `estimate` with its texts unpacked."""
    estimate = row_estimate(row)
    given = flat(estimate)
    texts = {"parameters", "samples_masked", "findings"}
    plain = {name: None if name in texts else _finite(value) for name, value in row.items()}
    plain["status"] = estimate.status.name
    plain["parameters"] = [
        {name: _finite(getattr(p, field)) for name, field in _PARAMETER.items()}
        for p in estimate.parameters
    ]
    for field in fields(Estimate):
        value = getattr(estimate, field.name)
        if field.many and field.name != "parameters":
            plain[field.name] = [
                {c.part: _finite(getattr(part, c.part)) for c in field.columns} for part in value
            ]
        elif not field.many:
            plain |= {c.name: given[c.name] for c in field.columns if c.name not in plain}
    return {name: value for name, value in plain.items() if name not in texts - {"parameters"}}


def _finite(value: object) -> object:
    """Return NaN as None (JSON null, an empty CSV cell) and the infinities as words."""
    if isinstance(value, IntEnum):
        return value.name
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)
