# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Live topics of the valves to Foxglove as they come, only while somebody there looks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from valve_twin.compat.ros import take_waiting
from valve_twin.io.bags.definitions import definition
from valve_twin.io.cdr.message_types import message_class
from valve_twin.nodes.gateway.live_feed import BEST_EFFORT, DEPTH, nothing

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from foxglove import Channel
    from rclpy.node import Node

    from valve_twin.gateway.foxglove.face import FoxgloveFace
    from valve_twin.io.config.valve import ValveConfig

DISCOVER_EVERY = 10
"""What is published is asked at one look in so many [1]."""

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

OWN = ("twin/prediction", "twin/cycle", "aging_monitor/faults", "twin/faults")
"""Topics of a valve that the history does not speak on."""


class FoxgloveRelay:
    """Passes serialized messages on; on the node's thread only.

    Parameters
    ----------
    reader : Node
        Holds the subscriptions; driven by nobody.
    face : FoxgloveFace
        Where they go.
    configs : mapping
        The valves by name.
    """

    def __init__(
        self, reader: Node, face: FoxgloveFace, configs: Mapping[str, ValveConfig]
    ) -> None:
        self._reader, self._face = reader, face
        self._wanted = set(live_topics(configs.values()))
        self._channels: dict[str, tuple[str, Channel]] = {}
        self._subscribed: dict[str, Any] = {}
        self._looks = 0
        self._refused: set[tuple[str, str]] = set()

    def look(self) -> None:
        """Pass on what came since the last look."""
        if self._looks % DISCOVER_EVERY == 0:
            self._discover()
        self._looks += 1
        for topic, (type_name, channel) in self._channels.items():
            if not channel.has_sinks():
                self._let_go(topic)
                continue
            if topic not in self._subscribed:
                kind = message_class(type_name)
                told_again = topic.endswith("/faults")
                self._subscribed[topic] = self._reader.create_subscription(
                    kind, topic, nothing, _LATCHED if told_again else BEST_EFFORT, raw=True
                )
            for data in take_waiting(self._subscribed[topic], DEPTH):
                channel.log(data)

    def end(self) -> None:
        """Take all down."""
        for topic in list(self._channels):
            self._close(topic)

    def _discover(self) -> None:
        """Offer the topics that are published, each in the type that it has now."""
        for topic, (type_name, *others) in self._reader.get_topic_names_and_types():
            if topic not in self._wanted or others:
                continue
            offered = self._channels.get(topic)
            if offered is not None and offered[0] == type_name:
                continue
            if not self._is_known(topic, type_name):
                continue
            if offered is not None:  # a twin that speaks in series now
                self._close(topic)
            channel = self._face.offer(topic, type_name)
            if channel is not None:
                self._channels[topic] = type_name, channel

    def _is_known(self, topic: str, type_name: str) -> bool:
        """Return whether a type is installed here; one that is not is told once."""
        if (topic, type_name) in self._refused:
            return False
        try:
            message_class(type_name)
            definition(type_name)
        except KeyError as err:
            self._refused.add((topic, type_name))
            text = f"{topic}: not passed on to Foxglove: {err.args[0]} is not installed here"
            self._reader.get_logger().warning(text)
            return False
        return True

    def _close(self, topic: str) -> None:
        self._let_go(topic)
        self._channels.pop(topic)[1].close()

    def _let_go(self, topic: str) -> None:
        subscription = self._subscribed.pop(topic, None)
        if subscription is not None:
            self._reader.destroy_subscription(subscription)


def live_topics(configs: Iterable[ValveConfig]) -> list[str]:
    """Return the topics of valves that are passed on: signals, predictions, cycles, faults."""
    found = []
    for config in configs:
        found += [f"{config.name}/{topic}" for topic in OWN]
        found += [source.topic for source in config.signals.values()]
    return found
