# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rows of the table of verdicts: one where the verdict or the fault behind it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.tables import VERDICT, from_row, to_row

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy.engine import Connection


def add_verdict(connection: Connection, valve_id: int, verdict: Verdict) -> bool:
    """Store a verdict if it says something new; return whether it does.

    The same word is new where it is a fault and another one is named. A verdict on an earlier
    cycle than the last stored one is old: a monitor that catches up repeats what was said.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve_id : int
        Key of the valve's row in table `valve`.
    verdict : Verdict
        The monitor's verdict on the last cycle it knows.
    """
    query = sa.select(VERDICT).where(VERDICT.c.valve_id == valve_id)
    last = connection.execute(query.order_by(VERDICT.c.id.desc()).limit(1)).mappings().first()
    if last is not None and not _is_new(verdict, dict(last)):
        return False
    connection.execute(VERDICT.insert(), sealed(VERDICT, to_row(verdict, valve_id)))
    return True


def row_verdict(valve: str, row: Mapping[str, Any]) -> Verdict:
    """Return the verdict of a row of table `verdict`."""
    kind = VerdictKind(row["verdict"])
    return from_row(Verdict, row, valve=valve, text=kind.text)


def _is_new(verdict: Verdict, last: Mapping[str, Any]) -> bool:
    if verdict.cycle <= last["cycle"]:
        return False
    return (int(verdict.kind), verdict.fault) != (last["verdict"], last["fault"])
