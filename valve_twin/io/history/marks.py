# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What tells a reader that asks again and again of which valve there is something new."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import sqlalchemy as sa

from valve_twin.io.history.tables import CYCLE, MAINTENANCE, VALVE

if TYPE_CHECKING:
    from sqlalchemy.engine import Connection


class Mark(NamedTuple):
    """What is stored of a valve: number of its last cycle, and of its last maintenance event.

    And how many of its events were withdrawn.
    """

    cycle: int
    maintenance: int
    withdrawn: int = 0


def read_marks(connection: Connection) -> dict[str, Mark]:
    """Return the mark of every valve, sorted by name: a look at ends of indexes and at events.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that reads.
    """
    last = (
        sa.select(sa.func.max(column)).where(table.c.valve_id == VALVE.c.id).scalar_subquery()
        for table, column in ((CYCLE, CYCLE.c.cycle), (MAINTENANCE, MAINTENANCE.c.id))
    )
    withdrawn = (
        sa.select(sa.func.count())
        .where(MAINTENANCE.c.valve_id == VALVE.c.id, MAINTENANCE.c.withdrawn)
        .scalar_subquery()
    )
    rows = connection.execute(sa.select(VALVE.c.name, *last, withdrawn).order_by(VALVE.c.name))
    return {str(name): Mark(cycle or 0, event or 0, gone) for name, cycle, event, gone in rows}
