# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a first reading of a history, which may take long, has so far for who looks."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from valve_twin.gateway.view import View
from valve_twin.io.history.fleet import FleetOrder, FleetRow, ValveState, ranked

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.io.history.valves.marks import Mark

WAITING = "is being assessed for the first time since the start"
"""Evidence of a valve whose turn has not come yet."""


class FirstReading:
    """What a first reading has so far; ranked for who looks, once for all since the last valve."""

    def __init__(
        self,
        where: str,
        marks: Mapping[str, Mark],
        states: Mapping[str, tuple[Mark, ValveState]],
        nameplates: Mapping[str, Mapping[str, str]],
    ) -> None:
        self._where, self._marks, self.states = where, marks, states
        self._nameplates = nameplates
        self._ranking = threading.Lock()
        self._ranked: tuple[int, View] = -1, View(whole=False)

    def view(self) -> View:
        """Return all valves, those whose turn has not come yet without a state."""
        with self._ranking:
            known = dict(self.states)  # grows while it is read
            if self._ranked[0] != len(known):
                self._ranked = len(known), self._rank(known)
            return self._ranked[1]

    def _rank(self, known: Mapping[str, tuple[Mark, ValveState]]) -> View:
        waiting = [
            FleetRow(shown_name(name), evidence=WAITING, cycle=mark.cycle)
            for name, mark in self._marks.items()
            if name not in known
        ]
        states = [state for _, state in known.values()]
        return shown(states, waiting, self._where, self._nameplates)


def shown(
    states: Sequence[ValveState],
    waiting: Sequence[FleetRow],
    where: str,
    nameplates: Mapping[str, Mapping[str, str]],
) -> View:
    """Return what the faces show of a history read so far.

    Parameters
    ----------
    states : sequence of ValveState
        Of the valves that are assessed.
    waiting : sequence of FleetRow
        Of those that are not.
    where : str
        The history.
    nameplates : mapping
        What is given of a nameplate, by name of the valve.
    """
    rows = ranked([state.row for state in states] + list(waiting), FleetOrder.URGENCY)
    trends = {state.row.valve: state.trends for state in states}
    verdicts = {s.row.valve: s.verdict for s in states if s.verdict is not None}
    now_ns = time.time_ns()
    return View(tuple(rows), where, now_ns, "", trends, nameplates, verdicts, whole=False)


def shown_name(valve: str) -> str:
    r"""Return a valve's name as text that every face can carry: bytes that are none as \xNN."""
    return valve.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
