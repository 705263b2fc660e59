# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Mend a database in use that was truncated, or whose log was: from the copy of its log."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.io.errors import StoreError
from valve_twin.io.history.tables import SCHEMA_TABLE
from valve_twin.io.history.wal.frames import index_of, keep_open
from valve_twin.io.history.wal.hold import nobody_writes, others_have
from valve_twin.io.whole import part_of, sync_file, sync_folder

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.io.history.database import Database
    from valve_twin.io.history.wal.watch import Trouble

OTHERS_S = 15.0
"""How long another process may take to write back what it knows; it looks every 5 s [s].

Whoever committed last knows all.
"""

_BLOCK_B = 1 << 20


def mend_cut(database: Database, trouble: Trouble) -> str:
    """Write what is missing again; the database is to be opened anew.

    Parameters
    ----------
    database : Database
        Of which no other process mends anything now.
    trouble : Trouble
        What happened to it.

    Returns
    -------
    str
        What was done.

    Raises
    ------
    StoreError
        If what is missing is nowhere; nothing is changed.
    """
    assert database.file is not None
    assert database.files is not None
    log = f"{database.file}-wal"
    alone = nobody_writes(log) if os.path.exists(index_of(log)) else nullcontext()
    with alone:  # what others store in the old file from then on, they find replaced
        if database.trouble() is not trouble:
            return ": it is whole again"
        copy = database.files.log_copy
        if trouble is trouble.LOG_CUT and copy is not None and copy.restore():
            return ": what it held was written back from memory"
        if others_have(log) and database.files.troubled_s() < OTHERS_S:
            msg = (
                f"{database.where}: {trouble.value}: what is missing may be known to the others"
                " that have it open: tried again"
            )
            raise StoreError(msg)
        return _write_anew(database, database.file, trouble)


def _write_anew(database: Database, path: Path, trouble: Trouble) -> str:
    part = part_of(path)
    try:
        for write, lost in ((_by_pages, "all that it held"), (_by_bytes, "what was known of it")):
            if _is_sound(write, database, part):
                _put_in_place(part, path)
                return f": it was written again with {lost}"
    finally:
        for tail in ("", "-wal", "-shm"):
            Path(f"{part}{tail}").unlink(missing_ok=True)
    msg = (
        f"{database.where}: {trouble.value}, what is missing is nowhere else: move it away and"
        " put the last backup in its place"
    )
    raise StoreError(msg)


def _is_sound(write: Callable[[Database, Path], None], database: Database, part: Path) -> bool:
    """Write the database in one way; return whether a whole one came of it."""
    part.unlink(missing_ok=True)
    with suppress(sqlite3.DatabaseError):
        write(database, part)
        with closing(sqlite3.connect(part)) as copy:
            found: str = copy.execute("PRAGMA integrity_check(1)").fetchone()[0]
            known: int = copy.execute(f"SELECT count(*) FROM {SCHEMA_TABLE}").fetchone()[0]
            copy.execute("PRAGMA journal_mode=DELETE")
            return found == "ok" and known > 0
    return False


def _by_pages(database: Database, part: Path) -> None:
    """Copy what the open connection still sees, of which it may hold what the disk lost."""
    with closing(sqlite3.connect(part)) as copy:
        database.driver.backup(copy)


def _by_bytes(database: Database, part: Path) -> None:
    """Put what the disk has of the database beside the copy of its log."""
    source, at = keep_open(str(database.file)), 0
    with part.open("wb") as file:
        while block := os.pread(source, _BLOCK_B, at):
            file.write(block)
            at += len(block)
    copy = database.files.log_copy if database.files else None
    if copy is not None:
        if not copy.reaches_what_was_taken_in():
            msg = "the database is malformed: it is newer than the copy of its log"
            raise sqlite3.DatabaseError(msg)
        Path(f"{part}-wal").write_bytes(copy.content)


def _put_in_place(part: Path, path: Path) -> None:
    """Move a whole database under its name; no log of another one may meet it."""
    sync_file(part)
    for tail in ("-wal", "-shm"):
        Path(f"{path}{tail}").unlink(missing_ok=True)
    os.replace(part, path)
    sync_folder(path.parent)
