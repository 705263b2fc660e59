# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The way of cycles into the history, in good times and bad.

One writer serves all valves of one history. Cycles are stored one at a time, in the order in which
they were estimated, on a thread of their own: the data path never waits for the database. While
it refuses, estimates are published as not stored and kept in memory, up to a limit; when it takes
them again, they are published once more, as stored.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin import __version__
from valve_twin.io.history.store import cycle_record
from valve_twin.io.history.unsaved import Taken, UnsavedCycle, store_one, store_waiting
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.worker import WorkerThread
from valve_twin.nodes.twin.history.flusher import Flusher
from valve_twin.nodes.twin.inputs import seconds_now

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from valve_twin.core.operation.counters import Counters
    from valve_twin.core.types import Cycle, Estimate
    from valve_twin.io.history.store import CycleRecord, History
    from valve_twin.io.history.unsaved import UnsavedCycles
    from valve_twin.nodes.runtime.worker import Outcome

Publish = Callable[["QueuedCycle", bool], None]
"""Publish the estimates of a cycle; whether they are stored."""

FLUSH_S = 1.0
"""Time that is given to the disk at the end [s]."""

WATCH_S = 5.0
"""How often the database's file is looked at while nothing is stored [s]."""


@dataclass(slots=True, eq=False)
class QueuedCycle:
    """One cycle on its way to the history.

    Attributes
    ----------
    valve : CycleQueue
        Whose it is.
    record : CycleRecord
        The cycle.
    estimates : tuple of Estimate
        One an estimator.
    wall_s : float
        Computing time [s].
    counters : Counters or None
        The valve's, with this cycle.
    was_published : bool
        Whether it was published as not stored.
    file : Path or None
        Where it is kept on disk.
    is_shed : bool
        Whether its estimates are there only.
    is_flushed : bool
        Whether a power cut leaves that file.
    """

    valve: CycleQueue
    record: CycleRecord
    estimates: tuple[Estimate, ...]
    wall_s: float
    counters: Counters | None = None
    was_published: bool = False
    file: Path | None = None
    is_shed: bool = False
    is_flushed: bool = False

    def shed(self) -> None:
        """Keep on disk only what is kept there."""
        self.is_shed, self.estimates, self.counters = True, (), None


class CycleQueue:
    """The cycles of one valve on their way to its history.

    Parameters
    ----------
    writer : HistoryWriter
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
    flushed : int
        Of those that wait, the ones that a power cut leaves on disk [1].
    dropped, refused : int
        Cycles that were lost: beyond the limit, and under a number that was taken [1].
    """

    def __init__(
        self,
        writer: HistoryWriter,
        name: str,
        publish: Publish,
        number_from: Callable[[int], None],
    ) -> None:
        self.writer, self.name = writer, name
        self.publish, self.number_from = publish, number_from
        self.waiting = self.stored = self.dropped = self.refused = self.flushed = 0

    def add(
        self,
        cycle: Cycle,
        estimates: tuple[Estimate, ...],
        wall_s: float,
        counters: Counters | None = None,
    ) -> None:
        """Store a cycle when its turn comes.

        Parameters
        ----------
        cycle : Cycle
            The cycle, also a refused one.
        estimates : tuple of Estimate
            One an estimator; empty for a refused cycle.
        wall_s : float
            Computing time of the estimation [s].
        counters : Counters, optional
            The valve's, with this cycle.
        """
        self.waiting += 1
        record = cycle_record(cycle, __version__)
        self.writer.add(QueuedCycle(self, record, estimates, wall_s, counters))


