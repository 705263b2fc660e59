# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One topic of the recorder: taken as it is offered, losses counted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from valve_twin.io.mapping import message_class
from valve_twin.io.metadata import QosProfile as OfferedQos

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

_DEPTH = 100_000


class QueuedMessage(NamedTuple):
    """A serialized message with its times [ns]."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int


class RecordedTopic:
    """Subscription of one topic.

    Parameters
    ----------
    node : Node
        The recorder.
    name, kind : str
        Topic and message type.
    on_message : callable
        Gets every message and this topic.

    Raises
    ------
    KeyError
        If the message type is not installed.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: str,
        on_message: Callable[[QueuedMessage, RecordedTopic], None],
    ) -> None:
        self._node, self.name = node, name
        self._on_message = on_message
        self._last = 0
        self.lost_transport = self.lost_recorder = 0
        self.only_publisher = True
        publishers = [p.qos_profile for p in node.get_publishers_info_by_topic(name)]
        self.offered = tuple(_offered(p) for p in publishers) or (OfferedQos(),)
        self._subscription = node.create_subscription(
            message_class(kind), name, self._take, _matching(publishers), raw=True
        )
        self._subscription._callback_type = self._subscription.CallbackType.WithMessageInfo
        self._simulated = bool(node.get_parameter("use_sim_time").value)

    def silence(self) -> None:
        """Take what has arrived, then stop listening."""
        subscription = self._subscription
        while (
            arrived := subscription.handle.take_message(subscription.msg_type, True)
        ) is not None:
            self._take(arrived)
        self._node.destroy_subscription(self._subscription)

    def _take(self, *arguments: Any) -> None:
        data, info = arguments if len(arguments) == 2 else arguments[0]
        sequence = int(info["publication_sequence_number"])
        if self.only_publisher and 0 < self._last < sequence:
            self.lost_transport += sequence - self._last - 1
        self._last = sequence
        log_ns = int(info["received_timestamp"])
        if self._simulated:
            log_ns = self._node.get_clock().now().nanoseconds
            if log_ns == 0:
                return  # simulated time has not begun
        message = QueuedMessage(self.name, data, log_ns, int(info["source_timestamp"]))
        self._on_message(message, self)


def _matching(offered: list[QoSProfile]) -> QoSProfile:
    """Ask for the best that all publishers offer."""
    profile = QoSProfile(depth=_DEPTH)
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in offered)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in offered)
    profile.reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL if latched and offered else DurabilityPolicy.VOLATILE
    )
    return profile


def _offered(profile: QoSProfile) -> OfferedQos:
    return OfferedQos(
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        depth=max(int(profile.depth), 1),
    )
