# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Check sums of the history's rows: a byte that a disk or another program changed is named.

The sum stands over all values of a row but its own key, in the form in which they come back.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from operator import itemgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import sqlalchemy as sa

from valve_twin.io.history.tables import (
    CHECK_SUM,
    CONDENSATE,
    CONDENSED,
    COUNTERS,
    CYCLE,
    ESTIMATE,
    EVENT,
    MAINTENANCE,
    UNSUMMED,
    VERDICT,
    row_estimate,
)
from valve_twin.io.history.valves.names import read_names, tell_once
from valve_twin.io.mcap.checksum import crc32

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager

    from sqlalchemy.engine import Connection

Rows: TypeAlias = "list[Mapping[str, Any]]"
_PAGE = 1000
_MOST_PROBLEMS = 20
_SEPARATOR = "\x1f"
UNSEALED = 0
"""Of a row from before check sums, until the upgrade seals it. Where it stands later it is no sum:
zeros are what a file that was cut or never written to its end is filled with."""

SEALED_SINCE = "0007"
"""Schema since which every row that is stored carries its check sum."""

SEALED = (CYCLE, ESTIMATE, MAINTENANCE, VERDICT, EVENT, COUNTERS, CONDENSATE, CONDENSED)
"""Tables whose rows carry a check sum."""


@dataclass(slots=True)
class Verification:
    """What a check of a whole history found: rows read, and a line for each that is damaged."""

    rows: int = 0
    damaged: list[str] = field(default_factory=list)


