# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valves of a history as they stand: what every face shows, assessed once a new cycle."""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from valve_twin.core.aging.config import AgingConfig
from valve_twin.gateway.first_reading import FirstReading, shown, shown_name
from valve_twin.gateway.page.details import Details, DetailsOf, make_details
from valve_twin.gateway.view import View
from valve_twin.io.errors import StoreError, ValveTwinError
from valve_twin.io.history.database import place_of
from valve_twin.io.history.fleet import FleetRow, ValveState, describe_valve
from valve_twin.io.history.store import DamagedValueError, History
from valve_twin.io.history.valves.names import DAMAGED_NAME

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import TypeAlias

    from valve_twin.core.types import Estimate
    from valve_twin.gateway.live.told import Told
    from valve_twin.io.history.tables import CycleRecord
    from valve_twin.io.history.valves.marks import Mark

    StoredCycle: TypeAlias = tuple[CycleRecord, list[Estimate]]

_LOGGER = logging.getLogger("valve_twin")

REFRESH_S = 2.0
"""The history is asked at most so often, however many look [s]."""

REST = 4.0
"""Between two readings lies so many times the processor time of the last one [1]: reading takes a
fifth of a core at most, also where a large file is checked again and again; waiting is none."""

RETRY_S = 1.0
"""A history that could not be read is tried again after so long, if that was cheap [s]."""

WAIT_S = 0.5
"""Who looks while the history is read waits at most so long, then sees what there was [s]."""

BRIEF_S = 5.0
"""One reading that fails is passed over until what is shown is so old; the next in a row is told
[s]."""

MOST_TRIES = 3
"""A history that could not be read so often in a row is let go and opened anew [1]: who mends a
disk or a file may need it closed."""

LATE_S = 30.0
"""A reading that gets on with no valve for longer, as with a database that does not answer any
more, is told [s]."""

DAMAGED = "its name is damaged in the history: put the last backup in its place"
"""Evidence of a valve that is known by its row alone."""

COURSE = 60
"""Estimates of the small course beside a valve's name [1]."""