class HistoryWriter:
    """Writes the cycles of all valves of one history.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    history : History
        Open for writing.
    retry_s : float
        Pause before a refused cycle is offered again [s].
    limit : int
        Cycles kept in memory at most; beyond it the oldest are on disk only, else dropped [1].
    unsaved : UnsavedCycles, optional
        Keeps cycles on disk while the history refuses them.
    """

    def __init__(
        self,
        node: ValveNode,
        history: History,
        *,
        retry_s: float,
        limit: int,
        unsaved: UnsavedCycles | None = None,
    ) -> None:
        self._node, self.history, self.unsaved = node, history, unsaved
        self._shed = 0
        self._retry_s, self._limit = retry_s, limit
        self._waiting: deque[QueuedCycle] = deque()
        self._storing: QueuedCycle | None = None
        self._busy = False
        self._timer: Any = None
        self._watch = node.create_timer(WATCH_S, self._check_database, clock=STEADY)
        self._closed = False
        self.error = ""
        self.since_s = 0.0
        self._flusher = None if unsaved is None else Flusher(node, unsaved, self._on_flushed)
        self.write_thread = WorkerThread("history")
        self.read_thread = WorkerThread("history reader")

    def open(self, name: str, publish: Publish, number_from: Callable[[int], None]) -> CycleQueue:
        """Return the queue of one valve.

        Parameters
        ----------
        name : str
            The valve.
        publish : callable
            Publishes a cycle's estimates, with whether they are stored.
        number_from : callable
            Gets the last cycle number of the history where a number turned out to be taken.
        """
        return CycleQueue(self, name, publish, number_from)

    def store_left(self, name: str) -> None:
        """Store what an earlier twin of a valve could not, before the next one begins.

        Raises
        ------
        StoreError
            If the history refuses it still.
        """
        left = store_waiting(self.history, self.unsaved, name) if self.unsaved else None
        for line in left.taken if left else ():
            self._node.get_logger().error(line)
        if left and (left.stored or left.lost):
            self._node.get_logger().warning(f"{name}: {left}")

    def add(self, queued: QueuedCycle) -> None:
        """Store a cycle after all earlier ones."""
        self._waiting.append(queued)
        if self.error:
            self._keep(queued)
            self._publish_unstored(queued)
        self._drop_excess()
        self._next()

    def close(
        self,
        timeout_s: float,
        when_stored: Callable[[], None] = lambda: None,
        when_closed: Callable[[], None] = lambda: None,
        *,
        save_s: float = 0.0,
    ) -> int:
        """Store what waits within the time given, close the history; return how many are lost.

        Parameters
        ----------
        timeout_s : float
            The time [s].
        when_stored : callable
            Called, on the writer's thread, if nothing was lost.
        when_closed : callable
            Called there after that and when the history is closed.
        save_s : float
            Time beside for both [s].
        """
        self._closed = True
        for timer in (self._timer, self._watch):
            if timer is not None:
                self._node.destroy_timer(timer)
        if self._storing is not None:  # to store it twice does no harm
            self._waiting.appendleft(self._storing)
        rest, end_s = tuple(self._waiting), seconds_now() + timeout_s

        def store_rest() -> None:
            for queued in rest:
                if seconds_now() > end_s:
                    return
                taken = self._store(queued)
                if taken is not None:
                    self._tell_taken(queued, taken)
                self._waiting.popleft()
                _forget(queued)
            when_stored()

        self.read_thread.close(0.0)
        self.write_thread.submit(store_rest, lambda _: None)
        self.write_thread.submit(self.history.close, lambda _: None)  # never while it is in use
        self.write_thread.submit(when_closed, lambda _: None)
        self.write_thread.close(timeout_s + save_s)
        left = tuple(self._waiting)
        for queued in left:
            self._keep(queued)
        if self._flusher is not None and not self._flusher.close(FLUSH_S):
            self._node.get_logger().warning(
                f"{self._flusher.folder}: the disk is slow: a power cut now may cost cycles that "
                "wait there"
            )
        return sum(queued.file is None for queued in left)

    def _next(self) -> None:
        """Store the oldest cycle; one at a time keeps the order."""
        if self._busy or self._timer is not None or self._closed:
            return
        if self._waiting:
            self._storing = queued = self._waiting.popleft()
            self._shed -= queued.is_shed
            work = partial(self._store, queued)
            self._submit(work, partial(self._on_stored, queued))
        elif self.error:
            self._check_database()

    def _store(self, queued: QueuedCycle) -> Taken | None:
        """Store a cycle, on the writer's thread."""
        cycle = UnsavedCycle(queued.record, queued.estimates, queued.counters)
        kept = queued.file if queued.is_shed else None
        stored = store_one(self.history, queued.valve.name, cycle, self.unsaved, kept)
        if isinstance(stored, Taken):
            return stored
        queued.estimates = tuple(stored.estimates)
        return None

    def _check_database(self) -> None:
        """See whether the database's file is still there, without a cycle to store."""
        if not self._busy and self._timer is None:
            self._submit(self.history.repair, self._on_checked)

    def _submit(self, work: Callable[[], object], done: Callable[[Outcome], None]) -> None:
        self._busy = True
        self.write_thread.submit(
            work, lambda outcome: self._node.post(partial(self._take, done, outcome))
        )

    def _take(self, done: Callable[[Outcome], None], outcome: Outcome) -> None:
        if self._closed:
            return
        self._busy, self._storing = False, None
        while self.history.notices:
            self._node.get_logger().warning(self.history.notices.popleft())
        done(outcome)
        self._next()

    def _on_checked(self, outcome: Outcome) -> None:
        if outcome.error:
            self._refuse(outcome.error)
        else:
            self._recover()

    def _on_stored(self, queued: QueuedCycle, outcome: Outcome) -> None:
        taken: Taken | None = outcome.result
        if outcome.error:
            self._waiting.appendleft(queued)
            self._shed += queued.is_shed
            self._refuse(outcome.error)
            self._drop_excess()
            return
        queued.valve.waiting -= 1
        queued.valve.flushed -= queued.is_flushed
        _forget(queued)
        if taken is not None:
            self._give_up(queued, taken)
        else:
            queued.valve.stored += 1
            queued.valve.publish(queued, True)
        self._recover()

    def _refuse(self, error: str) -> None:
        """Keep what waits and try again later."""
        if not self.error:
            self.since_s = seconds_now()
            self._node.get_logger().error(f"not stored, kept and tried again: {error}")
        self.error = error
        has_room = True
        for queued in self._waiting:  # on disk before it is told: whoever hears of it may end us
            has_room = has_room and (self.unsaved is None or self._keep(queued))
            self._publish_unstored(queued)
        self._timer = self._node.create_timer(self._retry_s, self._retry, clock=STEADY)

    def _retry(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        self._next()

    def _recover(self) -> None:
        if self.error and not self._waiting:
            self.error = ""
            self._node.get_logger().info("all cycles are stored again")

    def _give_up(self, queued: QueuedCycle, taken: Taken) -> None:
        """Go on without a cycle whose number another one has."""
        queued.valve.refused += 1
        self._publish_unstored(queued)
        queued.valve.number_from(taken.last_cycle)
        self._tell_taken(queued, taken)

    def _tell_taken(self, queued: QueuedCycle, taken: Taken) -> None:
        self._node.get_logger().error(
            f"{queued.valve.name}: cycle {queued.record.cycle} is not stored: {taken.error}"
        )

    def _drop_excess(self) -> None:
        """Let go of the oldest cycles beyond the limit, which are kept on disk or lost."""
        while len(self._waiting) - self._shed > self._limit:
            # one that was being stored comes back before those that are on disk only
            at = self._shed if self._waiting[0].is_shed else 0
            queued = self._waiting[at]
            if not self._keep(queued):
                del self._waiting[at]
                self._drop(queued)
            else:
                self._publish_unstored(queued)
                queued.shed()
                self._shed += 1

    def _keep(self, queued: QueuedCycle) -> bool:
        """Keep what is not stored on disk, if there is a place for it; return whether it is."""
        if self._flusher is None:
            return False
        if queued.file is not None:
            if queued.is_shed or queued.file.exists():
                return True
            queued.valve.flushed -= queued.is_flushed
            _forget(queued)  # the folder was deleted or replaced
        cycle = UnsavedCycle(queued.record, queued.estimates, queued.counters)
        queued.file = self._flusher.put(queued, queued.valve.name, cycle)
        return queued.file is not None

    def _on_flushed(self, flushed: Iterable[tuple[QueuedCycle, bool]]) -> None:
        """Count what a power cut leaves; write anew what the disk lost."""
        for queued, is_flushed in flushed:
            if queued.file is None:  # stored meanwhile
                continue
            queued.valve.flushed += is_flushed - queued.is_flushed
            queued.is_flushed = is_flushed
            if not (is_flushed or queued.is_shed):
                _forget(queued)

    def _drop(self, queued: QueuedCycle) -> None:
        queued.valve.waiting -= 1
        queued.valve.dropped += 1
        self._publish_unstored(queued)
        if queued.valve.dropped == 1:
            self._node.get_logger().error(
                f"{queued.valve.name}: {self._limit} cycles wait for the history, more are not "
                f"kept: cycle {queued.record.cycle} and older ones are lost"
            )

    def _publish_unstored(self, queued: QueuedCycle) -> None:
        """Publish once, as not stored, what is not stored."""
        if not queued.was_published:
            queued.was_published = True
            queued.valve.publish(queued, False)


def _forget(queued: QueuedCycle) -> None:
    """Let go of what is kept on disk of a cycle."""
    if queued.file is not None:
        _unlink(queued.file)
    queued.file, queued.is_flushed = None, False


def _unlink(file: Path) -> None:
    with suppress(OSError):  # it is stored once more at the next start, which does nothing
        file.unlink(missing_ok=True)
