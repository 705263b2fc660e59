# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bag recorder node: topics to an MCAP bag that survives a power cut."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from valve_twin_msgs import msg, srv

from valve_twin.io.bags.rolling import FileEvents
from valve_twin.io.recording.recorder import Recording
from valve_twin.nodes.recorder.config import RecorderConfig, read_config
from valve_twin.nodes.recorder.disk_queue import PERIOD_S, DiskQueue
from valve_twin.nodes.recorder.recorded_topic import RecordedTopic
from valve_twin.nodes.recorder.snapshots import Snapshots
from valve_twin.nodes.runtime.diagnostics import STALE, WARN, Diagnostics, Report
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.services import DeferredService, create_pause_services

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.io.recording.ring_buffer import RecordedMessage, Snapshot
    from valve_twin.nodes.runtime.services import Done
    from valve_twin.nodes.runtime.worker import Outcome

DISCOVERY_S = 0.25
"""How often new topics are looked for [s]."""

CLOSE_S = 1.5
"""Time that is given to the disk at the end [s]."""

SILENT_S = 30.0
"""Time without any message from publishers that are there, after which a warning is given [s]."""


class BagRecorderNode(ValveNode):
    """Lifecycle node that records one bag."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bag_recorder", **kwargs)
        self._topics: dict[str, RecordedTopic] = {}
        self._config: RecorderConfig | None = None
        self._recording: Recording | None = None
        self._disk: DiskQueue | None = None
        self._snapshots: Snapshots | None = None
        self._diagnostics: Diagnostics | None = None
        self._timers_made: list[Any] = []
        self._status: Any = None
        self._splits: Any = None
        self._paused = False
        self._refused: set[str] = set()
        self._discover_until = 0.0
        self._active_s = 0.0
        self._reported_trouble = ""
        self._reported_lost = 0
        for kind, name, callback in (
            (srv.SplitBagfile, "split_bagfile", self._on_split_asked),
            (srv.Stop, "stop", self._on_stop),
        ):
            self.create_service(kind, f"~/{name}", callback)
        create_pause_services(self, lambda: self._paused, self._pause)
        DeferredService(self, srv.Snapshot, "~/snapshot", self._on_snapshot)

    def configure(self) -> None:
        """Make the bag."""
        self.parameters.warn_unknown(hosts_valves=False)
        self.parameters.check()
        config = self._config = read_config(self)
        self._topics, self._refused = {}, set()
        self._reported_trouble, self._reported_lost = "", 0
        self._paused = config.given.start_paused
        self._recording = Recording(
            config.bag,
            flush_s=config.given.flush_s,
            split=config.split,
            disk=config.disk,
            by_snapshot=config.given.snapshot_mode,
            events=FileEvents(
                noted=partial(self._losses, self._topics),
                on_split=lambda *names: self.post(partial(self._on_split, *names)),
                on_gone=lambda line: self.post(partial(self.get_logger().warning, line)),
            ),
            in_background=True,
        )
        if config.given.bag:
            self._recording.follow(Path(config.given.bag))
        self._tell_folder(config)
        self._recording.note(config.custom)
        self._disk = DiskQueue(
            self, self._recording, limit=config.given.queue, limit_bytes=config.given.queue_bytes
        )
        if config.given.snapshot_mode:
            self._snapshots = Snapshots(self, config.given, self._save)
        self._status = self.create_publisher(msg.RecorderStatus, "~/status", 10)
        self._splits = self.create_publisher(msg.WriteSplitEvent, "~/events/write_split", 10)
        self._diagnostics = Diagnostics(self, self._reports)

    def activate(self) -> None:
        """Subscribe to what is there and to what comes."""
        assert self._config is not None
        if self._snapshots is not None:
            self._snapshots.open()
        for topic in self._topics.values():
            topic.listen()
        lasts_s, self._active_s = self._config.given.discovery_s, time.monotonic()
        self._discover_until = self._active_s + lasts_s if lasts_s else float("inf")
        self._discover()
        self._timers_made = [
            self.create_timer(DISCOVERY_S, self._discover, clock=STEADY),
            self.create_timer(1.0, self._publish_status, clock=STEADY),
        ]

    def deactivate(self) -> None:
        """Stop listening."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        self._timers_made = []
        if self._snapshots is not None:
            self._snapshots.close()
        for topic in self._topics.values():
            topic.silence()

    def cleanup(self) -> None:
        """Write what waits and finish the file."""
        if self._disk is not None:
            if not self._disk.close(CLOSE_S):
                self.get_logger().error(
                    "the disk is too slow: the end of the bag is not on it yet"
                )
        elif self._recording is not None:
            self._recording.close()
        for publisher in (self._status, self._splits):
            if publisher is not None:
                self.destroy_publisher(publisher)
        if self._diagnostics is not None:
            self._diagnostics.destroy()
        self._topics = {}
        self._recording = self._disk = self._snapshots = self._diagnostics = None
        self._status = self._splits = None

    def _tell_folder(self, config: RecorderConfig) -> None:
        given = config.given
        if given.bag and config.bag.name != Path(given.bag).name:
            self.get_logger().info(
                f"{Path(given.bag).absolute()} exists already: recording to {config.bag}"
            )
        elif not given.bag and given.keep_files:
            self.get_logger().info(
                f"keep_files counts the files of {config.bag} only: name the bag by the parameter "
                "'bag' to have them counted over restarts"
            )

    # -- data path

    def work(self) -> None:
        """Hand what was received to the disk's thread."""
        if self._disk is not None and self._recording is not None:
            self._disk.work()
            if self._recording.trouble != self._reported_trouble:
                self._tell_trouble(self._recording)

    def due_s(self) -> float:
        """Return when `work` wants to be called [s]."""
        return PERIOD_S

    def _on_message(self, message: RecordedMessage, topic: RecordedTopic) -> None:
        if self._paused or self._disk is None:
            return
        if self._snapshots is not None:
            self._snapshots.push(message)
        elif not self._disk.push(message):
            topic.lost_recorder += 1

    # -- discovery

    def _discover(self) -> None:
        disk, recording, config = self._disk, self._recording, self._config
        if disk is None or recording is None or config is None:
            return
        for topic in self._topics.values():
            if topic.adapt():
                disk.do(partial(recording.offer, topic.name, topic.offered))
                self._describe(topic)
        if time.monotonic() > self._discover_until:
            return
        for name, types in self.get_topic_names_and_types():
            if name in self._topics or name in self._refused:
                continue
            if config.choice.takes(name, types[0]) and self.count_publishers(name):
                self._add(name, types[0])

    def _add(self, name: str, kind: str) -> None:
        """Record one more topic; what cannot be recorded is named once."""
        assert self._config is not None
        assert self._disk is not None
        assert self._recording is not None
        policies = self._config.overrides.get(name)
        try:
            topic = RecordedTopic(self, name, kind, self._on_message, policies)
        except KeyError:
            self._refused.add(name)
            self.get_logger().warning(
                f"topic '{name}' is not recorded: message type {kind} is not installed"
            )
            return
        self._topics[name] = topic
        self._describe(topic)
        self._disk.do(partial(self._recording.add_topic, name, kind, topic.offered))
        self.get_logger().info(f"recording {name}")

    def _describe(self, topic: RecordedTopic) -> None:
        if self._snapshots is not None:
            self._snapshots.describe(topic)

    # -- snapshots and splits

    def _save(
        self,
        taken: Snapshot,
        cause: dict[str, str],
        done: Done | None = None,
        response: Any = None,
    ) -> None:
        """Write what was taken out of the buffer to a file of its own."""
        recording, disk = self._recording, self._disk
        if recording is None or disk is None or not taken.messages:
            self.get_logger().warning(f"no snapshot for {_named(cause)}: nothing is buffered")
            if done is not None:
                response.success = False
                done(response)
            return

        def saved(outcome: Outcome) -> None:
            if outcome.error:
                self.get_logger().error(f"snapshot for {_named(cause)}: {outcome.error}")
            else:
                self.get_logger().info(
                    f"snapshot for {_named(cause)}: {len(taken.messages)} messages in "
                    f"{outcome.result}"
                )
            if done is not None:
                response.success = not outcome.error
                done(response)

        cause["stamp"] = str(self.get_clock().now().nanoseconds)
        disk.do(partial(recording.snapshot, taken.messages, {"snapshot": cause}), saved)

    def _on_snapshot(self, request: Any, response: Any, done: Done) -> None:
        del request
        if self._snapshots is None:
            self.get_logger().warning("no snapshot: set the parameter snapshot_mode")
            response.success = False
            done(response)
            return
        taken, cause = self._snapshots.take({"trigger": "service"})
        self._save(taken, cause, done, response)

    def _on_split_asked(self, request: Any, response: Any) -> Any:
        del request
        if self._disk is not None and self._recording is not None:
            self._disk.do(self._recording.split)
        return response

    def _on_split(self, closed: str, opened: str) -> None:
        if self._splits is not None:
            self._splits.publish(msg.WriteSplitEvent(closed_file=closed, opened_file=opened))

    # -- what is reported

    def _losses(self, topics: dict[str, RecordedTopic]) -> dict[str, object]:
        """Return the losses as they stand in the metadata; called on the disk's thread."""
        recording = self._recording
        disk = recording.lost if recording is not None else {}
        found: dict[str, object] = {}
        for topic in list(topics.values()):
            found[f"lost_transport {topic.name}"] = topic.lost_transport
            found[f"lost_recorder {topic.name}"] = topic.lost_recorder + disk.get(topic.name, 0)
        return found

    def _state(self, recording: Recording) -> str:
        if recording.trouble:
            return "disk"
        if self._paused:
            return "paused"
        simulated = bool(self.get_parameter("use_sim_time").value)
        if simulated and not self.get_clock().now().nanoseconds:
            return "waiting for the clock"
        return "recording" if self._snapshots is None else "snapshot"

    def _publish_status(self) -> None:
        recording, disk = self._recording, self._disk
        if recording is None or disk is None or self._status is None:
            return
        counts, lost = recording.counts, recording.lost
        names = sorted(self._topics)
        topics = [self._topics[n] for n in names]
        message = msg.RecorderStatus(
            uri=str(recording.path),
            paused=self._paused,
            topics=names,
            messages=[counts.get(n, 0) for n in names],
            lost_transport=[t.lost_transport for t in topics],
            lost_recorder=[t.lost_recorder + lost.get(t.name, 0) for t in topics],
            bytes=recording.size,
            state=self._state(recording),
            trouble=recording.trouble,
            files=list(recording.files),
            free_bytes=recording.free,
            queued=len(disk),
            snapshots=recording.snapshots,
        )
        if self._snapshots is not None:
            ring = self._snapshots.ring
            message.buffered, message.buffered_bytes = len(ring), ring.size
            message.buffered_s = ring.duration_s
        message.header.stamp = self.get_clock().now().to_msg()
        self._status.publish(message)

    def _tell_trouble(self, recording: Recording) -> None:
        before, self._reported_trouble = self._reported_trouble, recording.trouble
        if recording.trouble:
            self.faults.report("recorder.disk", f"recording stops: {recording.trouble}")
        elif before:
            self.get_logger().info(
                f"{recording.path}: recording goes on, {recording.missed} messages were lost"
            )

    def _reports(self) -> Iterable[Report]:
        recording = self._recording
        if recording is None:
            return
        self.faults.look("recorder.disk", recording.trouble)
        lost = recording.lost
        total = sum(
            t.lost_transport + t.lost_recorder + lost.get(t.name, 0) for t in self._topics.values()
        )
        if total > self._reported_lost:
            self.faults.report(
                "recorder.loss",
                f"{total} messages are missing in {recording.path}",
                events=total - self._reported_lost,
            )
        self._reported_lost = total
        report = Report(
            "bag",
            "",
            {
                "uri": recording.path,
                "state": self._state(recording),
                "topics": len(self._topics),
                "messages": sum(recording.counts.values()),
                "messages lost": total,
                "bytes [B]": recording.size,
                "free [B]": recording.free,
                "snapshots": recording.snapshots,
            },
        )
        if self.state != "active":
            report.raise_to(STALE, f"the node is {self.state}")
        elif silence := self._silence():
            report.raise_to(WARN, silence)
        yield report

    def _silence(self) -> str:
        """Say that publishers are there and nothing has come from any."""
        waited_s = time.monotonic() - self._active_s
        silent = [t.name for t in self._topics.values() if t.publishers and not t.heard]
        if waited_s < SILENT_S or not silent or any(t.heard for t in self._topics.values()):
            return ""
        return (
            f"nothing has come in {waited_s:.0f} s on {', '.join(silent)}, which have publishers; "
            "where they do send, see docs/recorder.md, 'Deaf after a kill'"
        )

    # -- services

    def _pause(self, paused: bool) -> None:
        self._paused = paused

    def _on_stop(self, request: Any, response: Any) -> Any:
        """Finish the bag; a new configure begins the next."""
        del request
        if self.state == "active":
            self.trigger_deactivate()
        if self.state == "inactive":
            self.trigger_cleanup()
        return response


def _named(cause: dict[str, str]) -> str:
    """Say in a few words what a snapshot was taken for."""
    if cause["trigger"] != "alarm":
        return "the service"
    return f"the alarm of {cause['name']} on {cause['source']} ({cause['text']})"
