# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One valve of the twin node: signals to the core, its events to topics and history."""

from __future__ import annotations

import time
import traceback
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from valve_twin_msgs import msg

from valve_twin.core.cycles import Announced
from valve_twin.core.estimation.cycle.sequence import MEMORY_CYCLES, Memory, memory_from_history
from valve_twin.core.gaps import GapCounter
from valve_twin.core.twin import ClockJump, Estimated, Event, Job
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Prediction
from valve_twin.core.valves.registry import get_model
from valve_twin.io.offline.assembly import make_twin
from valve_twin.nodes.runtime import messages as convert
from valve_twin.nodes.twin.collector import Collector
from valve_twin.nodes.twin.estimate_wait import EstimateWait, longest_wait_s
from valve_twin.nodes.twin.estimation_job import MEMORY_LACKS, run_job
from valve_twin.nodes.twin.inputs import InputConfig, TopicInput, seconds_now
from valve_twin.nodes.twin.keeper import where_to_go_on
from valve_twin.nodes.twin.prediction_batches import PredictionBatches, mean_period_s

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.io.cdr.signals import Extractor, SignalBlock
    from valve_twin.io.config.valve import ValveConfig
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome, Work, WorkerProcess
    from valve_twin.nodes.twin.keeper import Keeper, Kept

BACKLOG_NS = 1_000_000
"""A message that waited longer is worked on with all that waits behind it: low rates are
answered at once, in a rush whole blocks [ns]."""

LONGEST_GATHER_S = 0.02
"""No sample waits longer than this to be handed on [s]."""

GATHER_S = 0.25
"""Where predictions are collected, inputs are worked on this often at least: one round costs
hardly more than one sample [s]."""

SLICE_SHARE = 0.5
"""Data time handed on at once, as a share of the time by which the core waits for a signal [1]."""

