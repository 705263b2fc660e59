# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recorder's snapshots: a ring of the last messages, and what has it saved by itself."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs import msg

from valve_twin.io.recording.ring_buffer import CycleSpan, RecordedMessage, RingBuffer, Snapshot
from valve_twin.nodes.runtime.node import STEADY, ValveNode
from valve_twin.nodes.runtime.stamps import from_time

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.io.config.recorder_parameters import BagRecorderParameters
    from valve_twin.nodes.recorder.recorded_topic import RecordedTopic

_DEPTH = 100
_LATCHED = QoSProfile(depth=_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_ALARMING = {
    msg.Verdict.VALVE,
    msg.Verdict.COMMAND,
    msg.Verdict.SENSOR,
    msg.Verdict.SUPPLY,
    msg.Verdict.RECORDING_UNUSABLE,
}


class Snapshots:
    """Buffer and triggers.

    Parameters
    ----------
    node : ValveNode
        The recorder.
    config : BagRecorderParameters
        What is kept and what alarms.
    save : callable
        Gets what was taken and why, when an alarm asks for it.
    """

    def __init__(
        self,
        node: ValveNode,
        config: BagRecorderParameters,
        save: Callable[[Snapshot, dict[str, str]], None],
    ) -> None:
        self._node, self._config, self._save = node, config, save
        self.ring = RingBuffer(
            seconds=config.snapshot_s, size=config.snapshot_bytes, cycles=config.snapshot_cycles
        )
        self._levels: dict[str, bytes] = {}
        self._verdicts: dict[str, int] = {}
        self._quiet_until = 0.0
        self._alarms = 0
        self._subscriptions: list[Any] = []
        self._timer: Any = None
        self._cause: dict[str, str] = {}

    def open(self) -> None:
        """Listen to cycles and alarms."""
        c, make = self._config, self._node.create_subscription
        if c.snapshot_cycles:
            found = make(msg.CycleSummary, c.cycle_topic, self._on_cycle, _DEPTH)
            self._subscriptions.append(found)
        if "diagnostics" in c.alarms:
            found = make(DiagnosticArray, "/diagnostics", self._on_diagnostics, _DEPTH)
            self._subscriptions.append(found)
        if "verdict" in c.alarms:
            found = make(msg.Verdict, c.verdict_topic, self._on_verdict, _LATCHED)
            self._subscriptions.append(found)

    def close(self) -> None:
        """Listen no more."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []
        self._end_timer()

    def describe(self, topic: RecordedTopic) -> None:
        """Say what a recorded topic is like."""
        self.ring.describe(topic.name, stamped=topic.stamped, latched=topic.latched)

    def push(self, message: RecordedMessage) -> None:
        """Keep a message."""
        self.ring.push(message)

    def take(self, cause: dict[str, str]) -> tuple[Snapshot, dict[str, str]]:
        """Take the buffer out; return it with the cause and what it holds."""
        taken = self.ring.take()
        if taken.cycles:
            cause["cycles"] = f"{taken.cycles[0].number}..{taken.cycles[-1].number}"
        elif self._config.snapshot_cycles:
            cause["cycles"] = "none seen whole"
        return taken, cause

    # -- triggers

    def _on_cycle(self, message: msg.CycleSummary) -> None:
        span = CycleSpan(int(message.cycle), from_time(message.start), from_time(message.end))
        self.ring.end_cycle(span)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if not self._concerns(status):
                continue
            before = self._levels.get(status.name, DiagnosticStatus.OK)
            self._levels[status.name] = status.level
            if status.level == DiagnosticStatus.ERROR != before:
                self._alarm("/diagnostics", status.name, status.message)

    def _concerns(self, status: DiagnosticStatus) -> bool:
        """Whether a status is of this valve, and not the recorder's own."""
        own = self._node.get_fully_qualified_name()
        if status.name.startswith(f"{own}:"):
            return False
        if self._config.alarm_regex:
            return bool(re.search(self._config.alarm_regex, status.name))
        space = self._node.get_namespace().rstrip("/")
        return f"{space}/" in status.name or status.hardware_id == space

    def _on_verdict(self, message: msg.Verdict) -> None:
        before = self._verdicts.get(message.valve)
        self._verdicts[message.valve] = message.verdict
        if message.verdict in _ALARMING and message.verdict != before:
            self._alarm(
                self._config.verdict_topic, message.valve, f"{message.text}: {message.evidence}"
            )

    def _alarm(self, source: str, name: str, text: str) -> None:
        """Take a snapshot soon, unless one was taken just now."""
        self._alarms += 1
        now = time.monotonic()
        if now < self._quiet_until or self._timer is not None:
            return
        self._quiet_until = now + self._config.alarm_pause_s
        self._cause = {
            "trigger": "alarm",
            "source": source,
            "name": name,
            "text": text,
            "alarms": str(self._alarms),
        }
        self._timer = self._node.create_timer(
            max(self._config.snapshot_after_s, 1e-3), self._on_time, clock=STEADY
        )

    def _on_time(self) -> None:
        self._end_timer()
        self._save(*self.take(self._cause))

    def _end_timer(self) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None
