# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One valve of the twin node: its inputs to the core, what the core says to its subscribers.

A sample goes one way: `ValveInputs` (subscription, decode, gather) -> `Twin` (align, cut,
predict) -> `ValvePublishers`. A closed cycle becomes a job (`Jobs`); its estimates go back through
the `Twin` to the history (`HistoryWriter`) and, once stored, to the `ValvePublishers`.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from functools import partial
from typing import TYPE_CHECKING

from valve_twin.core.operation.counters import Counters, cycle_duty
from valve_twin.core.operation.step_metrics import measure_steps
from valve_twin.core.state import Announced
from valve_twin.core.twin import ClockJump, Estimated, Event
from valve_twin.core.types import Cycle, Estimate, Maintenance, Prediction
from valve_twin.core.valves.registry import get_model
from valve_twin.io.history.restart import Restart
from valve_twin.io.history.spool import CycleSpool
from valve_twin.io.offline.make_twin import make_twin
from valve_twin.nodes.twin.inputs import InputConfig, seconds_now
from valve_twin.nodes.twin.jobs import Jobs
from valve_twin.nodes.twin.publishers import ValvePublishers
from valve_twin.nodes.twin.valve_inputs import ValveInputs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.core.estimation.cycle.memory import Memory
    from valve_twin.core.job_queue import JobQueue, QueuedJob
    from valve_twin.io.cdr.signals import Extractor, SignalBlock
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.io.history.spool import MemoryBudget
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, WorkerProcess
    from valve_twin.nodes.twin.history.writer import HistoryWriter


JUMP_TOLD_S = 10.0
"""A jump of the clock is not told earlier again; all are counted [s]."""


