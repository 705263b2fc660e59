# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a monitor knows of one valve, and whether it has to ask the history for more.

An estimate that was published as stored is taken over where it follows on what is known:
every cycle between is known to have been refused, so that the history can hold nothing more. Else
something was lost (a message, a time in which the monitor or the twin was down) and the history is
asked; what it answers and what was published are the same to the last bit.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.past.state import AgingState
from valve_twin.nodes.runtime.messages import estimate_value

if TYPE_CHECKING:
    from valve_twin.core.past.columns import Past
    from valve_twin.core.types import Estimate, Maintenance

MOST_WAITING = 1000
"""Messages kept that cannot be taken over yet; the history has what is let go of."""

AGAIN = 100
"""Newest estimates of what was stored that the history is asked for again [1]."""


class EstimateBuffer:
    """Estimates and maintenance events of one valve, oldest first.

    Parameters
    ----------
    trend : str
        Estimator that feeds the trend.
    beside : str
        Another estimator whose estimates of the same cycles are needed; empty = none.
    again : int
        Estimates of what was stored that are asked for again, at most one page [1].
    sought : set of int, optional
        Late cycles for which all was read anew before: once is enough, stored or not.

    Attributes
    ----------
    counts : dict
        Estimates known, by estimator.
    maintenance : dict
        Events by what makes them one: all but whether they were withdrawn.
    late : bool
        Whether a cycle before the last one known was stored afterwards: all is to be read anew.
    """

    def __init__(
        self, trend: str, beside: str = "", again: int = AGAIN, sought: set[int] | None = None
    ) -> None:
        self._again, self.late = again, False
        self._sought = set() if sought is None else sought
        self._added: deque[int] = deque(maxlen=MOST_WAITING)
        self._trend, self._beside = trend, beside
        names = (trend, beside) if beside else (trend,)
        self.counts = dict.fromkeys(names, 0)
        self._last = dict.fromkeys(names, 0)
        self._known = AgingState()
        self._newest: Estimate | None = None
        self._to_prove: dict[str, Any] | None = None
        self.maintenance: dict[Maintenance, Maintenance] = {}
        self._received: dict[str, dict[int, Any]] = {name: {} for name in names}
        self._cycles: dict[int, Any] = {}

    @property
    def past(self) -> Past:
        """All that is known of the estimates, as columns."""
        return self._known.past()

    def last(self, estimator: str = "") -> int:
        """Return the last cycle known of an estimator, by default of the trend's; 0 = none."""
        return self._last[estimator or self._trend]

    def add(self, estimator: str, estimates: list[Estimate]) -> bool:
        """Add what the history answered; return whether any of it is new."""
        last = self.last(estimator)
        fresh = [e for e in estimates if e.cycle > last]
        self._known.maintenance = tuple(self.maintenance.values())
        for estimate in fresh:
            self._known.add(estimate)
        self.counts[estimator] += len(fresh)
        if fresh and estimator == self._trend:
            self._newest = fresh[-1]
            self._added.extend(e.cycle for e in fresh)
        if fresh:
            self._last[estimator] = fresh[-1].cycle
        return bool(fresh)

    @property
    def state(self) -> AgingState:
        """What is known of the estimates, to be stored."""
        return self._known

    def place(self) -> dict[str, Any]:
        """Return how far this is, in words and numbers."""
        return {
            "counts": dict(self.counts),
            "last": dict(self._last),
            "newest": _identity(self._newest),
            "events": self._events(),
        }

    def take_over(self, state: AgingState, place: dict[str, Any]) -> bool:
        """Go on from what was stored, until the history proves it wrong; return whether it can.

        Parameters
        ----------
        state : AgingState
            Its estimates.
        place : dict
            How far it was.
        """
        if list(place["counts"]) != list(self.counts):
            return False
        self._known, self._to_prove = state, place
        self.counts, self._last = dict(place["counts"]), dict(place["last"])
        return True

    @property
    def first_wanted(self) -> dict[str, int]:
        """First cycle to ask for, by estimator: of what is to be proved the newest again."""
        wanted = {name: last + 1 for name, last in self._last.items()}
        if self._to_prove:
            wanted[self._trend] = min(self._newest_known(), default=self.last())
        return wanted

    def _newest_known(self) -> list[int]:
        """Return the numbers of the newest estimates that feed the trend, rising."""
        newest: list[int] = self.past.trend.cycle[-self._again :].tolist()
        return newest

    def contradicts(self, estimates: list[Estimate]) -> bool:
        """Return whether the history, by its answer, is not the one that was stored.

        Parameters
        ----------
        estimates : list of Estimate
            Of the trend, from `first_wanted` on; the events that came with them are noted.
        """
        place, self._to_prove = self._to_prove, None
        if place is None:
            return False
        again = [e for e in estimates if e.cycle <= self.last()]
        if self._newest is None and again:
            self._newest = again[-1]
        same = [_identity(e) for e in again[-1:]] == [place["newest"]]
        numbers = [e.cycle for e in again if e.used_by_trend]
        late = numbers != self._newest_known()
        return late or not same or self._events() != place["events"]

    def _events(self) -> list[str]:
        """Return what tells the events up to the last cycle."""
        last = self.last()
        return sorted(repr(e) for e in self.maintenance.values() if e.cycle <= last)

    def note(self, event: Maintenance) -> bool:
        """Add a maintenance event, or its withdrawal; return whether that is new."""
        key = replace(event, withdrawn=False, withdrawn_note="")
        new = self.maintenance.get(key) != event
        self.maintenance[key] = event
        return new

    def receive(self, message: Any) -> None:
        """Keep an Estimate until it can be taken over."""
        if message.stored and message.estimator in self._received:
            number = int(message.cycle)
            if message.estimator == self._trend and number <= self.last():
                known = number in self._added or bool(np.any(self.past.trend.cycle == number))
                if not known and number not in self._sought:
                    self._sought.add(number)
                    self.late = True
            _keep(self._received[message.estimator], message)

    def receive_cycle(self, summary: Any) -> None:
        """Keep the summary of a closed cycle."""
        _keep(self._cycles, summary)

    def take(self) -> bool:
        """Take over all that follows on what is known; return whether anything did."""
        begin = self.counts[self._trend]
        self._forget()
        while self._received[self._trend] and not self.lacks:
            number = min(self._received[self._trend])
            if any(number not in m for m in (self._cycles, *self._received.values())):
                break
            missed = int(self._cycles[number].missed_cycles)
            for name, messages in self._received.items():
                self.add(name, [estimate_value(messages[number], missed)])
            self._forget()
        return self.counts[self._trend] > begin

    @property
    def waits(self) -> bool:
        """Whether an estimate was received that is not taken over."""
        return bool(self._received[self._trend])

    @property
    def lacks(self) -> bool:
        """Whether the history may hold cycles before the first that waits."""
        first = min(self._received[self._trend], default=0)
        between = range(self.last() + 1, first)
        return any(n not in self._cycles or self._cycles[n].accepted for n in between)

    def _forget(self) -> None:
        """Let go of what was received of cycles that are known."""
        last = self.last()
        for messages in (self._cycles, *self._received.values()):
            for number in [n for n in messages if n <= last]:
                del messages[number]


def _identity(estimate: Estimate | None) -> str:
    """Return what tells an estimate from any other."""
    if estimate is None:
        return ""
    values = [(p.name, p.value) for p in estimate.parameters]
    return repr((estimate.cycle, estimate.start_ns, estimate.end_ns, values))


def _keep(messages: dict[int, Any], message: Any) -> None:
    messages[int(message.cycle)] = message
    if len(messages) > MOST_WAITING:
        del messages[min(messages)]
