# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the databases' errors mean to the user: the fault and the remedy in one line."""

from __future__ import annotations

from sqlalchemy.exc import DBAPIError

_SQLITE_REMEDIES = (
    (
        "database is locked",
        "another program holds the write lock: close it or wait, then try again",
    ),
    (
        "database table is locked",
        "another program holds the write lock: close it or wait, then try again",
    ),
    (
        "readonly database",
        "the file or its folder is read-only: give this user write access to both",
    ),
    ("disk is full", "free some space, then try again; what is stored is intact"),
    (
        "file is not a database",
        "this file is no SQLite database: name another file or move this one away",
    ),
    ("malformed", "the file is damaged: move it away and put the last backup in its place"),
    ("unable to open", "the folder must exist and this user must be able to read and write there"),
    ("no such table", "the file was changed by another program: put the last backup in its place"),
    (
        "disk i/o error",
        "the disk or network share reports a fault: check it and the free space, then try again",
    ),
)
_POSTGRESQL_REMEDIES = (
    ("connection refused", "is the server running, and are host and port right?"),
    ("is the server running", "start the server, or correct host and port in the URL"),
    ("could not translate host name", "check the host name in the URL"),
    ("password authentication failed", "check user and password in the URL or in ~/.pgpass"),
    ("does not exist", "create it or correct the URL"),
    ("permission denied", "grant this user the right to create and write tables there"),
    ("lock timeout", "another program holds a lock: close it or wait, then try again"),
    ("read-only transaction", "the server is a read-only replica: name the primary"),
    ("no space left", "free some space on the server, then try again; what is stored is intact"),
)


def explain(err: Exception, *, sqlite: bool) -> str:
    """Return a driver's error and what to do about it, one line.

    Parameters
    ----------
    err : Exception
        Of the driver, or of SQLAlchemy around it.
    sqlite : bool
        Whether it comes from SQLite, else from PostgreSQL.
    """
    original = err.orig if isinstance(err, DBAPIError) and err.orig is not None else err
    text = (str(original).strip().splitlines() or [type(original).__name__])[0]
    table = _SQLITE_REMEDIES if sqlite else _POSTGRESQL_REMEDIES
    remedy = next(
        (r for sign, r in table if sign in str(original).lower()), "see the database's own log"
    )
    return f"{text}: {remedy}"
