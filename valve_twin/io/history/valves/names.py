# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The names of the valves in a history: whose a row is hangs on one, so each proves itself.

A row of table `valve` carries a digest of its name, to which its key is added. A name with a
damaged byte is nobody's; the rows under its key are found by the digest of the name that it had.
"""

from __future__ import annotations

import logging
from functools import lru_cache
from hashlib import sha256
from importlib import import_module
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.io.errors import StoreError
from valve_twin.io.history.tables import CHECK_SUM, VALVE

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection

_LOGGER = logging.getLogger("valve_twin")
_SUM = VALVE.c[CHECK_SUM]
UNSEALED = 0
"""Of a name that a twin of a version before its check sum stored after the upgrade: believed."""

_CUT = "\0"
"""In a name whose end lies, with its check sum, where a file was cut: SQLite reads zeros there."""

_ROWS = sa.select(VALVE.c.id, VALVE.c.name, _SUM)
DIGEST_BITS = 62
"""So many bits of a SHA-256, the first ones, go into the digest of a name."""

DAMAGED_NAME = "/name_damaged_"
"""What is shown, before its key, for a valve whose name is damaged."""

_MOST_TOLD = 10_000
_told: set[str] = set()


@lru_cache(maxsize=10_000)
def digest_of(name: str) -> int:
    """Return a number below 2^62, in which no two valves of a history meet."""
    found = sha256(name.encode("utf-8", "surrogateescape")).digest()
    return int.from_bytes(found[:8], "big") >> (64 - DIGEST_BITS)


def own_key(valve: str) -> sa.ColumnElement[Any]:
    """Return what gives the key of a valve inside a query; NULL where it has no rows.

    Parameters
    ----------
    valve : str
        Its name.
    """
    sum_ = VALVE.c.id + digest_of(valve)
    named = VALVE.c.name == valve
    found = sa.select(VALVE.c.id).where(named, _SUM.in_((UNSEALED, sum_))).scalar_subquery()
    proven = sa.select(sa.func.min(VALVE.c.id)).where(sum_ == _SUM).scalar_subquery()
    return sa.func.coalesce(found, proven)


def of_valve(table: sa.Table, valve: str) -> sa.Select[Any]:
    """Return the query of all rows of a table that belong to a valve."""
    return sa.select(table).where(table.c.valve_id == own_key(valve))


def key_of(connection: Connection, valve: str, where: str) -> int:
    """Return the key of a valve, which gets one where it has none.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve : str
        Its name.
    where : str
        The database, for messages.

    Raises
    ------
    StoreError
        If the name stands in a damaged row of another valve.
    """
    known = connection.scalar(sa.select(own_key(valve)))
    if known is None:
        insert = import_module(f"sqlalchemy.dialects.{connection.dialect.name}").insert(VALVE)
        connection.execute(insert.on_conflict_do_nothing(), {"name": valve})
        known = connection.scalar(sa.select(own_key(valve)))
        seal_names(connection)
    if known is None:
        msg = (
            f"{where}: table valve: '{valve}' stands where another valve stood, its check sum is "
            "wrong: put the last backup in its place"
        )
        raise StoreError(msg)
    return int(known)


def seal_names(connection: Connection) -> None:
    """Write the check sums of all names that have none.

    Parameters
    ----------
    connection : Connection
        With an open write transaction.
    """
    rows = connection.execute(sa.select(VALVE.c.id, VALVE.c.name).where(_SUM == UNSEALED)).all()
    for key, name in rows:
        if _CUT in name:
            continue
        change = VALVE.update().where(VALVE.c.id == key)
        connection.execute(change.values({CHECK_SUM: key + digest_of(name)}))


def sound_names(connection: Connection, where: str) -> dict[int, str]:
    """Return the names of all valves by their keys, sorted; say of damaged ones which they are.

    Parameters
    ----------
    connection : Connection
        To the database.
    where : str
        The database, for messages.
    """
    return told_names(connection, where)[0]


def told_names(connection: Connection, where: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return what `read_names` does, and say which names are damaged; arguments as there."""
    names, damaged = read_names(connection, where)
    for line in damaged.values():
        tell_once(line)
    return names, damaged


def _is_sound(key: int, name: str, sum_: int) -> bool:
    return sum_ == key + digest_of(name) or (sum_ == UNSEALED and _CUT not in name)


def tell_once(line: str) -> None:
    """Log what is damaged once: a twin reads its history again and again."""
    if line not in _told:
        if len(_told) >= _MOST_TOLD:
            _told.clear()
        _told.add(line)
        _LOGGER.warning("%s", line)


def read_names(connection: Connection, where: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return the names of all valves, sorted, and a line for each damaged one, by their keys.

    Parameters
    ----------
    connection : Connection
        To the database.
    where : str
        The database, for messages.
    """
    names, damaged = {}, {}
    for key, name, sum_ in connection.execute(_ROWS):
        if _is_sound(key, name, sum_):
            names[key] = name
        else:
            damaged[key] = (
                f"{where}: table valve, row {key}: its check sum is wrong, {name!r} is not its "
                "name: its rows are found under the right one only: put the last backup in its "
                "place"
            )
    return dict(sorted(names.items(), key=lambda item: item[1])), damaged
