# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Wait for what reliable subscribers have to acknowledge, but for nobody for ever."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy.duration import Duration
from rclpy.qos import ReliabilityPolicy

from valve_twin.nodes.runtime.safety import node_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node

PATIENCE_S = 30.0
"""How long a node may take to acknowledge, and then to answer, before it is said and no longer
waited for [s]."""

_NOW = Duration(nanoseconds=0)


class Acknowledgements:
    """Which publishers have no acknowledgement to wait for.

    Where a reliable subscriber owes one for too long it is said once, and the publisher is not
    waited for until all have caught up.

    Parameters
    ----------
    node : Node
        That publishes.
    now_s : callable
        Steady clock [s].
    """

    def __init__(self, node: Node, now_s: Callable[[], float]) -> None:
        self._node = node
        self._now_s = now_s
        self._since_s: dict[Any, float] = {}
        self._left: set[Any] = set()

    def are_complete(self, publishers: Iterable[Any]) -> bool:
        """Return whether none of them has to be waited for."""
        done = [self.is_complete(p) for p in publishers]  # of each, so that all waits begin now
        return all(done)

    def is_complete(self, publisher: Any) -> bool:
        """Return whether a publisher has not to be waited for; called again until so."""
        if publisher.wait_for_all_acked(_NOW):
            self._since_s.pop(publisher, None)
            self._left.discard(publisher)
            return True
        if publisher in self._left:
            return True
        now = self._now_s()
        if now - self._since_s.setdefault(publisher, now) <= PATIENCE_S:
            return False
        self._left.add(publisher)
        self._tell(publisher.topic_name)
        return True

    def _tell(self, topic: str) -> None:
        ends = self._node.get_subscriptions_info_by_topic(topic)
        reliable = ReliabilityPolicy.RELIABLE
        names = {node_name(end) for end in ends if end.qos_profile.reliability == reliable}
        self._node.get_logger().warning(
            f"topic '{topic}': a subscriber has not acknowledged its messages for "
            f"{PATIENCE_S:.0f} s, one of {', '.join(sorted(names)) or 'unknown name'}: it is not "
            "waited for any more and may lose messages; start it anew"
        )