_NOTHING = View(whole=False)
"""Before the first reading."""


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
    told : Told, optional
        What running nodes say on their topics, which goes before the history; None = none are.
    waits : bool
        Whether one that cannot be read at first is told and waited for; else whoever opens it
        says so.
    """

    def __init__(
        self,
        url: str,
        aging: Mapping[str, AgingConfig] | None = None,
        nameplates: Mapping[str, Mapping[str, str]] | None = None,
        told: Told | None = None,
        *,
        waits: bool = False,
    ) -> None:
        self._url, self._aging, self._told = url, dict(aging or {}), told
        self._nameplates = dict(nameplates or {})
        self._reading = threading.Lock()
        self._history: History | None = None
        self._view = _NOTHING
        self._due_s = self._read_s = time.monotonic()
        self._moved_s: float | None = None
        self._states: dict[str, tuple[Mark, ValveState]] = {}
        self._courses: dict[str, tuple[float, ...]] = {}
        self._details = DetailsOf()
        self.waits = waits
        self._told_failure, self._failures = "", 0
        self._passed = ""
        self._first, self._begun = threading.Event(), FirstReading("", {}, {}, {})

    @property
    def where(self) -> str:
        """The history, also before it is read."""
        return place_of(self._url)

    @property
    def failure(self) -> str:
        """Why the history cannot be read, by the last reading; empty where it can."""
        return self._or_late(self._view).failure

    @property
    def is_reading(self) -> bool:
        """Whether the history is being read just now."""
        return self._moved_s is not None

    def glance(self) -> View:
        """Return what there is at once: of a first reading, which takes long, what it has so far.

        Faces that tell changes take `news`: a valve that is yet to be assessed is none.
        """
        if not self._view.whole:
            self._begin_reading()
            self._first.wait(LATE_S)
            so_far = self._begun.view()
            if so_far.rows:
                return self._as_told(self._or_late(so_far))
        return self.view() if self._view is _NOTHING else self._as_told(self._looked(WAIT_S)[0])

    def _as_told(self, view: View) -> View:
        """Return a view of the history as the topics have it."""
        return view if self._told is None else self._told.over(view, self._rules)

    def news(self) -> View:
        """Return all valves; before the first reading is done nothing (not `whole`), at once."""
        found, _ = self._looked(WAIT_S if self._view.whole else 0.0)
        if found.whole:
            return self._as_told(found)
        if found is _NOTHING:
            return found
        return replace(_NOTHING, where=found.where, failure=found.failure)

    def view(self) -> View:
        """Return all valves; a history that cannot be read is said, nothing is raised."""
        while True:
            found, is_over = self._looked(WAIT_S if self._view.whole else LATE_S)
            if found.whole or is_over:  # else a first one that goes on
                return self._as_told(found)

    def _looked(self, wait_s: float) -> tuple[View, bool]:
        """Return what there is, and whether no reading goes on or one that does not get on."""
        self._begin_reading()
        if self._reading.acquire(timeout=wait_s):
            self._reading.release()
        is_over, view = not self.is_reading, self._view
        found = self._or_late(view)
        return found, is_over or found is not view

    def _or_late(self, view: View) -> View:
        """Return a view, as it is or with the failure that keeps it from being read anew."""
        moved_s, now_s, failure = self._moved_s, time.monotonic(), ""
        late_s = 0.0 if moved_s is None else now_s - moved_s
        if late_s >= LATE_S:
            failure = f"{self.where}: does not answer for {late_s:.0f} s"
        elif now_s - self._read_s >= BRIEF_S:
            failure = self._passed
        return replace(view, failure=failure) if failure else view

    def _begin_reading(self) -> None:
        """Have the history read where that is due and nobody does it."""
        if time.monotonic() < self._due_s or not self._reading.acquire(blocking=False):
            return
        self._moved_s = time.monotonic()
        try:
            threading.Thread(target=self._read_once, name="history", daemon=True).start()
        except RuntimeError:  # no thread is to be had
            if self._view.read_ns:  # what there was is shown
                self._end_reading()
            else:  # who looks reads
                self._read_once()

    def _end_reading(self) -> None:
        self._moved_s = None
        self._reading.release()

    def _read_once(self) -> None:
        """Read where it is due; lets go of the reading that was taken."""
        try:
            if time.monotonic() >= self._due_s:
                begun_s = time.thread_time()
                self._read()
                pause_s = RETRY_S if self._failures else REFRESH_S
                rest_s = REST * (time.thread_time() - begun_s)
                self._due_s = time.monotonic() + max(pause_s, rest_s)
        finally:
            self._first.set()
            self._end_reading()

    def page(self, valve: str) -> str | None:
        """Return the report page of a valve; None where the history does not know it.

        A valve that is yet to be assessed is waited for.

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        found = self.details(valve, None)
        if found is None:
            self.view()
            found = self.details(valve, None)
        return None if found is None else found.report

    def details(self, valve: str, wait_s: float | None = WAIT_S) -> Details | None:
        """Return what else is shown of a valve; None of one not assessed yet or not known.

        Parameters
        ----------
        valve : str
            Its name.
        wait_s : float or None
            Longest wait; then the details say that they are being made [s].

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        view = self.glance()
        if view.failure:
            raise StoreError(view.failure)
        history, known = self._history, self._states.get(valve) or self._begun.states.get(valve)
        if history is None or known is None:
            if self._passed:  # what was known was of the history that is being opened anew
                raise StoreError(self._passed)
            return None
        plate = dict(self._nameplates.get(valve, {}))
        make = partial(make_details, history, valve, self._rules(valve), plate)
        return self._details.get(valve, known[0], make, wait_s)

    def cycles(self, valve: str, numbers: Sequence[int]) -> list[StoredCycle | None]:
        """Return stored cycles with their estimates; None for one that is not there.

        Parameters
        ----------
        valve : str
            Its name.
        numbers : sequence of int
            Of the cycles [1].

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        history = self._open_one()
        found: list[StoredCycle | None] = []
        for number in numbers:
            record = next(iter(history.cycles(valve, number, 1)), None)
            if record is None or record.cycle != number:
                found.append(None)
                continue
            estimates = history.estimates(valve, None, number, 20, used_by_trend=True)
            found.append((record, [e for e in estimates if e.cycle == number]))
        return found

    def first_cycle(self, valve: str) -> int:
        """Return the number of the first stored cycle; 0 where there is none.

        Raises
        ------
        ValveTwinError
            If the history cannot be read.
        """
        found = self._open_one().cycles(valve, 0, 1)
        return found[0].cycle if found else 0

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
        return self._open_one().estimates(valve, None, first_cycle, limit, used_by_trend=True)

    def _open_one(self) -> History:
        history = self._history
        if history is None:
            failure = self._view.failure or self._passed
            raise StoreError(failure or f"{self.where}: is being opened")
        return history

    def _read(self) -> None:
        known: dict[str, tuple[Mark, ValveState]] = {}
        try:
            history = self._opened()
            marks, damaged = history.marks()
            nameless = [FleetRow(f"{DAMAGED_NAME}{key}", evidence=DAMAGED) for key in damaged]
            known.update((n, self._states[n]) for n in marks if n in self._states)
            if not self._view.whole:
                self._begun = FirstReading(history.where, marks, known, self._nameplates)
                self._first.set()
            for name, mark in marks.items():
                known[name] = self._state(history, name, mark)
                self._moved_s = time.monotonic()
            self._states = {name: known[name] for name in marks}
            self._courses = {n: c for n, c in self._courses.items() if n in marks}
        except ValveTwinError as err:
            self._states = self._states | known  # what was assessed is not assessed again
            self._passed = str(err) if self._is_brief() else ""
            if not self._passed:
                so_far = self._begun.view()  # empty but for a first reading
                self._view = replace(so_far if so_far.rows else self._view, failure=str(err))
                if self._view.read_ns or self.waits:
                    self._tell(str(err))
            self._begun = FirstReading("", {}, {}, {})
            self._failures += 1
            if self._failures % MOST_TRIES == 0:
                self._let_go()
            return
        self._tell("")
        self._passed, self._failures, self._read_s = "", 0, time.monotonic()
        states = [state for _, state in self._states.values()]
        found = shown(states, nameless, history.where, self._nameplates)
        self._view = replace(found, courses=dict(self._courses), whole=True)
        self._begun = FirstReading("", {}, {}, {})

    def _is_brief(self) -> bool:
        """Return whether a failed reading is the first behind a good one of just now."""
        is_first = self._view.whole and not self._failures
        return is_first and time.monotonic() - self._read_s < BRIEF_S

    def _tell(self, failure: str) -> None:
        """Say once that the history cannot be read, and once that it is read again."""
        if failure and not self._told_failure:
            known = "what was read before is shown meanwhile" if self._view.read_ns else "waiting"
            _LOGGER.warning("%s; %s", failure, known)
        elif self._told_failure and not failure:
            again = " again" if self._view.read_ns else ""
            _LOGGER.warning("%s: is read%s", self.where, again)
        self._told_failure = failure

    def _opened(self) -> History:
        if self._history is not None and self._history.moved:
            self._let_go()
        if self._history is None:
            self._states, self._courses = {}, {}
            self._details.clear()
            self._history = History(self._url, read_only=True)
        return self._history

    def _let_go(self) -> None:
        if self._history is not None:
            self._history.close()
            self._history = None

    def _state(self, history: History, valve: str, mark: Mark) -> tuple[Mark, ValveState]:
        """Return the state of a valve; whatever is wrong with what is stored spoils no other."""
        kept = self._states.get(valve)
        if kept is not None and kept[0] == mark:
            return kept
        named = shown_name(valve)
        if named != valve:
            return mark, ValveState(FleetRow(named, evidence=DAMAGED, cycle=mark.cycle))
        self._courses.pop(valve, None)
        try:
            state = describe_valve(history, valve, self._rules(valve))
            self._courses[valve] = _course(history, state)
        except DamagedValueError as err:
            why = str(err)
        except ValveTwinError:
            raise
        except Exception as err:
            why = f"what is stored of it cannot be assessed ({type(err).__name__}: {err})"
        else:
            return mark, state
        return mark, ValveState(FleetRow(valve, evidence=why, cycle=mark.cycle))

    def _rules(self, valve: str) -> AgingConfig:
        return self._aging.get(valve, AgingConfig())


def _course(history: History, state: ValveState) -> tuple[float, ...]:
    """Return the last usable estimates of a valve's worst parameter."""
    parameter = state.row.parameter
    if not parameter:
        return ()
    recent = history.recent_estimates(state.row.valve, COURSE)
    values = [p.value for e in recent if e.used_by_trend for p in e.parameters
              if p.name == parameter and p.usable]  # fmt: skip
    return tuple(values[-COURSE:])
