# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far a history is condensed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.past.condensate import Condensed
from valve_twin.io.history.tables import CONDENSED, from_row
from valve_twin.io.history.valves.names import of_valve

if TYPE_CHECKING:
    from valve_twin.io.history.store import History


def condensed_until(history: History, valve: str) -> int:
    """Return the number of the last cycle of a valve that is condensed; 0 = none is."""
    query = of_valve(CONDENSED, valve).with_only_columns(CONDENSED.c.cycle)
    return next((int(row["cycle"]) for row in history.select(query)), 0)


def condensed(history: History, valve: str) -> Condensed | None:
    """Return how far a valve's cycles are condensed; None = not, or the row is damaged."""
    rows = history.sound(CONDENSED, of_valve(CONDENSED, valve))
    return next((from_row(Condensed, row) for row in rows), None)


def told(found: Condensed) -> str:
    """Return in one sentence what a reader of single cycles has to know."""
    return (
        f"cycles {found.first_cycle} to {found.cycle} are condensed to hours and days: of their "
        f"{found.estimates} estimates those that the trend needs are kept"
    )
