# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The way of cycles into the history, in good times and bad.

One keeper serves all valves of one history. Cycles are stored one at a time, in the order in which
they were estimated, on a thread of their own: the data path never waits for the database. While
it refuses, estimates are published as not stored and kept in memory, up to a limit; when it takes
them again, they are published once more, as stored.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin import __version__
from valve_twin.core.state import Resume
from valve_twin.io.history.store import CycleTakenError, History, cycle_record
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.worker import WorkerThread
from valve_twin.nodes.twin.inputs import seconds_now

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle, Estimate
    from valve_twin.io.history.claim import Claim
    from valve_twin.io.history.store import CycleRecord
    from valve_twin.nodes.runtime.worker import Outcome

WATCH_S = 5.0
"""How often the database's file is looked at while nothing is stored [s]."""

Publish = Callable[["Kept", bool], None]
"""Publish the estimates of a cycle; whether they are stored."""


@dataclass(slots=True)
class Kept:
    """One cycle on its way to the history.

    Attributes
    ----------
    valve : KeptValve
        Whose it is.
    record : CycleRecord
        The cycle.
    estimates : tuple of Estimate
        One an estimator.
    wall_s : float
        Computing time [s].
    told : bool
        Whether it was published as not stored.
    """

    valve: KeptValve
    record: CycleRecord
    estimates: tuple[Estimate, ...]
    wall_s: float
    told: bool = False


class KeptValve:
    """One valve whose cycles are kept.

    Parameters
    ----------
    keeper : Keeper
        Of its history.
    name : str
        The valve.
    publish : callable
        Publishes a cycle's estimates.
    number_from : callable
        Told the last cycle number of the history where a number turned out to be taken.

    Attributes
    ----------
    waiting, stored : int
        Cycles that are not in the history yet, and that were stored [1].
    dropped, refused : int
        Cycles that were lost: beyond the limit, and under a number that was taken [1].
    """

    def __init__(
        self,
        keeper: Keeper,
        name: str,
        publish: Publish,
        number_from: Callable[[int], None],
    ) -> None:
        self.keeper, self.name = keeper, name
        self.publish, self.number_from = publish, number_from
        self.waiting = self.stored = self.dropped = self.refused = 0

    def add(self, cycle: Cycle, estimates: tuple[Estimate, ...], wall_s: float) -> None:
        """Store a cycle when its turn comes.

        Parameters
        ----------
        cycle : Cycle
            The cycle, also a refused one.
        estimates : tuple of Estimate
            One an estimator; empty for a refused cycle.
        wall_s : float
            Computing time of the estimation [s].
        """
        self.waiting += 1
        self.keeper.add(Kept(self, cycle_record(cycle, __version__), estimates, wall_s))


