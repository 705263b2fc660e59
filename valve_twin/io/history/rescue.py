# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is done when the file of an open history is deleted, replaced, cut or loses its log.

Nothing that was acknowledged may be lost. A deleted file still lives as long as it is open, so it
is written again under its name. A file put in its place is used, and gets what it lacks of the
old one. A lost log is emptied into its database, a truncated one filled again from the copy in
memory. One process at a time does this.
"""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError

from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import sealed, sound_rows
from valve_twin.io.history.claim import only_one
from valve_twin.io.history.tables import (
    CHECK_SUM,
    CONDENSATE,
    CONDENSED,
    COUNTERS,
    CYCLE,
    ESTIMATE,
    EVENT,
    MAINTENANCE,
    VERDICT,
)
from valve_twin.io.history.valves.names import key_of, sound_names
from valve_twin.io.history.wal.mend import mend_cut
from valve_twin.io.history.wal.watch import Trouble
from valve_twin.io.whole import part_of, sync_file, sync_folder

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection

    from valve_twin.io.history.database import Database

_DAMAGED = ("malformed", "not a database")
"""What SQLite says of a damaged file: its codes reach Python from 3.11 on only."""


def repair(database: Database, writers: Path) -> tuple[Database, str]:
    """Make an open history usable again.

    Parameters
    ----------
    database : Database
        SQLite database whose file met with `Trouble`; closed where another one is returned.
    writers : Path
        The file of its writers; its lock keeps other processes from repairs at the same time.

    Returns
    -------
    database : Database
        The one to go on with.
    note : str
        What was done, one line; empty where nothing had to be.

    Raises
    ------
    StoreError
        If it cannot be done now; nothing is changed.
    """
    with database.errors("mended"), only_one(writers):
        trouble = database.trouble()  # another process may have been faster
        if trouble is None:
            return database, ""
        if trouble in {Trouble.INDEX_CUT, Trouble.INDEX_LOST}:
            database.mend_index()
            return database, ""
        note = trouble.value
        if trouble in {Trouble.CUT, Trouble.LOG_CUT}:
            note += mend_cut(database, trouble)
            database.close()
            return database.again(), f"{database.where}: {note}"
        if trouble is not Trouble.LOG_DELETED:
            _part_from_log(database)
        if trouble is Trouble.DELETED:
            note += _write_again(database)
        elif trouble is Trouble.LOG_DELETED:
            _empty_log(database)
            note += ": it was emptied into the file"
            database.close()  # the last one to close puts the log away: before a new one is made
        fresh = database.again()
        if trouble is Trouble.REPLACED:
            try:
                note += _carry_over(database, fresh)
            except BaseException:
                fresh.close()
                raise
        database.close()
    return fresh, f"{database.where}: {note}"


def _write_again(database: Database) -> str:
    """Write the deleted file, which is still open, under its name."""
    assert database.file is not None
    path = database.file
    part = part_of(path)
    try:
        with closing(sqlite3.connect(part)) as copy:
            database.driver.backup(copy)
            copy.execute("PRAGMA journal_mode=DELETE")
            copy.execute("PRAGMA synchronous=FULL")
        for tail in ("-wal", "-shm"):  # of the deleted file: they must not meet the new one
            Path(f"{path}{tail}").unlink(missing_ok=True)
        sync_file(part)
        os.link(part, path)
        sync_folder(path.parent)
    except sqlite3.DatabaseError as err:
        if not any(sign in str(err) for sign in _DAMAGED):
            raise
        return ": it was damaged and cannot be written again: a new history begins"
    finally:
        part.unlink(missing_ok=True)
    return ": it was written again with all that it held"


def _part_from_log(database: Database) -> None:
    """Complete a file that was moved away and remove its log, which must not meet a new one."""
    with suppress(sqlite3.Error):
        database.driver.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    if database.files is None or database.files.log_is_own():
        for tail in ("-wal", "-shm"):
            Path(f"{database.file}{tail}").unlink(missing_ok=True)


def _empty_log(database: Database) -> None:
    busy, _, _ = database.driver.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    if busy:
        msg = (
            f"{database.where}: its write-ahead log was deleted while in use and others still"
            " read it: tried again"
        )
        raise StoreError(msg)


def _carry_over(old: Database, new: Database) -> str:
    """Store in the new file what the old one has and it lacks."""
    try:
        with new.transaction() as sink, old.transaction() as source:
            valves = sound_names(source, old.where)
            count = sum(_carry_valve(source, sink, new, n, key) for key, n in valves.items())
        new.check_file()
    except (DBAPIError, sqlite3.DatabaseError) as err:
        if not any(sign in str(err) for sign in _DAMAGED):
            raise
        return ": the one in its place is used; the one before was damaged"
    return f": the one in its place is used; {count} cycles were added that it lacked"


def _carry_valve(
    source: Connection, sink: Connection, new: Database, name: str, old_id: int
) -> int:
    new_id = key_of(sink, name, new.where)
    kept = {row["cycle"]: row for row in _rows(sink, CYCLE, new_id)}
    until, condensed = _carry_condensed(source, sink, old_id, new_id)
    missing = []
    for row in _rows(source, CYCLE, old_id):
        if row["cycle"] <= until:
            continue
        stored = kept.get(row["cycle"])
        if stored is None:
            missing.append(row)
        elif stored | {"software": row["software"]} != row:
            msg = (
                f"{new.where}: the file was replaced while in use by one that holds other cycles:"
                f" cycle {row['cycle']} of {name} differs: put the right file in its place, or"
                " move this one away"
            )
            raise StoreError(msg)
    wanted = {row["cycle"] for row in missing}
    rows = {CYCLE: missing}
    rows |= condensed
    rows[ESTIMATE] += [row for row in _rows(source, ESTIMATE, old_id) if row["cycle"] in wanted]
    for table in (MAINTENANCE, VERDICT):
        known = _rows(sink, table, new_id)
        rows[table] = [row for row in _rows(source, table, old_id) if row not in known]
    rows[EVENT] = _rows(source, EVENT, old_id)
    for table in (MAINTENANCE, EVENT):
        rows[table] = _carry_marked(sink, new_id, table, rows[table])
    rows[COUNTERS] = _carry_counters(sink, new_id, _rows(source, COUNTERS, old_id))
    for table, found in rows.items():
        if found:
            rows_of = [sealed(table, row | {"valve_id": new_id}) for row in found]
            sink.execute(table.insert(), rows_of)
    return len(missing)


def _carry_condensed(
    source: Connection, sink: Connection, old_id: int, new_id: int
) -> tuple[int, dict[sa.Table, list[dict[str, Any]]]]:
    """Return up to which cycle the file in its place is condensed, and what it lacks of that.

    Condensed cycles are missing where it holds nothing up to the last of them.
    """
    there = _rows(sink, CONDENSED, new_id)
    if there:
        return there[0]["cycle"], {ESTIMATE: []}
    found = _rows(source, CONDENSED, old_id)
    last = found[0]["cycle"] if found else 0
    early = sa.select(CYCLE.c.cycle).where(CYCLE.c.valve_id == new_id, CYCLE.c.cycle <= last)
    if not found or sink.execute(early.limit(1)).first():
        return 0, {ESTIMATE: []}
    kept = [row for row in _rows(source, ESTIMATE, old_id) if row["cycle"] <= last]
    return 0, {ESTIMATE: kept, CONDENSED: found, CONDENSATE: _rows(source, CONDENSATE, old_id)}


_MARKED = {
    MAINTENANCE: ("withdrawn", ("stamp_ns", "cycle", "note", "new_reference")),
    EVENT: ("acknowledged", ("stamp_ns", "cycle", "code", "text")),
}
"""By table what a row may be marked as later on, and what tells it from others, marked or not."""


def _carry_marked(
    sink: Connection, new_id: int, table: sa.Table, rows: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return the rows that are missing; one that is there but for its mark is the same.

    What was withdrawn or acknowledged in either file stays so.
    """
    mark, names = _MARKED[table]
    kept = sink.execute(sa.select(table).where(table.c.valve_id == new_id))
    known = {tuple(row[n] for n in names): row for row in map(dict, kept.mappings())}
    missing = []
    for row in rows:
        there = known.get(tuple(row[n] for n in names))
        if there is None:
            missing.append(row)
        elif row[mark] and not there[mark]:
            change = sealed(table, row | {"valve_id": new_id})
            sink.execute(table.update().where(table.c.id == there["id"]).values(**change))
    return missing


def _carry_counters(
    sink: Connection, new_id: int, rows: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return the counters where they have counted more than those there, which go then."""
    there = _rows(sink, COUNTERS, new_id)
    more = [row for row in rows if all(row["cycles"] > other["cycles"] for other in there)]
    if more:
        sink.execute(sa.delete(COUNTERS).where(COUNTERS.c.valve_id == new_id))
    return more


def _rows(connection: Connection, table: sa.Table, valve_id: int) -> list[dict[str, Any]]:
    """Return the rows of a valve without the keys of their file."""
    order = [table.c[name] for name in ("cycle", "position", "id") if name in table.c]
    found = connection.execute(
        sa.select(table).where(table.c.valve_id == valve_id).order_by(*order)
    )
    own = {"id", "valve_id", CHECK_SUM}
    sound = sound_rows(table, map(dict, found.mappings()), "history that was in use")
    return [{name: x for name, x in row.items() if name not in own} for row in sound]
