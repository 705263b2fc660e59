# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What tells a reader that asks again and again of which valve there is something new."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import sqlalchemy as sa

from valve_twin.io.history.tables import CYCLE, EVENT, MAINTENANCE, VALVE
from valve_twin.io.history.valves.names import told_names

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection


class Mark(NamedTuple):
    """What is stored of a valve: number of its last cycle, and of its last maintenance event.

    And how many of its events were withdrawn, and the number of the last entry of its event log.
    """

    cycle: int
    maintenance: int
    withdrawn: int = 0
    entry: int = 0


class Marks(NamedTuple):
    """The marks of all valves by name, sorted, and the keys of those whose names are damaged."""

    valves: dict[str, Mark]
    nameless: list[int]


def read_marks(connection: Connection, where: str) -> Marks:
    """Return the mark of every valve: a look at ends of indexes and at events.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that reads.
    where : str
        The database, for messages.
    """
    last = [
        sa.select(sa.func.max(column)).where(table.c.valve_id == VALVE.c.id).scalar_subquery()
        for table, column in (
            (CYCLE, CYCLE.c.cycle),
            (MAINTENANCE, MAINTENANCE.c.id),
            (EVENT, EVENT.c.id),
        )
    ]
    withdrawn = (
        sa.select(sa.func.count())
        .where(MAINTENANCE.c.valve_id == VALVE.c.id, MAINTENANCE.c.withdrawn)
        .scalar_subquery()
    )
    rows = connection.execute(sa.select(VALVE.c.id, withdrawn, *last))
    found = {row[0]: Mark(row[2] or 0, row[3] or 0, int(row[1]), row[4] or 0) for row in rows}
    names, damaged = told_names(connection, where)
    return Marks({name: found[key] for key, name in names.items()}, list(damaged))
