# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The bag player node: publishes a bag again, under a prefix, with /clock, in one order."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage
from valve_twin_msgs import srv

from valve_twin.io.bags import bag_info
from valve_twin.io.config import resolve_topic
from valve_twin.io.errors import ConfigError
from valve_twin.io.mapping import message_class
from valve_twin.io.playback import BagMessage, BagTopic, bag_topics, read_messages
from valve_twin.nodes.convert import to_time
from valve_twin.nodes.inputs import seconds_now
from valve_twin.nodes.outlets import Gate, Outbox, sending_profile
from valve_twin.nodes.runtime import STEADY, ValveNode, run
from valve_twin.nodes.safety import CHECK_S, Guard, Outlet

if TYPE_CHECKING:
    from collections.abc import Iterator

TICK_S = 0.002
"""Period of the pacing timer [s]."""

MOST_MESSAGES = 32
"""Messages published in one tick: a callback has to end soon and shared memory must not overflow:
what it drops is sent again, but seconds later."""


DRAIN_S = 5.0
"""How long a subscriber may take for the last messages before the process ends [s]."""

_NOW = Duration(nanoseconds=0)


class BagPlayerNode(ValveNode):
    """Lifecycle node that plays one bag."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bag_player", **kwargs)
        self._topics: list[BagTopic] = []
        self._outlets: list[Outlet] = []
        self._publishers_made: dict[str, Any] = {}
        self._timers_made: list[Any] = []
        self._outbox = Outbox()
        self._messages: Iterator[BagMessage] = iter(())
        self._next: BagMessage | None = None
        self._clock_publisher: Any = None
        self._paused = False
        self._rate = 1.0
        self._anchor: tuple[float, int] | None = None
        self._gate = Gate()
        self._earliest_s = self._latest_s = 0.0
        self._played = 0
        self._ended_s = 0.0
        for kind, name, callback in (
            (srv.Pause, "pause", self._on_pause),
            (srv.Resume, "resume", self._on_resume),
            (srv.TogglePaused, "toggle_paused", self._on_toggle),
            (srv.IsPaused, "is_paused", self._on_is_paused),
            (srv.SetRate, "set_rate", self._on_set_rate),
            (srv.GetRate, "get_rate", self._on_get_rate),
        ):
            self.create_service(kind, f"~/{name}", callback)

    def start(self) -> None:
        """Start; a player that cannot play ends where it would end after playing."""
        super().start()
        if self.parameters["exit_at_end"] and self.state != "active":
            self.exit_code = 1

    def configure(self) -> None:
        """Open the bag."""
        self.parameters.warn_unknown(hosts_valves=False)
        self.parameters.check()
        path = str(self.parameters["bag"])
        if not path:
            msg = (
                f"{self.get_fully_qualified_name()}: key 'bag' is empty; write the folder of a bag"
            )
            raise ConfigError(msg)
        wanted = [t for t in self.parameters["topics"] if t]
        known = bag_topics(path, wanted)
        self._topics = [t for t in known if self._is_installed(t) and t.name != "/clock"]
        prefix = str(self.parameters["publish_prefix"])
        self._outlets = [
            Outlet(resolve_topic(t.name, "", prefix), command=True) for t in self._topics
        ]
        self._guard = Guard(self, prefix=prefix, allow_live=bool(self.parameters["allow_live"]))
        self._rate = float(self.parameters["rate"])
        self._paused = bool(self.parameters["start_paused"])
        begin_ns = bag_info(path).start_ns + round(float(self.parameters["start_offset_s"]) * 1e9)
        self._messages = read_messages(path, [t.name for t in self._topics], from_ns=begin_ns)
        self._next = next(self._messages, None)

    def activate(self) -> None:
        """Check that no real valve is in reach, then play."""
        self._guard.check(self._outlets)
        for topic, outlet in zip(self._topics, self._outlets, strict=True):
            self._publishers_made[topic.name] = self.create_publisher(
                message_class(topic.type), outlet.topic, self._profile(topic)
            )
        if self.parameters["clock"]:
            self._clock_publisher = self.create_publisher(ClockMessage, "/clock", 1000)
        self._anchor, self._gate = None, Gate()
        self._earliest_s = seconds_now() + self._guard.settle_s
        self._latest_s = seconds_now() + float(self.parameters["start_delay_s"])
        self._timers_made = [
            self.create_timer(TICK_S, self._tick, clock=STEADY),
            self.create_timer(CHECK_S, self._watch, clock=STEADY),
        ]

    def deactivate(self) -> None:
        """Stop publishing; activating again goes on from here."""
        for timer in self._timers_made:
            self.destroy_timer(timer)
        for publisher in self._publishers_made.values():
            self.destroy_publisher(publisher)
        if self._clock_publisher is not None:
            self.destroy_publisher(self._clock_publisher)
        self._timers_made, self._publishers_made, self._clock_publisher = [], {}, None
        self._outbox.clear()

    def cleanup(self) -> None:
        """Close the bag."""
        self._messages, self._next = iter(()), None
        self._topics, self._outlets = [], []

    # -- playing

    def _tick(self) -> None:
        """Publish what is due."""
        if not self._outbox.send() or self._paused:
            return
        if self._next is None:
            self._end()
            return
        if not self._is_released():
            return
        for _ in range(MOST_MESSAGES):
            message = self._next
            if message is None or not self._is_due(message):
                break
            if self._clock_publisher is not None:
                self._outbox.put(
                    self._clock_publisher, ClockMessage(clock=to_time(message.log_ns))
                )
            self._outbox.put(self._publishers_made[message.topic], message.data)
            self._played += 1
            self._next = next(self._messages, None)
            if self._next is None:
                self.get_logger().info(f"end of the bag: {self._played} messages played")
            if not self._outbox.send():
                return

    def _end(self) -> None:
        """End the process where that is wanted and all subscribers have what was played."""
        if not self.parameters["exit_at_end"]:
            return
        self._ended_s = self._ended_s or seconds_now()
        acked = [p.wait_for_all_acked(_NOW) for p in self._publishers_made.values()]
        if all(acked) or seconds_now() - self._ended_s > DRAIN_S:
            self.exit_code = 0

    def _is_released(self) -> bool:
        """Begin when the graph is settled and enough subscribers are there."""
        if self._anchor is None:
            now, wanted = seconds_now(), int(self.parameters["wait_for_subscribers"])
            found = self._gate.is_open(self._publishers_made.values(), max(wanted, 1), now)
            given_up = not wanted and now > self._latest_s
            if now < self._earliest_s or not (found or given_up):
                return False
            self._guard.check(self._outlets)
            self._set_anchor()
        return True

    def _is_due(self, message: BagMessage) -> bool:
        if self._rate == 0.0 or self._anchor is None:
            return True
        begin_s, begin_ns = self._anchor
        return (message.log_ns - begin_ns) * 1e-9 <= (seconds_now() - begin_s) * self._rate

    def _set_anchor(self) -> None:
        """Tie bag time to the steady clock: at the start, after a pause, at a new rate."""
        if self._next is not None:
            self._anchor = (seconds_now(), self._next.log_ns)

    def _watch(self) -> None:
        try:
            self._guard.check(self._outlets)
        except ConfigError as err:
            self.get_logger().error(f"stopped: {err}")
            self.trigger_deactivate()

    def _is_installed(self, topic: BagTopic) -> bool:
        try:
            message_class(topic.type)
        except KeyError:
            self.get_logger().warning(
                f"topic '{topic.name}' is not played: message type {topic.type} is not installed"
            )
            return False
        return True

    def _profile(self, topic: BagTopic) -> QoSProfile:
        """Offer what was offered when it was recorded."""
        profile = sending_profile(lossless=bool(self.parameters["lossless"]))
        if topic.qos.reliability == "best_effort":
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        if topic.qos.durability == "transient_local":
            profile = QoSProfile(depth=max(topic.qos.depth, 10))
            profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
        return profile

    # -- services

    def _on_pause(self, request: Any, response: Any) -> Any:
        del request
        self._paused = True
        return response

    def _on_resume(self, request: Any, response: Any) -> Any:
        del request
        if self._paused:
            self._paused = False
            if self._anchor is not None:
                self._set_anchor()
        return response

    def _on_toggle(self, request: Any, response: Any) -> Any:
        return (self._on_resume if self._paused else self._on_pause)(request, response)

    def _on_is_paused(self, request: Any, response: Any) -> Any:
        del request
        response.paused = self._paused
        return response

    def _on_set_rate(self, request: Any, response: Any) -> Any:
        response.success = request.rate > 0.0
        if response.success:
            self._rate = float(request.rate)
            if self._anchor is not None:
                self._set_anchor()
        return response

    def _on_get_rate(self, request: Any, response: Any) -> Any:
        del request
        response.rate = self._rate
        return response


def play(bag: str, *, rate: float = 1.0, prefix: str = "/replay", clock: bool = False) -> int:
    """Play a bag and end the process; what `valve-twin replay` does.

    Parameters
    ----------
    bag : str
        The bag.
    rate : float
        Playback seconds a second, 0 = as fast as the subscribers follow [1].
    prefix : str
        Put before every topic.
    clock : bool
        Publish /clock.

    Returns
    -------
    int
        Exit code; the process ends before it is returned.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    bag_topics(bag)
    values = {"bag": bag, "rate": float(rate), "publish_prefix": prefix, "clock": clock}
    given = [f"{name}:={json.dumps(value)}" for name, value in values.items()]
    arguments = [a for g in (*given, "exit_at_end:=true") for a in ("-p", g)]
    return run(BagPlayerNode, ["--ros-args", *arguments])