class LiveValve:
    """One valve that is hosted.

    Parameters
    ----------
    node : ValveNode
        The twin node.
    config : ValveConfig
        The valve.
    signals : list of list of Extractor
        The signals by topic.
    history_writer : HistoryWriter
        The way into its history.
    worker : WorkerProcess
        Runs the estimations.
    awake : set of LiveValve
        Valves for which something waits; this one enters and leaves it.
    budget : MemoryBudget
        Memory for cycles that wait, shared by all valves.

    Attributes
    ----------
    inputs, publishers, jobs, cycle_queue
        Its parts: signals, publishers, estimations, and the way into the history.
    twin : Twin
        The core.
    last_cycle, last_stamp_ns : int
        Number of the last closed cycle [1], stamp of the newest sample [ns].
    jumps : int
        Jumps back of the clock [1].
    worst_latency_s : float
        Longest way of a sample to its prediction since the last look [s].
    counters : Counters
        What it has done, with the last estimated cycle.
    stopped : str
        Why it works no more, empty where it does.
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        signals: list[list[Extractor]],
        *,
        history_writer: HistoryWriter,
        worker: WorkerProcess,
        awake: set[LiveValve],
        budget: MemoryBudget,
    ) -> None:
        self._node, self.config, self._awake = node, config, awake
        self.name, self.history = config.name, history_writer.history
        self.model = get_model(config.model)
        self._claim = self.history.claim(self.name)
        history_writer.store_left(self.name)
        self._restart = Restart(
            self.history,
            config,
            self._claim,
            make=partial(make_twin, config),
            tell=node.get_logger().info,
        )
        self.twin, self.last_cycle = self._restart.twin, self._restart.last_cycle
        self.spool = self._queue_in(budget, history_writer)
        self.counters = self.history.log.counters(self.name) or Counters()
        self.publishers = ValvePublishers(node, config, self.model)
        self.publishers.count(self.counters)
        self.cycle_queue = history_writer.open(
            self.name, self.publishers.estimate, self.twin.number_from
        )
        self.jobs = Jobs(node, config, worker=worker, deliver=self._estimated)
        for event in self.history.maintenance(self.name):
            self.note(event)
        self.inputs = ValveInputs(
            node,
            config,
            signals,
            output=self.model.output,
            gather_s=self.publishers.gather_s,
            on_ready=self._on_ready,
        )
        self.last_stamp_ns = self.jumps = 0
        self.worst_latency_s = 0.0
        self.stopped = ""
        self._saving, self._saved, self._save_error = False, (0, 0), ""
        self._outcomes: deque[Outcome] = deque()

    def _queue_in(self, budget: MemoryBudget, writer: HistoryWriter) -> CycleSpool:
        """Let cycles wait for their estimation within the budget, else on disk."""
        path = self.history.snapshot_path(self.name)
        folder = None if path is None else path.with_name(f"{path.name}-cycles")
        if path is None and writer.unsaved is not None:
            folder = writer.unsaved.cycles_folder(self.name)
        spools: list[CycleSpool] = []

        def fill(jobs: Iterable[QueuedJob]) -> JobQueue:
            spools.append(CycleSpool(budget, folder, jobs, makes_parents=path is None))
            return spools[0]

        self.twin.queue_jobs(fill)
        if spools[0].left:
            self._node.get_logger().warning(
                f"{self.name}: {spools[0].left} cycles that waited on disk were not estimated "
                "before the process ended"
            )
        return spools[0]

    # -- life

    def listen(self, config: InputConfig) -> None:
        """Subscribe to all signals; cycles that waited for their estimation go first."""
        self.jobs.start(self.twin)
        self.inputs.listen(config)

    def silence(self) -> None:
        """Take the subscriptions down; what was learnt stays."""
        self.work(force=True)
        self.publishers.flush()
        self.inputs.silence()

    def note(self, event: Maintenance) -> None:
        """Take a maintenance event, stored or withdrawn, into account."""
        if event.new_reference:
            renewed = [n for n in self.jobs.renewed if n != event.cycle]
            self.jobs.renewed = renewed if event.withdrawn else [*renewed, event.cycle]

    def close(self) -> None:
        """Take the publishers down."""
        self.publishers.close()
        self.spool.close()

    def save(self) -> None:
        """Save what a restart goes on from, off the data path, where it has changed."""
        now = (self.last_stamp_ns, self.jobs.estimated)
        while self._outcomes:  # taken here: one that woke the node would cost as much as a save
            self._on_saved(self._outcomes.popleft())
        if self._saving or self.stopped or self.cycle_queue.waiting or now == self._saved:
            return
        if self._restart.is_resting or self.spool.spooled:
            return  # what is on disk would have to be read and written again every time
        saving = self._restart.saving()
        if saving is not None:
            self._saving, self._saved = True, now
            self.cycle_queue.writer.write_thread.submit(saving, self._outcomes.append)

    def save_last(self) -> None:
        """Save it for good, when nothing comes any more and all is stored."""
        if self.stopped:
            return
        if self.spool.spooled:
            self.spool.stay()
        saving = self._restart.saving()
        if saving is not None:
            saving()

    def flush(self) -> None:
        """Have the disk keep that over a power cut, too."""
        self.spool.flush()
        self._restart.flush()

    # -- data path

    def work(self, *, force: bool = False) -> None:
        """Hand what was gathered to the core and publish what comes of it."""
        now_s = seconds_now()
        if self.jobs.wait.is_over(now_s):
            self._step(self.twin.go_on)
        if now_s < self.inputs.due_s and not force:
            return
        before = self.publishers.predicted
        blocks = self.inputs.take(now_s, everything=force)
        oldest_ns = self.inputs.oldest_ns
        for parts in blocks:
            self._push(parts)
        if now_s >= self.publishers.due_s:
            self.publishers.flush()
        if not (self.inputs or self.publishers or self.jobs.wait.is_bounded):
            self._awake.discard(self)
        if self.publishers.predicted != before:
            self.inputs.answered()
            late_s = 1e-9 * (time.time_ns() - oldest_ns)
            self.worst_latency_s = max(self.worst_latency_s, late_s)

    def due_s(self) -> float:
        """Return when `work` is worth its while, after something came [s]."""
        return max(self.inputs.due_s - seconds_now(), 0.0)

    def clock_jumped(self) -> None:
        """Drop the running cycle after the node's clock was set back."""
        self.work(force=True)  # what came before belongs to it
        self._step(self._restart.give_up)
        self._step(self.twin.clock_jumped)

    def close_cycle(self) -> Cycle | None:
        """Close the running cycle on request; None where none runs."""
        self.work(force=True)
        self._step(self._restart.give_up)
        closed = [e for e in self._step(self.twin.close_cycle) if isinstance(e, Cycle)]
        return closed[-1] if closed else None

    def _on_ready(self, now: bool) -> None:
        """Wake up; work where the inputs say that it is time."""
        if now:
            self.inputs.due_s = 0.0
            self.work()
        elif self not in self._awake:
            self._wake()

    def _wake(self) -> None:
        self._awake.add(self)
        self.inputs.put_off(seconds_now())

    def _push(self, blocks: list[SignalBlock]) -> None:
        for block in blocks:
            if block.signal == self.model.output:
                self.last_stamp_ns = int(block.stamp_ns[-1])
            if not block.has_header:
                self.twin.mark_irreproducible()
        parts = [(b.signal, b.stamp_ns, b.values) for b in blocks]
        push = self._restart.push if self._restart.is_open else self.twin.push_round
        self._step(partial(push, parts))

    def _estimated(self, estimates: tuple[Estimate, ...], memory: Memory, wall_s: float) -> None:
        self._step(partial(self.twin.deliver, estimates, memory), wall_s)

    def _step(self, step: Callable[[], list[Event]], wall_s: float = 0.0) -> list[Event]:
        """Let the core take a step and hand on what it says; what raises stops this valve."""
        if self.stopped:
            return []
        try:
            events = step()
        except Exception as err:  # whatever a model raises is its own valve's trouble
            self._stop(err)
            return []
        for event in events:
            self._handle(event, wall_s)
        self.jobs.start(self.twin)
        self.jobs.wait.note(self.twin.waits, seconds_now())
        if (self.publishers or self.jobs.wait.is_bounded) and self not in self._awake:
            self._wake()
        return events

    def _handle(self, event: Event, wall_s: float) -> None:
        """Publish and store what the core says."""
        if isinstance(event, Prediction):
            self.publishers.predict(event)
            return
        self.publishers.flush()
        if isinstance(event, Cycle):
            self.last_cycle = event.number
            self._claim.announce(Announced(event.number, event.start_ns))
            self.publishers.close_cycle(event)
        elif isinstance(event, Estimated):
            self._restart.stored(event.cycle.number, event.cycle.start_ns)
            duty = cycle_duty(event.cycle, normalised=self.model.normalised)
            if duty is not None:
                self.counters = self.counters.after(duty)
            self.cycle_queue.add(event.cycle, event.estimates, wall_s, self.counters)
            self.jobs.run(measure_steps, (event.cycle, self.model.inputs), self._measured)
        elif isinstance(event, ClockJump):
            self._tell_jump(event.dropped_cycle)

    def _measured(self, outcome: Outcome) -> None:
        """Publish the step metrics of a cycle, which the worker has measured."""
        if self.stopped:
            return
        if outcome.error:
            self._node.get_logger().error(
                f"{self.name}: steps are not measured: {outcome.error}",
                throttle_duration_sec=JUMP_TOLD_S,
            )
            return
        self.publishers.steps(outcome.result)

    def _on_saved(self, outcome: Outcome) -> None:
        self._saving = False
        if outcome.error and not self._save_error:
            self._node.get_logger().warning(
                f"{self.name}: a restart would go on after the last stored cycle: {outcome.error}"
            )
        if self._save_error and not outcome.error:
            self._node.get_logger().info(f"{self.name}: a restart goes on inside the cycle again")
        self._save_error = outcome.error

    def _tell_jump(self, number: int) -> None:
        self.jumps += 1
        self.publishers.gaps.restart()
        dropped = f"cycle {number} is dropped" if number else "no cycle was running"
        self._node.get_logger().warning(
            f"{self.name}: the clock of the data was set back: {dropped}, what was learnt is kept",
            throttle_duration_sec=JUMP_TOLD_S,
        )

    def _stop(self, err: Exception) -> None:
        """Stop this valve, whose model raises; its neighbours go on."""
        self.stopped = (
            f"stopped: {type(err).__name__}: {err}; repair the model, then configure the node anew"
        )
        self._node.get_logger().error(f"{self.name}: {self.stopped}\n{traceback.format_exc()}")
        self._awake.discard(self)
        self._node.post(self.silence)
