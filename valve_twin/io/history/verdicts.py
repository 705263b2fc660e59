# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Rows of the table of verdicts: one where the verdict or the fault behind it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sqlalchemy as sa
from sqlalchemy import BigInteger, Column, ForeignKey, Integer, Table, Text

from valve_twin.core.aging.verdict import Verdict, VerdictKind
from valve_twin.io.history.tables import METADATA

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy.engine import Connection

_Id = BigInteger().with_variant(Integer, "sqlite")

VERDICT = Table(
    "verdict",
    METADATA,
    Column("id", _Id, primary_key=True, autoincrement=True),
    Column("valve_id", _Id, ForeignKey("valve.id"), nullable=False, index=True),
    Column("stamp_ns", BigInteger, nullable=False),
    Column("cycle", BigInteger, nullable=False),
    Column("verdict", Integer, nullable=False),
    Column("evidence", Text, nullable=False),
)

_QUIET = (VerdictKind.OK, VerdictKind.NOT_ENOUGH_DATA)


def add_verdict(connection: Connection, valve_id: int, verdict: Verdict) -> bool:
    """Store a verdict if it says something new; return whether it does.

    The same word is new where it is a fault and another one is named. A verdict on an earlier
    cycle than the last stored one is old: a monitor that catches up repeats what was said.
    """
    query = sa.select(VERDICT).where(VERDICT.c.valve_id == valve_id)
    last = connection.execute(query.order_by(VERDICT.c.id.desc()).limit(1)).mappings().first()
    if last is not None and not _is_news(verdict, dict(last)):
        return False
    row = {
        "valve_id": valve_id,
        "stamp_ns": int(verdict.stamp_ns),
        "cycle": int(verdict.cycle),
        "verdict": int(verdict.verdict),
        "evidence": verdict.evidence,
    }
    connection.execute(VERDICT.insert(), row)
    return True


def row_verdict(valve: str, row: Mapping[str, Any]) -> Verdict:
    """Return the verdict of a row of table `verdict`."""
    kind = VerdictKind(row["verdict"])
    return Verdict(row["stamp_ns"], valve, kind, kind.text, row["evidence"], row["cycle"])


def _is_news(verdict: Verdict, last: Mapping[str, Any]) -> bool:
    if verdict.cycle <= last["cycle"]:
        return False
    if int(verdict.verdict) != last["verdict"]:
        return True
    return verdict.verdict not in _QUIET and _fault(verdict.evidence) != _fault(last["evidence"])


def _fault(evidence: str) -> str:
    """Return what is named: the words before the first number or comma."""
    words = evidence.split(",", maxsplit=1)[0].split()
    named = [w for w in words if not any(c.isdigit() for c in w)]
    return " ".join(named)