_DEEP = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)
_DEEP_SERIES = QoSProfile(depth=300, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=10,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""State topics: a late reader of depth 1 gets the newest, a deeper one all estimators."""


def _names(group: list[Extractor]) -> set[str]:
    return {e.source.signal for e in group}


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
    keeper : Keeper
        The way into its history.
    worker : WorkerProcess
        Runs the estimations.
    awake : set of LiveValve
        Valves for which something waits; this one enters and leaves it.
    """

    def __init__(
        self,
        node: ValveNode,
        config: ValveConfig,
        signals: list[list[Extractor]],
        *,
        keeper: Keeper,
        worker: WorkerProcess,
        awake: set[LiveValve],
    ) -> None:
        self._node, self.config, self._worker = node, config, worker
        self.history = keeper.history
        self.name = config.name
        self.model = get_model(config.model)
        self._signals = signals
        self.units = convert.units_of(self.model.parameters)
        self._claim = self.history.claim(self.name)
        memory = memory_from_history(self.history.recent_estimates(self.name, MEMORY_CYCLES))
        last, resume = where_to_go_on(self.history, self._claim, self.name)
        self.twin = make_twin(config, memory=memory, last_cycle=last, resume=resume)
        self.kept = keeper.open(self.name, self._publish_estimates, self.twin.number_from)
        self._collector = Collector(config.signals, round(SLICE_SHARE * 1e9 * config.hold_back_s))
        self.inputs: list[TopicInput] = []
        self._job: Job | None = None
        self.wait = EstimateWait(
            longest_wait_s(node, (group[0].source.topic for group in signals))
        )
        self._jobs = 0
        self._awake = awake
        self._news, self._scheduled, self._due_s = 0, False, 0.0
        self._all_topics = (1 << len(signals)) - 1
        self._leading = next(
            i for i, group in enumerate(signals) if self.model.output in _names(group)
        )
        self.last_stamp_ns = 0
        self.last_cycle = last
        self.estimated = self.predicted = self.refused = 0
        self.stopped = ""
        self.estimation_s = self.worst_latency_s = 0.0
        self.gaps = GapCounter(config.period_s)
        self.jumps = self.failed = 0
        self.failure = ""
        batch_s = float(node.parameters["prediction_batch_s"])
        self._gather_s = min(batch_s, GATHER_S)
        self._batches = (
            PredictionBatches(batch_s, config.period_s, batch_s + self._gather_s)
            if batch_s > 0.0
            else None
        )
        self._open_publishers()

    # -- life

    def listen(self, config: InputConfig) -> None:
        """Subscribe to all signals."""
        now_ns = self._now_ns()
        self.inputs = [
            TopicInput(self._node, group, config, partial(self._arrive, i), self._gather, now_ns)
            for i, group in enumerate(self._signals)
        ]

    def silence(self) -> None:
        """Take the subscriptions down; what was learnt stays."""
        self.work(force=True)
        self._flush()
        for topic in self.inputs:
            topic.destroy()
        self.inputs = []

    def close(self) -> None:
        """Take the publishers down."""
        self._flush()
        for publisher in (self._prediction, self._cycle, self._estimate):
            self._node.destroy_publisher(publisher)

    # -- data path

    def work(self, *, force: bool = False) -> None:
        """Hand what was gathered to the core and publish what comes of it."""
        begin = seconds_now()
        if self.wait.is_over(begin):
            self.handle(self.twin.go_on())
        if begin < self._due_s and not force:
            return
        self._due_s = self._next_due_s(begin)
        for topic in self.inputs:
            topic.drain()
        oldest_ns, predicted = self._collector.oldest_ns, self.predicted
        for blocks in self._collector.take_all() if force else self._collector.take(begin):
            self._push(blocks)
        if self._batches and begin >= self._batches.due_s:
            self._flush()
        if not self._collector and not self._batches and not self.wait.is_bounded:
            self._awake.discard(self)
        if self.predicted == predicted:
            return
        self._news = 0
        self.worst_latency_s = max(self.worst_latency_s, 1e-9 * (time.time_ns() - oldest_ns))

    def due_s(self) -> float:
        """Return when `work` is worth its while, after something came [s]."""
        return max(self._due_s - seconds_now(), 0.0)

    def clock_jumped(self) -> None:
        """Drop the running cycle after the node's clock was set back."""
        self.work(force=True)  # what came before belongs to it
        self._flush()
        self.handle(self.twin.clock_jumped())

    def handle(self, events: Iterable[Event], wall_s: float = 0.0) -> None:
        """Publish and store what the core says."""
        for event in events:
            if isinstance(event, Prediction):
                self._publish_prediction(event)
                continue
            self._flush()
            if isinstance(event, Cycle):
                self.last_cycle = event.number
                self._claim.announce(Announced(event.number, event.start_ns))
                self._cycle.publish(convert.cycle_message(self.name, event))
            elif isinstance(event, Estimated):
                self.kept.add(event.cycle, event.estimates, wall_s)
            elif isinstance(event, ClockJump):
                self.jumps += 1
                self.gaps.restart()
                number = event.dropped_cycle
                dropped = f"cycle {number} is dropped" if number else "no cycle was running"
                self._node.get_logger().warning(
                    f"{self.name}: the clock of the data was set back: {dropped}, "
                    "what was learnt is kept"
                )
        self._start_job()
        self._mind_wait()

    def _gather(self, block: SignalBlock, received_ns: int) -> None:
        self._collector.add(block, received_ns, seconds_now())

    def _arrive(self, topic: int, received_ns: int) -> None:
        """Work once every topic has brought something, late ones together with what follows."""
        if self not in self._awake:
            self._wake()
        if self._batches is not None:
            return
        self._news |= 1 << topic
        if self._news == self._all_topics or topic == self._leading:
            if self._news == self._all_topics and time.time_ns() - received_ns < BACKLOG_NS:
                self._work_now()
            elif not self._scheduled:
                self._scheduled = True
                self._node.later(self._work_now)

    def _wake(self) -> None:
        self._awake.add(self)
        self._due_s = self._next_due_s(seconds_now())

    def _next_due_s(self, now_s: float) -> float:
        """Return until when samples are gathered; all valves that collect work at one time [s]."""
        if self._batches is None:
            return now_s + LONGEST_GATHER_S
        return (now_s // self._gather_s + 1.0) * self._gather_s

    def _work_now(self) -> None:
        self._scheduled = False
        self._due_s = 0.0
        self.work()

    def _push(self, blocks: list[SignalBlock]) -> None:
        if self.stopped:
            return
        for block in blocks:
            if block.signal == self.model.output:
                self.last_stamp_ns = int(block.stamp_ns[-1])
            if not block.has_header:
                self.twin.mark_irreproducible()
        try:
            events = self.twin.push_round([(b.signal, b.stamp_ns, b.values) for b in blocks])
        except Exception as err:  # whatever a model raises is its own valve's trouble
            self._stop(err)
            return
        if events:
            self.handle(events)
        else:
            self._mind_wait()

    def _mind_wait(self) -> None:
        """Stay awake while samples wait for an estimate, but not for ever."""
        self.wait.note(self.twin.waits, seconds_now())
        if self.wait.is_bounded and self not in self._awake:
            self._wake()

    def _stop(self, err: Exception) -> None:
        """Stop this valve, whose model raises; its neighbours go on."""
        self.stopped = (
            f"stopped: {type(err).__name__}: {err}; repair the model, then configure the node anew"
        )
        self._node.get_logger().error(f"{self.name}: {self.stopped}\n{traceback.format_exc()}")
        self._awake.discard(self)
        self._node.post(self.silence)

    def _publish_prediction(self, prediction: Prediction) -> None:
        self.predicted += len(prediction.stamp_ns)
        self.gaps.push(prediction.stamp_ns)
        if self._batches is not None:
            self._publish_series(self._batches.add(prediction, seconds_now()))
            if self._batches and self not in self._awake:
                self._wake()
            return
        if self._batched:
            for data in convert.series_bytes(prediction, self.config.period_s):
                self._prediction.publish(data)
            return
        publish = self._prediction.publish
        for data in convert.prediction_bytes(prediction):
            publish(data)

    def _flush(self) -> None:
        """Publish the predictions that were collected."""
        if self._batches:
            self._publish_series(self._batches.flush())

    def _publish_series(self, series: Iterable[Prediction]) -> None:
        for prediction in series:
            period_s = mean_period_s(prediction, self.config.period_s)
            for data in convert.series_bytes(prediction, period_s):
                self._prediction.publish(data)

    # -- estimation

    def in_worker(
        self, work: Work, arguments: tuple[Any, ...], deliver: Callable[[Outcome], None]
    ) -> None:
        """Run a module-level function behind the estimations due; `deliver` runs on the loop."""
        post = self._node.post
        self._worker.submit(work, arguments, lambda done: post(partial(deliver, done)))

    def _start_job(self) -> None:
        if self._job is not None:
            return
        self._job = self.twin.next_job()
        if self._job is not None:
            self._jobs += 1
            self._submit(None)

    def _submit(self, memory: Memory | None) -> None:
        assert self._job is not None
        arguments = (
            self.name, self.config.model, self.config.options, self._job.cycle, self._jobs, memory
        )  # fmt: skip
        post = self._node.post
        self._worker.submit(run_job, arguments, lambda done: post(partial(self._deliver, done)))

    def _deliver(self, outcome: Outcome) -> None:
        job = self._job
        if job is None:
            return
        if not outcome.error and outcome.result is MEMORY_LACKS:
            self._submit(job.memory)
            return
        self._job = None
        estimates: tuple[Estimate, ...] = () if outcome.error else outcome.result
        if outcome.error:
            self.failed += 1
            self.failure = f"cycle {job.cycle.number} is not estimated: {outcome.error}"
            self._node.get_logger().error(f"{self.name}: {self.failure}")
        memory = job.memory.after(estimates) if estimates else job.memory
        self.estimated += 1
        self._judge(job.cycle.number, estimates)
        self.estimation_s = outcome.wall_s
        try:
            events = self.twin.deliver(estimates, memory)
        except Exception as err:  # whatever a model raises is its own valve's trouble
            self._stop(err)
            return
        self.handle(events, outcome.wall_s)

    def _judge(self, number: int, estimates: tuple[Estimate, ...]) -> None:
        """Count a cycle that gave nothing for the trend; several in a row are a fault."""
        faults, code = self._node.faults, "estimation.refused"
        good = [e for e in estimates if e.status is not EstimateStatus.REFUSED]
        if any(e.used_by_trend for e in good):
            faults.passed(code, valve=self.name)
            return
        self.refused += 1
        reason = next((e.reason for e in estimates), self.failure)
        faults.report(code, f"cycle {number} gives no estimate: {reason}", valve=self.name)

    # -- history

    @property
    def unsaved(self) -> int:
        """Cycles that are not in the history yet."""
        return self.kept.waiting

    @property
    def stored(self) -> int:
        """Cycles stored in this run."""
        return self.kept.stored

    @property
    def store_error(self) -> str:
        """Why the history does not take cycles, empty where it does."""
        return self.kept.keeper.error

    def _publish_estimates(self, kept: Kept, stored: bool) -> None:
        """Publish a cycle's estimates; the one that feeds the trend last, to be latched."""
        trend = self.model.trend_estimator
        for estimate in sorted(kept.estimates, key=lambda e: e.estimator == trend):
            self._estimate.publish(
                convert.estimate_message(
                    self.name, estimate, self.units, stored=stored, wall_s=kept.wall_s
                )
            )

    # -- wiring

    def _open_publishers(self) -> None:
        batched = self.config.signals[self.model.output].batched
        self._batched = batched or self._batches is not None
        kind = msg.PredictionSeries if self._batched else msg.Prediction
        node, base = self._node, f"{self.name}/twin"
        depth = _DEEP_SERIES if self._batched else _DEEP
        self._prediction = node.create_publisher(kind, f"{base}/prediction", depth)
        self._cycle = node.create_publisher(msg.CycleSummary, f"{base}/cycle", LATCHED)
        self._estimate = node.create_publisher(msg.Estimate, f"{base}/estimate", LATCHED)

    def _now_ns(self) -> Any:
        """Return the receive clock: the node's; simulated time is 0 before the first /clock."""
        if not self._node.get_parameter("use_sim_time").value:
            return time.time_ns
        clock = self._node.get_clock()
        return lambda: clock.now().nanoseconds