class Keeper:
    """The way into one history.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    history : History
        Open for writing.
    retry_s : float
        Pause before a refused cycle is offered again [s].
    limit : int
        Cycles kept in memory at most; beyond it the oldest are dropped [1].
    """

    def __init__(self, node: ValveNode, history: History, *, retry_s: float, limit: int) -> None:
        self._node, self.history = node, history
        self._retry_s, self._limit = retry_s, limit
        self._waiting: deque[Kept] = deque()
        self._storing: Kept | None = None
        self._busy = False
        self._timer: Any = None
        self._watch = node.create_timer(WATCH_S, self._look, clock=STEADY)
        self._closed = False
        self.error = ""
        self.since_s = 0.0
        self.writer = WorkerThread("history")
        self.reader = WorkerThread("history reader")

    def open(self, name: str, publish: Publish, number_from: Callable[[int], None]) -> KeptValve:
        """Return the way of one valve into the history.

        Parameters
        ----------
        name : str
            The valve.
        publish : callable
            Publishes a cycle's estimates, with whether they are stored.
        number_from : callable
            Gets the last cycle number of the history where a number turned out to be taken.
        """
        return KeptValve(self, name, publish, number_from)

    def add(self, kept: Kept) -> None:
        """Store a cycle after all earlier ones."""
        self._waiting.append(kept)
        if self.error:
            self._tell(kept)
        self._bound()
        self._next()

    def close(self, timeout_s: float) -> int:
        """Store what waits within the time given, close the history; return how many are lost."""
        self._closed = True
        for timer in (self._timer, self._watch):
            if timer is not None:
                self._node.destroy_timer(timer)
        if self._storing is not None:  # to store it twice does no harm
            self._waiting.appendleft(self._storing)
        rest, end_s = tuple(self._waiting), seconds_now() + timeout_s

        def store_rest() -> None:
            for kept in rest:
                if seconds_now() > end_s:
                    return
                _store(self.history, kept)
                self._waiting.popleft()

        self.reader.close(0.0)
        self.writer.submit(store_rest, lambda _: None)
        self.writer.submit(self.history.close, lambda _: None)  # never while it is in use
        self.writer.close(timeout_s)
        return len(self._waiting)

    def _next(self) -> None:
        """Store the oldest cycle; one at a time keeps the order."""
        if self._busy or self._timer is not None or self._closed:
            return
        if self._waiting:
            self._storing = kept = self._waiting.popleft()
            self._submit(partial(_store, self.history, kept), partial(self._on_stored, kept))
        elif self.error:
            self._look()

    def _look(self) -> None:
        """See whether the database's file is still there, without a cycle to store."""
        if not self._busy and self._timer is None:
            self._submit(self.history.mend, self._on_looked)

    def _submit(self, work: Callable[[], object], done: Callable[[Outcome], None]) -> None:
        self._busy = True
        self.writer.submit(
            work, lambda outcome: self._node.post(partial(self._take, done, outcome))
        )

    def _take(self, done: Callable[[Outcome], None], outcome: Outcome) -> None:
        if self._closed:
            return
        self._busy, self._storing = False, None
        done(outcome)
        while self.history.notices:
            self._node.get_logger().warning(self.history.notices.popleft())
        self._next()

    def _on_looked(self, outcome: Outcome) -> None:
        if outcome.error:
            self._refuse(outcome.error)
        else:
            self._recover()

    def _on_stored(self, kept: Kept, outcome: Outcome) -> None:
        taken: _Taken | None = outcome.result
        if outcome.error:
            self._waiting.appendleft(kept)
            self._bound()
            self._refuse(outcome.error)
            return
        kept.valve.waiting -= 1
        if taken is not None:
            self._give_up(kept, taken)
        else:
            kept.valve.stored += 1
            kept.valve.publish(kept, True)
        self._recover()

    def _refuse(self, error: str) -> None:
        """Keep what waits and try again later."""
        if not self.error:
            self.since_s = seconds_now()
            self._node.get_logger().error(f"not stored, kept and tried again: {error}")
        self.error = error
        for kept in self._waiting:
            self._tell(kept)
        self._timer = self._node.create_timer(self._retry_s, self._retry, clock=STEADY)

    def _retry(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        self._next()

    def _recover(self) -> None:
        if self.error and not self._waiting:
            self.error = ""
            self._node.get_logger().info("all cycles are stored again")

    def _give_up(self, kept: Kept, taken: _Taken) -> None:
        """Go on without a cycle whose number another one has."""
        kept.valve.refused += 1
        self._tell(kept)
        kept.valve.number_from(taken.last_cycle)
        self._node.get_logger().error(
            f"{kept.valve.name}: cycle {kept.record.cycle} is not stored: {taken.error}"
        )

    def _bound(self) -> None:
        """Let go of the oldest cycles beyond the limit."""
        while len(self._waiting) > self._limit:
            self._drop(self._waiting.popleft())

    def _drop(self, kept: Kept) -> None:
        kept.valve.waiting -= 1
        kept.valve.dropped += 1
        self._tell(kept)
        if kept.valve.dropped == 1:
            self._node.get_logger().error(
                f"{kept.valve.name}: {self._limit} cycles wait for the history, more are not kept:"
                f" cycle {kept.record.cycle} and older ones are lost"
            )

    def _tell(self, kept: Kept) -> None:
        """Publish once what is not stored."""
        if not kept.told:
            kept.told = True
            kept.valve.publish(kept, False)


def where_to_go_on(history: History, claim: Claim, valve: str) -> tuple[int, Resume | None]:
    """Return the number of the last stored cycle and what else is known of it.

    Parameters
    ----------
    history : History
        Open for writing.
    claim : Claim
        On the valve's cycles; knows the last one that was announced, stored or not.
    valve : str
        Name of the valve.

    Returns
    -------
    last_cycle : int
        Number of the last stored cycle [1], 0 if there is none.
    resume : Resume or None
        Its begin and end [ns] and what was announced; None where nothing is known.
    """
    last = history.last_record(valve)
    if last is not None:
        return last.cycle, Resume(last.start_ns, last.end_ns, claim.announced)
    return 0, Resume(announced=claim.announced) if claim.announced.number else None


@dataclass(frozen=True, slots=True)
class _Taken:
    error: str
    last_cycle: int


def _store(history: History, kept: Kept) -> _Taken | None:
    """Store a cycle on the writer's thread.

    Raises
    ------
    StoreError
        If it is worth trying again.
    """
    try:
        history.store(kept.valve.name, kept.record, kept.estimates)
    except CycleTakenError as err:
        return _Taken(str(err), history.last_cycle(kept.valve.name))
    return None
