# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is remarked on a valve beside its cycles: verdicts and maintenance events.

Each is an entry of the event log, too. A verdict is stored where it or the fault behind it
changes. A maintenance event is never taken away: one that was marked by mistake is kept as
withdrawn.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.core.operation.events import maintenance_event, verdict_events
from valve_twin.core.types import Maintenance
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import sealed, sound_rows
from valve_twin.io.history.log.events import KEPT, add_events, wrong_text
from valve_twin.io.history.tables import MAINTENANCE, VERDICT, from_row, to_row

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy.engine import Connection

MOST_OF_A_NOTE = 2048
"""Length of the note of a maintenance event [B]."""


def wrong_note(note: str, what: str = "what was done") -> str:
    """Return what is wrong with the note of a maintenance event, empty where nothing is.

    Parameters
    ----------
    note : str
        The note.
    what : str
        What it is to say.
    """
    if not note.strip():
        return f"the note is empty: say {what}"
    return wrong_text("the note", note, MOST_OF_A_NOTE)


def add_event(connection: Connection, valve_id: int, event: Maintenance, kept: int = KEPT) -> bool:
    """Store a maintenance event; return False if exactly this one was stored before.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve_id : int
        Key of the valve's row in table `valve`.
    event : Maintenance
        What was done.
    kept : int
        Entries of the event log that may be there [1].
    """
    row = to_row(event, valve_id)
    same = sa.and_(*(MAINTENANCE.c[name] == value for name, value in row.items()))
    if connection.execute(sa.select(MAINTENANCE.c.id).where(same)).first() is not None:
        return False
    connection.execute(MAINTENANCE.insert(), sealed(MAINTENANCE, row))
    add_events(connection, valve_id, [maintenance_event(event)], kept)
    return True


def withdraw_event(
    connection: Connection,
    valve_id: int | None,
    cycle: int,
    note: str,
    where: str,
    kept: int = KEPT,
) -> Maintenance:
    """Withdraw the newest maintenance event in force that begins a segment at a cycle.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve_id : int or None
        Key of the valve's row in table `valve`; None = it has none.
    cycle : int
        First cycle of the segment that it began [1].
    note : str
        Why.
    where : str
        The database, for messages.
    kept : int
        Entries of the event log that may be there [1].

    Returns
    -------
    Maintenance
        The event as it is kept now.

    Raises
    ------
    StoreError
        If there is none, it is withdrawn already, or the note is empty or too long.
    """
    wrong = wrong_note(note, "why it is withdrawn")
    if wrong:
        raise StoreError(wrong)
    query = sa.select(MAINTENANCE).where(MAINTENANCE.c.valve_id == valve_id)
    found = connection.execute(query.order_by(MAINTENANCE.c.id)).mappings().all()
    rows = list(sound_rows(MAINTENANCE, map(dict, found), where))
    there = [row for row in rows if row["cycle"] == cycle]
    standing = [row for row in there if not row["withdrawn"]]
    if not standing:
        known = sorted({row["cycle"] for row in rows if not row["withdrawn"]})
        marked = ", ".join(map(str, known[-_MOST_NAMED:])) or "none"
        why = f"was withdrawn already: {there[-1]['withdrawn_note']}" if there else "is not there"
        msg = f"a maintenance event at cycle {cycle} {why}: in force are those at cycle {marked}"
        raise StoreError(msg)
    row = dict(standing[-1])
    event = replace(from_row(Maintenance, row), withdrawn=True, withdrawn_note=note)
    change = sealed(MAINTENANCE, to_row(event, row["valve_id"]))
    connection.execute(MAINTENANCE.update().where(MAINTENANCE.c.id == row["id"]).values(**change))
    add_events(connection, row["valve_id"], [maintenance_event(event)], kept)
    return event


_MOST_NAMED = 10
"""Cycles of events in force that a refusal names [1]."""


def add_verdict(connection: Connection, valve_id: int, verdict: Verdict, kept: int = KEPT) -> bool:
    """Store a verdict if it says something new; return whether it does.

    One that waits for the next cycle says nothing yet.
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
    kept : int
        Entries of the event log that may be there [1].
    """
    if verdict.held_back:
        return False
    query = sa.select(VERDICT).where(VERDICT.c.valve_id == valve_id)
    last = connection.execute(query.order_by(VERDICT.c.id.desc()).limit(1)).mappings().first()
    if last is not None and not _is_new(verdict, dict(last)):
        return False
    connection.execute(VERDICT.insert(), sealed(VERDICT, to_row(verdict, valve_id)))
    before = last["fault"] if last else ""
    add_events(connection, valve_id, verdict_events(verdict, before), kept)
    return True


def row_verdict(valve: str, row: Mapping[str, Any]) -> Verdict:
    """Return the verdict of a row of table `verdict`."""
    kind = VerdictKind(row["verdict"])
    return from_row(Verdict, row, valve=valve, text=kind.text)


def _is_new(verdict: Verdict, last: Mapping[str, Any]) -> bool:
    if verdict.cycle <= last["cycle"]:
        return False
    return (int(verdict.kind), verdict.fault) != (last["verdict"], last["fault"])
