# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where a player's messages leave: its publishers, one queue for all of them, and who follows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock as ClockMessage

from valve_twin.io.cdr.message_types import message_class
from valve_twin.nodes.player.acknowledgements import Acknowledgements
from valve_twin.nodes.player.flow_control import FlowControl
from valve_twin.nodes.player.outbox import Outbox, SubscriberGate
from valve_twin.nodes.player.settings import (
    CLOCK,
    PlaybackSettings,
    PlayedTopic,
    publisher_profile,
)
from valve_twin.nodes.runtime.safety import Guard, PublishedTopic
from valve_twin.nodes.runtime.stamps import to_time
from valve_twin.nodes.twin.inputs import seconds_now

if TYPE_CHECKING:
    from valve_twin.io.playback.player import BagMessage
    from valve_twin.nodes.runtime.node import ValveNode


class PlayerPublishers:
    """The publishers of an active player.

    Parameters
    ----------
    node : ValveNode
        The player.
    settings : PlaybackSettings
        What is played.

    Raises
    ------
    ConfigError
        If a real valve is in reach; nothing is made then.
    """

    def __init__(self, node: ValveNode, settings: PlaybackSettings) -> None:
        self._node, given = node, settings.given
        self._guard = Guard(node, prefix=given.publish_prefix, allow_live=given.allow_live)
        self._published = [PublishedTopic(r.name, command=True) for r in settings.topics]
        self.check()
        self._lossless, self._clock_hz = given.lossless, given.clock_hz
        self._publisher_of: dict[str, tuple[PlayedTopic, Any]] = {}
        self._real: list[Any] = []
        self._gate = SubscriberGate(node)
        self._acks = Acknowledgements(node, seconds_now)
        self.outbox = Outbox(self._acks.is_complete)
        for played, topic in zip(settings.topics, self._published, strict=True):
            self._open(played, topic)
        self._publishers = [p for _, p in self._publisher_of.values()]
        self._flow_control = FlowControl(
            node, self._publishers, window=given.window, acks=self._acks, now_s=seconds_now
        )
        self._clock: Any = None
        if given.clock:
            self._clock = node.create_publisher(ClockMessage, CLOCK, 1000)

    def close(self) -> None:
        """Take everything down."""
        self.outbox.release()
        self._flow_control.destroy()
        for publisher in (*self._publishers, self._clock):
            if publisher is not None:
                self._node.destroy_publisher(publisher)

    def _open(self, played: PlayedTopic, topic: PublishedTopic) -> None:
        """Make the publisher of a topic; a real command is kept for nobody who comes later."""
        real = self._guard.is_real(topic)
        offered = publisher_profile(played.offer, latched=not real)
        publisher = self._node.create_publisher(
            message_class(played.topic.type),
            played.name,
            offered,
            qos_overriding_options=None if real else QoSOverridingOptions.with_default_policies(),
        )
        self._publisher_of[played.topic.name] = (played, publisher)
        if real:
            self._real.append(publisher)
        if self._lossless:
            self.outbox.keep(publisher, publisher.qos_profile.depth)

    # -- who is there

    def is_settled(self, now_s: float) -> bool:
        """Return whether the graph was watched for long enough at a steady time [s]."""
        return self._guard.is_settled(now_s)

    def check(self) -> None:
        """Look at the whole graph; raise where a real valve is in reach."""
        self._guard.check(self._published)

    def has_subscribers(self, wanted: int) -> bool:
        """Return whether every topic has had so many subscribers for a while; at least one."""
        return self._gate.is_open(self._publishers, max(wanted, 1), seconds_now())

    def are_heard(self) -> bool:
        """Return whether anybody subscribes to any of them."""
        return any(p.get_subscription_count() for p in self._publishers)

    def has_matched_all(self) -> bool:
        """Return whether every subscriber that the graph knows of, of the clock too, has been."""
        return all(
            p.get_subscription_count() >= self._node.count_subscribers(p.topic_name)
            for p in (*self._publishers, self._clock)
            if p is not None
        )

    def find_subscribers(self) -> None:
        """Look up who subscribes, so that they can be asked whether they follow."""
        self._flow_control.find_subscribers()

    def is_acked(self) -> bool:
        """Return whether reliable subscribers have all that was sent, or are left behind."""
        return self._acks.are_complete(self._publishers)

    # -- what leaves

    def put(self, message: BagMessage, *, ticks: bool = True) -> None:
        """Append a message, with the time before it where that is wanted."""
        played, publisher = self._publisher_of[message.topic]
        if not len(message.data):
            self._node.get_logger().warning(
                f"{message.topic}: a message of 0 bytes in the bag is not played: it would make "
                "reliable subscriptions deaf",
                once=True,
            )
            return
        if ticks and played.ticks and not self._clock_hz:
            self.put_time(message.log_ns)
        self.outbox.put(publisher, message.data)
        self._flow_control.count()

    def put_time(self, at_ns: int) -> None:
        """Append a bag time [ns]."""
        if self._clock is not None:
            self.outbox.put(self._clock, ClockMessage(clock=to_time(at_ns)))

    def send(self, *, strict: bool) -> bool:
        """Publish what waits; return whether more may follow now.

        Parameters
        ----------
        strict : bool
            The subscribers set the pace.

        Raises
        ------
        ConfigError
            If somebody has begun to take a real command.
        """
        if self._real:
            self._guard.check_taken(self._real)
        return self.outbox.send() and self._flow_control.is_open(strict=strict)
