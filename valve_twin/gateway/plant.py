# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a history as they stand: what every face shows, assessed once a new cycle."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from valve_twin.core.aging.config import AgingConfig
from valve_twin.io.errors import StoreError, ValveTwinError
from valve_twin.io.history.fleet import (
    FleetOrder,
    FleetRow,
    ValveState,
    describe_valve,
    ranked,
)
from valve_twin.io.history.store import DamagedValueError, History
from valve_twin.report.build import history_data
from valve_twin.report.page import render_report

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.aging.verdict import Trend, Verdict
    from valve_twin.core.types import Estimate
    from valve_twin.io.history.marks import Mark

REFRESH_S = 2.0
"""The history is asked at most so often, however many look [s]."""

REST = 4.0
"""Between two readings lies so many times what the last one took [1]: reading takes a fifth of a
core at most, also where a large file cannot be opened and is checked again and again."""

WAIT_S = 0.5
"""Who looks while another look reads waits at most so long, then sees what there was [s]."""


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
    trends : mapping
        The trends of the followed parameters by name of the valve.
    nameplates : mapping
        What is given of a nameplate, by name of the valve.
    verdicts : mapping
        The verdict of each valve that could be assessed, by its name.
    """

    rows: tuple[FleetRow, ...] = ()
    where: str = ""
    read_ns: int = 0
    failure: str = ""
    trends: Mapping[str, tuple[Trend, ...]] = field(default_factory=dict)
    nameplates: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)

    def row(self, valve: str) -> FleetRow | None:
        """Return the row of a valve; None where the history does not know it."""
        return next((row for row in self.rows if row.valve == valve), None)

    def made_of(self, row: FleetRow) -> tuple[object, ...]:
        """Return what is said of a valve; the same objects where nothing of it was read anew."""
        return row, self.trends.get(row.valve), self.nameplates.get(row.valve)


class Plant:
    """Reads a history for many who look at it; safe from any thread.

    The history stays open, so that its file is checked once and not at every look; a file that was
    put in its place is opened anew. One look at a time reads, others wait briefly for it.

    Parameters
    ----------
    url : str
        URL of the history.
    aging : mapping
        Rules of aging by name of the valve; the usual ones where one is missing.
    nameplates : mapping
        What is given of a nameplate, by name of the valve.
    """

    def __init__(
        self,
        url: str,
        aging: Mapping[str, AgingConfig] | None = None,
        nameplates: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        self._url, self._aging = url, dict(aging or {})
        self._nameplates = dict(nameplates or {})
        self._reading = threading.Lock()
        self._history: History | None = None
        self._view = View()
        self._due_s = time.monotonic()
        self._states: dict[str, tuple[Mark, ValveState]] = {}
        self._pages: dict[str, tuple[Mark, str]] = {}
        self._writing: dict[str, threading.Lock] = {}

    def view(self) -> View:
        """Return all valves; a history that cannot be read is said, nothing is raised."""
        if time.monotonic() >= self._due_s and self._reading.acquire(timeout=WAIT_S):
            try:
                begun_s = time.monotonic()
                if begun_s >= self._due_s:
                    self._read()
                    end_s = time.monotonic()
                    self._due_s = end_s + max(REFRESH_S, REST * (end_s - begun_s))
            finally:
                self._reading.release()
        return self._view

    def page(self, valve: str) -> str | None:
        """Return the report page of a valve; None where the history does not know it.

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        view = self.view()
        if view.failure:
            raise StoreError(view.failure)
        history, known = self._history, self._states.get(valve)
        if history is None or known is None:
            return None
        mark = known[0]
        with self._writing.setdefault(valve, threading.Lock()):
            kept = self._pages.get(valve)
            if kept is None or kept[0] != mark:
                try:
                    data = history_data(history, valve, self._rules(valve))
                except ValueError as err:  # a model that is not installed here
                    raise ValveTwinError(str(err)) from err
                plate = self._nameplates.get(valve, {})
                page = render_report(replace(data, nameplate=plate))
                kept = self._pages[valve] = mark, page
            return kept[1]

    def estimates(self, valve: str, first_cycle: int, limit: int) -> list[Estimate]:
        """Return stored estimates that feed a valve's trend, by cycle.

        Parameters
        ----------
        valve : str
            Its name.
        first_cycle : int
            The first one wanted.
        limit : int
            At most so many.

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        history = self._history
        if history is None:
            return []
        return history.estimates(valve, None, first_cycle, limit, used_by_trend=True)

    def _read(self) -> None:
        try:
            history = self._opened()
            marks = history.marks()
            self._states = {name: self._state(history, name, m) for name, m in marks.items()}
        except ValveTwinError as err:
            self._view = replace(self._view, failure=str(err))
            return
        states = [state for _, state in self._states.values()]
        rows = tuple(ranked([state.row for state in states], FleetOrder.URGENCY))
        trends = {state.row.valve: state.trends for state in states}
        plates = self._nameplates
        verdicts = {s.row.valve: s.verdict for s in states if s.verdict is not None}
        self._view = View(rows, history.where, time.time_ns(), "", trends, plates, verdicts)

    def _opened(self) -> History:
        if self._history is not None and self._history.moved:
            self._history.close()
            self._history = None
        if self._history is None:
            self._states, self._pages = {}, {}
            self._history = History(self._url, read_only=True)
        return self._history

    def _state(self, history: History, valve: str, mark: Mark) -> tuple[Mark, ValveState]:
        """Return the state of a valve; whatever is wrong with what is stored spoils no other."""
        kept = self._states.get(valve)
        if kept is not None and kept[0] == mark:
            return kept
        shown = shown_name(valve)
        if shown != valve:
            why = "its name is damaged in the history: put the last backup in its place"
            return mark, ValveState(FleetRow(shown, evidence=why, cycle=mark.cycle))
        try:
            return mark, describe_valve(history, valve, self._rules(valve))
        except DamagedValueError as err:
            why = str(err)
        except ValveTwinError:
            raise
        except Exception as err:
            why = f"what is stored of it cannot be assessed ({type(err).__name__}: {err})"
        return mark, ValveState(FleetRow(valve, evidence=why, cycle=mark.cycle))

    def _rules(self, valve: str) -> AgingConfig:
        return self._aging.get(valve, AgingConfig())


def shown_name(valve: str) -> str:
    r"""Return a valve's name as text that every face can carry: bytes that are none as \xNN."""
    return valve.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
