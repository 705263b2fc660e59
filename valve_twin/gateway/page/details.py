# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a valve's page and its report show beyond the overview: made once a new cycle."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from valve_twin.io.errors import StoreError, ValveTwinError
from valve_twin.io.history.tiers.extent import told
from valve_twin.report.build import history_data
from valve_twin.report.faults import MOST_EVENTS, faults_table
from valve_twin.report.page import parameter_figures, render_report

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.aging.config import AgingConfig
    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.operation.events import Event
    from valve_twin.core.types import Maintenance
    from valve_twin.io.history.store import History
    from valve_twin.io.history.valves.marks import Mark
    from valve_twin.report.page import Figure
    from valve_twin.report.tables import Table

DRAWING = "The courses are being drawn."
"""What details say that are not there yet."""

MOST_KEPT = 100
"""Valves whose details are kept; of more those go that were made first [1]."""


@dataclass(frozen=True, slots=True)
class Details:
    """What is shown of one valve.

    Attributes
    ----------
    report : str
        Its report page.
    figures : tuple of Figure
        Parameters over cycles.
    faults : Table or None
        Sudden faults; None = could not be looked for.
    counters : Counters or None
        What it has done.
    events : tuple of Event
        The newest entries of its log and all that are open, newest first.
    maintenance : tuple of Maintenance
        What was done to it, newest first.
    failure : str
        Why the rest is not here (yet).
    condensed : str
        What who looks at single cycles has to know, empty where none are condensed.
    """

    report: str = ""
    figures: tuple[Figure, ...] = ()
    faults: Table | None = None
    counters: Counters | None = None
    events: tuple[Event, ...] = ()
    maintenance: tuple[Maintenance, ...] = ()
    failure: str = ""
    condensed: str = ""


def make_details(
    history: History, valve: str, rules: AgingConfig, nameplate: dict[str, str]
) -> Details:
    """Make the details of a valve; a model that is not installed here is said.

    Parameters
    ----------
    history : History
        Where it is stored.
    valve : str
        Its name.
    rules : AgingConfig
        Rules of aging.
    nameplate : dict
        What is given of its nameplate.

    Raises
    ------
    ValveTwinError
        If the history cannot be read.
    """
    try:
        data = history_data(history, valve, rules)
    except ValueError as err:  # a model that is not installed here
        raise ValveTwinError(str(err)) from err
    events = data.events
    shown = [e for k, e in enumerate(events) if e.is_open or k >= len(events) - MOST_EVENTS]
    return Details(
        report=render_report(replace(data, nameplate=nameplate)),
        figures=tuple(parameter_figures(data)),
        faults=faults_table(data.assessment) if data.aging else None,
        counters=data.counters,
        events=tuple(reversed(shown)),
        maintenance=tuple(reversed(data.maintenance)),
        condensed=told(data.condensed) if data.condensed else "",
    )


class DetailsOf:
    """Details of many valves, made by one thread and kept until something new is stored."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "details")
        self._lock = threading.Lock()
        self._made: dict[str, tuple[Mark, Future[Details]]] = {}

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._made.clear()

    def get(
        self, valve: str, mark: Mark, make: Callable[[], Details], wait_s: float | None
    ) -> Details:
        """Return the details of a valve.

        Parameters
        ----------
        valve : str
            Its name.
        mark : Mark
            What changes whenever something of it is stored.
        make : callable
            Makes them.
        wait_s : float or None
            Longest wait [s]; then the details say that they are being made.

        Raises
        ------
        ValveTwinError
            If they cannot be made.
        """
        with self._lock:
            kept = self._made.get(valve)
            if kept is None or kept[0] != mark:
                kept = mark, self._pool.submit(make)
                self._made.pop(valve, None)
                while len(self._made) >= MOST_KEPT:
                    del self._made[next(iter(self._made))]
                self._made[valve] = kept
        if not wait([kept[1]], wait_s).done:
            return Details(failure=DRAWING)
        try:
            return kept[1].result()
        except StoreError:
            with self._lock:  # it may be readable the next time
                self._made.pop(valve, None)
            raise
