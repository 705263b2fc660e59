# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters in the history: a row a valve, written in the transaction of the cycle they count.

So a cycle is counted exactly where it is stored: a process that is killed loses and doubles none.
"""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from valve_twin.core.operation.counters import Counters
from valve_twin.io.history.check_sums import sealed
from valve_twin.io.history.tables import COUNTERS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqlalchemy.engine import Connection

_NAMES = tuple(f.name for f in fields(Counters))


def put_counters(connection: Connection, valve_id: int, counters: Counters) -> None:
    """Store the counters of a valve in place of those before.

    Parameters
    ----------
    connection : Connection
        To the database, in the transaction that stores their last cycle.
    valve_id : int
        Key of the valve's row in table `valve`.
    counters : Counters
        With that cycle.
    """
    row = {**counters_row(counters), "valve_id": valve_id}
    connection.execute(sa.delete(COUNTERS).where(COUNTERS.c.valve_id == valve_id))
    connection.execute(COUNTERS.insert(), sealed(COUNTERS, row))


def counters_row(counters: Counters) -> dict[str, Any]:
    """Return the row of counters of no valve yet."""
    return {name: _put(getattr(counters, name)) for name in _NAMES}


def row_counters(row: Mapping[str, Any]) -> Counters:
    """Return the counters of a row of table `counters`."""
    found: dict[str, Any] = {name: math.nan if row[name] is None else row[name] for name in _NAMES}
    found["spans"] = tuple(json.loads(row["spans"]))
    return Counters(**found)


def _put(value: Any) -> Any:  # noqa: ANN401  a value of SQL
    if isinstance(value, tuple):
        return json.dumps(value, separators=(",", ":"))
    return None if isinstance(value, float) and math.isnan(value) else value
