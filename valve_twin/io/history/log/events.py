# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The event log in the history: entries are added, acknowledged, and dropped when they are old.

A log is bounded: beyond the newest entries stands the first of each kind of failure that nobody
has acknowledged, so that one that comes and goes does not fill the disk, and the last stroke test,
so that it is known when the next one is due.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.faults.ne107 import Ne107
from valve_twin.core.operation.events import Event
from valve_twin.core.operation.stroke_due import STROKE_CODES
from valve_twin.io.errors import StoreError
from valve_twin.io.history.check_sums import sealed, sound_rows
from valve_twin.io.history.tables import EVENT, from_row, to_row

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sqlalchemy.engine import Connection

MOST_OF_A_NAME, MOST_OF_A_NOTE = 200, 2048
"""Lengths of who acknowledges and of what he says [B]."""

LAST_ID = 2**63 - 1
"""The highest number that a database knows [1]."""

KEPT = 10_000
"""Entries of a valve that are kept unless told otherwise [1]."""

_OPEN = sa.and_(EVENT.c.acknowledged.is_(False), EVENT.c.status != Ne107.GOOD.value)


def add_events(
    connection: Connection, valve_id: int, events: Iterable[Event], kept: int = KEPT
) -> None:
    """Store entries, and let go of the oldest beyond the bound.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve_id : int
        Key of the valve's row in table `valve`.
    events : iterable of Event
        In their order.
    kept : int
        Entries that may be there [1]. Of failures that nobody acknowledged the first of each code
        stays beyond it; as many of these at most. The last stroke test always stays.
    """
    for event in events:
        row = to_row(event, valve_id)
        del row["id"]
        connection.execute(EVENT.insert(), sealed(EVENT, row))
    own = EVENT.c.valve_id == valve_id
    newest = sa.select(EVENT.c.id).where(own).order_by(EVENT.c.id.desc())
    last = connection.scalar(newest.offset(kept).limit(1))
    if last is None:
        return
    failure = sa.and_(EVENT.c.acknowledged.is_(False), EVENT.c.status == Ne107.FAILURE.value)
    first = sa.select(sa.func.min(EVENT.c.id)).where(own, failure).group_by(EVENT.c.code)
    strokes = sa.select(EVENT.c.id).where(own, EVENT.c.code.in_(STROKE_CODES))
    newest_first = EVENT.c.stamp_ns.desc(), EVENT.c.id.desc()
    stroke = connection.scalar(strokes.order_by(*newest_first).limit(1))
    old = sa.delete(EVENT).where(own, EVENT.c.id != (stroke or 0))
    connection.execute(old.where(EVENT.c.id <= last, EVENT.c.id.not_in(first)))
    most = connection.scalar(newest.offset(2 * kept).limit(1))
    if most is not None:
        connection.execute(old.where(EVENT.c.id <= most))


def acknowledge(
    connection: Connection, valve_id: int | None, number: int, by: Acknowledgement, where: str
) -> int:
    """Note that somebody has seen an entry, or all that are open; it stays in the log.

    Parameters
    ----------
    connection : Connection
        To the database, in a transaction that writes.
    valve_id : int or None
        Key of the valve's row in table `valve`; None = it has none.
    number : int
        The entry's; 0 = all that are open.
    by : Acknowledgement
        Who, what and when.
    where : str
        The database, for messages.

    Returns
    -------
    int
        How many were open until now [1].

    Raises
    ------
    StoreError
        If the entry is not there, or who and what are empty or too long.
    """
    wrong = by.wrong()
    if wrong:
        raise StoreError(wrong)
    query = sa.select(EVENT).where(EVENT.c.valve_id == valve_id).order_by(EVENT.c.id)
    query = query.where(EVENT.c.id == number) if number else query.where(_OPEN)
    found = connection.execute(query).mappings().all() if number <= LAST_ID else ()
    rows = list(sound_rows(EVENT, map(dict, found), where))
    if number and not rows:
        msg = f"there is no entry {number}: get_events lists them"
        raise StoreError(msg)
    waiting = [row for row in rows if not row["acknowledged"]]
    for row in waiting:
        event = replace(
            row_event("", row),
            acknowledged=True,
            acknowledged_by=by.who,
            acknowledged_note=by.note,
            acknowledged_at_ns=by.stamp_ns,
        )
        change = sealed(EVENT, to_row(event, row["valve_id"]))
        connection.execute(EVENT.update().where(EVENT.c.id == row["id"]).values(**change))
    return len(waiting)


def wrong_text(what: str, text: str, most: int) -> str:
    """Return what is wrong with a text that somebody gives, empty where nothing is.

    Parameters
    ----------
    what, text, most : str, str, int
        How it is called, the text, and its longest [B].
    """
    size = len(text.encode("utf-8", "surrogateescape"))
    if size > most:
        return f"{what} has {size} bytes, {most} at most: shorten it"
    if "\0" in text or any("\ud800" <= c <= "\udfff" for c in text):
        return f"{what} {text[:_SHOWN]!a} is no text in UTF-8: write it anew"
    return ""


_SHOWN = 40


class Acknowledgement:
    """Who has seen an entry, what he says to it, and when [ns]."""

    def __init__(self, who: str, note: str = "", stamp_ns: int = 0) -> None:
        self.who, self.note, self.stamp_ns = who.strip(), note.strip(), stamp_ns

    def wrong(self) -> str:
        """Return what is wrong with it, empty where nothing is."""
        if not self.who:
            return "who is empty: give the name of who has seen it"
        for what, text, most in (
            ("who", self.who, MOST_OF_A_NAME),
            ("the note", self.note, MOST_OF_A_NOTE),
        ):
            wrong = wrong_text(what, text, most)
            if wrong:
                return wrong
        return ""


def events_query(query: sa.Select[Any], first_id: int, *, open_only: bool) -> sa.Select[Any]:
    """Return the query of a valve's entries from a number on, oldest first.

    Parameters
    ----------
    query : Select
        Of all entries of a valve.
    first_id : int
        Number of the first entry wanted [1].
    open_only : bool
        Only those that somebody has yet to acknowledge.
    """
    query = query.where(EVENT.c.id >= min(first_id, LAST_ID)).order_by(EVENT.c.id)
    return query.where(_OPEN) if open_only else query


def row_event(valve: str, row: Mapping[str, Any]) -> Event:
    """Return the entry of a row of table `event`."""
    return from_row(Event, row, valve=valve)