def sealed(table: sa.Table, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with its check sum."""
    return {**row, CHECK_SUM: row_sum(table, row)}


def row_sum(table: sa.Table, row: Mapping[str, Any]) -> int:
    """Return the check sum of a row; -1 where its values cannot be those of the table.

    Parameters
    ----------
    table : Table
        Its table.
    row : mapping
        Its values by column.
    """
    try:
        unsummed = UNSUMMED.get(table.name, ())
        form = _form_of(table, bool(unsummed) and not any(row[name] for name in unsummed))
        values = list(form.read(row))
        for place in form.numbers:
            value = values[place]  # SQLite keeps no sign of zero
            values[place] = "" if value is None else repr(float(value) + 0.0)
        text = form.text % tuple(values)
    except (ValueError, TypeError, OverflowError):
        return -1
    return crc32(text.encode("utf-8", "surrogateescape"))


def sound_rows(
    table: sa.Table, rows: Iterable[Mapping[str, Any]], where: str
) -> Iterator[Mapping[str, Any]]:
    """Yield the rows whose check sum is right; say of the others which they are.

    Parameters
    ----------
    table : Table
        Their table.
    rows : iterable of mapping
        Rows with all columns of the table.
    where : str
        The database, for messages.
    """
    for row in rows:
        if row[CHECK_SUM] == row_sum(table, row):
            yield row
        else:
            tell_once(_damaged_line(table, row, where))


def sound_page(
    table: sa.Table,
    read: Callable[[int], Sequence[Mapping[str, Any]]],
    limit: int | None,
    where: str,
) -> Rows:
    """Return sound rows up to a limit, reading on behind damaged ones.

    Parameters
    ----------
    table : Table
        Their table.
    read : callable
        Returns the rows from an offset [1] on, `limit` at most.
    limit : int or None
        Rows wanted [1]; None = all that is read at once.
    where : str
        The database, for messages.
    """
    rows = read(0)
    found, seen = list(sound_rows(table, rows, where)), len(rows)
    while limit and len(rows) == limit and len(found) < limit:
        rows = read(seen)
        found, seen = [*found, *sound_rows(table, rows, where)], seen + len(rows)
    return found[:limit]


def verify(read: Callable[[], AbstractContextManager[Connection]], where: str) -> Verification:
    """Read all rows and compare their check sums.

    Parameters
    ----------
    read : callable
        Gives a connection that sees one state of the database.
    where : str
        The database, for messages.

    Raises
    ------
    StoreError
        If the database itself cannot be read.
    """
    try:
        with read() as connection:
            return _verified(connection, where)
    except (TypeError, ValueError, OverflowError) as err:
        line = f"{where}: a value is none of its column ({err})"
        return Verification(damaged=[line])


def _verified(connection: Connection, where: str) -> Verification:
    known, damaged = read_names(connection, where)
    found = Verification(len(known) + len(damaged), list(damaged.values()))
    for table in SEALED:
        result = connection.execution_options(yield_per=_PAGE).execute(sa.select(table))
        for row in result.mappings():
            found.rows += 1
            if row[CHECK_SUM] != row_sum(table, dict(row)):
                found.damaged.append(_damaged_line(table, dict(row), where))
            elif row["valve_id"] not in known | damaged:
                found.damaged.append(f"{_place(table, dict(row), where)}: its valve is not there")
    if connection.dialect.name == "sqlite":  # rows that an index hides, too
        problems = connection.exec_driver_sql(f"PRAGMA integrity_check({_MOST_PROBLEMS})")
        lines = [str(line) for (line,) in problems if line != "ok"]
        found.damaged += [f"{where}: {line}: put the last backup in its place" for line in lines]
    return found


def seal_all(connection: Connection) -> None:
    """Write the check sums of all rows, which are from before there were any.

    A row that cannot be read gets none: it is named as damaged from then on.

    Parameters
    ----------
    connection : Connection
        With an open write transaction.
    """
    for table in SEALED:
        if not connection.scalar(sa.select(sa.func.count()).select_from(table)):
            continue
        key = [c for c in table.c if c.primary_key]
        keys: dict[str, Any] = {c.name: sa.bindparam(f"key_{c.name}") for c in key}
        change = table.update().values({CHECK_SUM: sa.bindparam("new_sum")})
        change = change.where(*(c == keys[c.name] for c in key))
        last: tuple[Any, ...] | None = None
        while True:
            query = sa.select(table).order_by(*key).limit(_PAGE)
            if last is not None:
                query = query.where(sa.tuple_(*key) > sa.tuple_(*last))
            rows = [dict(r) for r in connection.execute(query).mappings()]
            if not rows:
                break
            last = tuple(rows[-1][c.name] for c in key)
            page = [
                {"new_sum": row_sum(table, r), **{f"key_{c.name}": r[c.name] for c in key}}
                for r in rows
                if r[CHECK_SUM] == UNSEALED and _is_readable(table, r)
            ]
            if page:
                connection.execute(change, page)


def _is_readable(table: sa.Table, row: Mapping[str, Any]) -> bool:
    try:
        if table is ESTIMATE:
            row_estimate(row)
    except (ValueError, TypeError, LookupError, AttributeError):
        return False
    return row_sum(table, row) >= 0


def _damaged_line(table: sa.Table, row: Mapping[str, Any], where: str) -> str:
    return (
        f"{_place(table, row, where)}: its check sum is wrong, it is left out: put the last "
        "backup in its place"
    )


def _place(table: sa.Table, row: Mapping[str, Any], where: str) -> str:
    key = f"row {row['id']}, " if "id" in row else ""
    return f"{where}: table {table.name}, {key}cycle {row['cycle']}"


class _Form(NamedTuple):
    """How the values of a row are put together: what reads them, floating-point ones, the text."""

    read: Callable[[Mapping[str, Any]], tuple[Any, ...]]
    numbers: tuple[int, ...]
    text: str


@cache
def _form_of(table: sa.Table, without: bool) -> _Form:
    """Return the form of a table's rows, `without` its columns in `UNSUMMED`."""
    left_out = {"id", CHECK_SUM, *(UNSUMMED.get(table.name, ()) if without else ())}
    own = [c for c in table.c if c.name not in left_out]
    put = ["%s" if isinstance(c.type, sa.Double | sa.String) else "%d" for c in own]
    numbers = tuple(k for k, c in enumerate(own) if isinstance(c.type, sa.Double))
    return _Form(itemgetter(*(c.name for c in own)), numbers, _SEPARATOR.join(put))
