# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a history as they stand: what every face shows, assessed once a new cycle."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.core.aging.config import AgingConfig
from valve_twin.io.errors import ValveTwinError
from valve_twin.io.history.fleet import FleetOrder, FleetRow, describe_valve, ranked
from valve_twin.io.history.store import History
from valve_twin.report.build import history_data
from valve_twin.report.page import render_report

if TYPE_CHECKING:
    from collections.abc import Mapping

REFRESH_S = 2.0
"""The history is asked at most so often, however many look [s]."""

_Key = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class View:
    """What the faces show.

    Attributes
    ----------
    rows : tuple of FleetRow
        One a valve, worst first.
    where : str
        The history.
    read_ns : int
        When it was read last [ns since 1970]; 0 = never.
    failure : str
        Why it could not be read now; the rows are then those of `read_ns`.
    """

    rows: tuple[FleetRow, ...] = ()
    where: str = ""
    read_ns: int = 0
    failure: str = ""

    def row(self, valve: str) -> FleetRow | None:
        """Return the row of a valve; None where the history does not know it."""
        return next((row for row in self.rows if row.valve == valve), None)


class Plant:
    """Reads a history for many who look at it; safe from any thread.

    Parameters
    ----------
    url : str
        URL of the history.
    aging : mapping
        Rules of aging by name of the valve; the usual ones where one is missing.
    """

    def __init__(self, url: str, aging: Mapping[str, AgingConfig] | None = None) -> None:
        self._url, self._aging = url, dict(aging or {})
        self._lock = threading.Lock()
        self._view = View()
        self._asked_s = -REFRESH_S
        self._rows: dict[str, tuple[_Key, FleetRow]] = {}
        self._pages: dict[str, tuple[_Key, str]] = {}

    def view(self) -> View:
        """Return all valves; a history that cannot be read is said, nothing is raised."""
        with self._lock:
            if time.monotonic() - self._asked_s < REFRESH_S:
                return self._view
            try:
                with History(self._url, read_only=True) as history:
                    rows = [self._row(history, valve) for valve in history.valves()]
                    where = history.where
                found = tuple(ranked(rows, FleetOrder.URGENCY))
                self._view = View(found, where, time.time_ns())
            except ValveTwinError as err:
                self._view = replace(self._view, failure=str(err))
            self._asked_s = time.monotonic()
            return self._view

    def page(self, valve: str) -> str | None:
        """Return the report page of a valve; None where the history does not know it.

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        with self._lock, History(self._url, read_only=True) as history:
            if valve not in history.valves():
                return None
            key = _key(history, valve)
            kept = self._pages.get(valve)
            if kept is None or kept[0] != key:
                try:
                    data = history_data(history, valve, self._rules(valve))
                except ValueError as err:  # a model that is not installed here
                    raise ValveTwinError(str(err)) from err
                kept = self._pages[valve] = key, render_report(data)
            return kept[1]

    def _row(self, history: History, valve: str) -> FleetRow:
        key = _key(history, valve)
        kept = self._rows.get(valve)
        if kept is None or kept[0] != key:
            row = describe_valve(history, valve, self._rules(valve))
            kept = self._rows[valve] = key, row
        return kept[1]

    def _rules(self, valve: str) -> AgingConfig:
        return self._aging.get(valve, AgingConfig())


def _key(history: History, valve: str) -> _Key:
    """Return what changes whenever a valve has to be assessed anew."""
    last = history.last_record(valve)
    newest = (last.cycle, last.end_ns) if last is not None else ()
    return (*newest, *((m.cycle, m.stamp_ns) for m in history.maintenance(valve)))
