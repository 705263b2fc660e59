# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bag recorder node: topics to an MCAP bag that survives a power cut."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import msg, srv

from valve_twin.io.bag_writer import BagWriter
from valve_twin.nodes.recorded_topic import QueuedMessage, RecordedTopic
from valve_twin.nodes.runtime import SPIN_S, STEADY, ValveNode
from valve_twin.nodes.worker import Outcome, WorkerThread

if TYPE_CHECKING:
    from collections.abc import Callable

DISCOVERY_S = 0.25
"""How often new topics are looked for [s]."""

CLOSE_S = 1.5
"""Time that is given to the disk at the end [s]."""

_INTERNAL = ("/rosout", "/parameter_events")


@dataclass(slots=True)
class _Queue:
    """Messages on their way to the disk."""

    limit: int
    waiting: list[QueuedMessage] = field(default_factory=list)
    writing: bool = False
    dirty: bool = False


class BagRecorderNode(ValveNode):
    """Lifecycle node that records one bag."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bag_recorder", **kwargs)
        self._topics: dict[str, RecordedTopic] = {}
        self._writer: BagWriter | None = None
        self._thread: WorkerThread | None = None
        self._queue = _Queue(0)
        self._timers_made: list[Any] = []
        self._status: Any = None
        self._paused = False
        self._refused: set[str] = set()
        for kind, name, callback in (
            (srv.Pause, "pause", self._on_pause),
            (srv.Resume, "resume", self._on_resume),
            (srv.TogglePaused, "toggle_paused", self._on_toggle),
            (srv.IsPaused, "is_paused", self._on_is_paused),
        ):
            self.create_service(kind, f"~/{name}", callback)

    def configure(self) -> None:
        """Make the bag."""
        self.parameters.warn_unknown(hosts_valves=False)
        self.parameters.check()
        now = datetime.now(timezone.utc).strftime("%Y%m%d_%H%M%S")
        path = str(self.parameters["bag"]) or f"valve_twin_{now}"
        self._writer = BagWriter(path, flush_s=float(self.parameters["flush_s"]))
        self._thread = WorkerThread("bag")
        self._queue = _Queue(int(self.parameters["queue"]))
        self._status = self.create_publisher(msg.RecorderStatus, "~/status", 10)

    def activate(self) -> None:
        """Subscribe to what is there and to what comes."""
        self._discover()
        flush_s = float(self.parameters["flush_s"])
        self._timers_made = [
            self.create_timer(DISCOVERY_S, self._discover, clock=STEADY),
            self.create_timer(flush_s, self._flush, clock=STEADY),
            self.create_timer(1.0, self._publish_status, clock=STEADY),
        ]

    def deactivate(self) -> None:
        """Stop listening."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        self._timers_made = []
        for topic in self._topics.values():
            topic.silence()

    def cleanup(self) -> None:
        """Write what waits and finish the file."""
        if self._thread is not None and self._writer is not None:
            writer, rest = self._writer, self._queue.waiting
            losses = {
                f"lost {t.name}": t.lost_transport + t.lost_recorder for t in self._topics.values()
            }
            self._queue = _Queue(0)
            self._thread.submit(partial(_finish, writer, rest, losses), self._on_finished)
            if not self._thread.close(CLOSE_S):
                self.get_logger().error(
                    f"{writer.path}: the disk is too slow, the file is not finished"
                )
        if self._status is not None:
            self.destroy_publisher(self._status)
        self._topics, self._writer, self._thread, self._status = {}, None, None, None

    # -- data path

    def work(self) -> None:
        """Hand what was received to the disk's thread; one batch at a time."""
        queue = self._queue
        if not queue.waiting or queue.writing or self._writer is None:
            return
        batch, queue.waiting = queue.waiting, []
        self._to_disk(partial(_write, self._writer, batch))

    def due_s(self) -> float:
        """Return when `work` wants to be called [s]."""
        return SPIN_S

    def _to_disk(self, work: Callable[[], object]) -> None:
        if self._thread is None:
            return
        self._queue.writing = self._queue.dirty = True
        self._thread.submit(work, lambda outcome: self.post(partial(self._on_written, outcome)))

    def _on_message(self, message: QueuedMessage, topic: RecordedTopic) -> None:
        if self._paused:
            return
        if len(self._queue.waiting) >= self._queue.limit:
            topic.lost_recorder += 1
            return
        self._queue.waiting.append(message)

    def _on_written(self, outcome: Outcome) -> None:
        self._queue.writing = False
        if outcome.error:
            self.get_logger().error(f"not recorded: {outcome.error}")
            self.trigger_deactivate()

    def _on_finished(self, outcome: Outcome) -> None:
        if outcome.error:
            self.get_logger().error(f"the bag is not finished: {outcome.error}")

    def _flush(self) -> None:
        """Put the last messages on disk when no further ones come."""
        queue = self._queue
        if queue.dirty and not queue.writing and not queue.waiting and self._writer is not None:
            self._to_disk(self._writer.flush)
            queue.dirty = False

    # -- discovery

    def _discover(self) -> None:
        for topic in self._topics.values():
            topic.only_publisher = self.count_publishers(topic.name) <= 1
        wanted = {self.resolve_topic_name(t) for t in self.parameters["topics"] if t}
        for name, types in self.get_topic_names_and_types():
            if name in self._topics or name in self._refused or not self._is_wanted(name, wanted):
                continue
            if not self.count_publishers(name):
                continue
            self._add(name, types[0])

    def _is_wanted(self, name: str, wanted: set[str]) -> bool:
        if self.parameters["all"]:
            return True
        if wanted:
            return name in wanted
        own = f"{self.get_namespace().rstrip('/')}/"
        return own in name and name not in _INTERNAL

    def _add(self, name: str, kind: str) -> None:
        """Record one more topic; what cannot be recorded is named once."""
        writer = self._writer
        assert writer is not None
        try:
            self._topics[name] = RecordedTopic(self, name, kind, self._on_message)
        except KeyError:
            self._refused.add(name)
            self.get_logger().warning(
                f"topic '{name}' is not recorded: message type {kind} is not installed"
            )
            return
        offered = self._topics[name].offered
        self._to_disk(partial(writer.add_topic, name, kind, qos=offered))
        self.get_logger().info(f"recording {name}")

    def _publish_status(self) -> None:
        writer = self._writer
        if writer is None or self._status is None:
            return
        counts = writer.counts
        names = sorted(self._topics)
        message = msg.RecorderStatus(
            uri=str(writer.path),
            paused=self._paused,
            topics=names,
            messages=[counts.get(n, 0) for n in names],
            lost_transport=[self._topics[n].lost_transport for n in names],
            lost_recorder=[self._topics[n].lost_recorder for n in names],
            bytes=writer.size,
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._status.publish(message)

    # -- services

    def _on_pause(self, request: Any, response: Any) -> Any:
        del request
        self._paused = True
        return response

    def _on_resume(self, request: Any, response: Any) -> Any:
        del request
        self._paused = False
        return response

    def _on_toggle(self, request: Any, response: Any) -> Any:
        del request
        self._paused = not self._paused
        return response

    def _on_is_paused(self, request: Any, response: Any) -> Any:
        del request
        response.paused = self._paused
        return response


def _write(writer: BagWriter, batch: list[QueuedMessage]) -> None:
    for m in batch:
        writer.write(m.topic, m.data, log_ns=m.log_ns, publish_ns=m.publish_ns)


def _finish(writer: BagWriter, batch: list[QueuedMessage], losses: dict[str, int]) -> None:
    try:
        _write(writer, batch)
    finally:
        writer.note(losses)
        writer.close()
