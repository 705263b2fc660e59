# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the graph knows of one topic, asked for as seldom as it may be: fifty valves have 150."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rclpy.qos import ReliabilityPolicy

from valve_twin.core.quantity import suggest

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rclpy.node import Node
    from rclpy.topic_endpoint_info import TopicEndpointInfo

SUGGEST_S = 5.0
"""How long the name that is suggested for a missing topic stands [s]: a node of 50 valves that is
started first misses 250 topics."""

KNOWN_S = 5.0
"""How long what is known of a topic's publishers stands while their number stays [s]."""


class TopicGraph:
    """Publishers of one topic, and what else it could be.

    Parameters
    ----------
    node : Node
        Whose graph it is.
    topic, kind : str
        Name and type of the topic.
    """

    def __init__(self, node: Node, topic: str, kind: str) -> None:
        self._node, self._topic, self._kind = node, topic, kind
        self._suggested_s, self._suggested = -math.inf, ""
        self._known: Sequence[TopicEndpointInfo] = ()
        self._known_s = -math.inf

    def is_best_effort(self) -> bool:
        """Return whether a publisher offers no more."""
        offered = self._node.get_publishers_info_by_topic(self._topic)
        return any(p.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for p in offered)

    def publishers(self, now_s: float) -> Sequence[TopicEndpointInfo]:
        """Return who publishes the topic; asked anew at once where their number changes [s]."""
        count = self._node.count_publishers(self._topic)
        if count != len(self._known) or now_s >= self._known_s + KNOWN_S:
            self._known = self._node.get_publishers_info_by_topic(self._topic)
            self._known_s = now_s
        return self._known

    def suggestion(self, now_s: float) -> str:
        """Return what else the topic could be; the graph is searched now and then [s]."""
        if now_s >= self._suggested_s + SUGGEST_S:
            self._suggested_s = now_s
            self._suggested = suggest(self._topic, self._candidates())
        return self._suggested

    def _candidates(self) -> Iterable[str]:
        """Return topics of the same type that somebody publishes."""
        known = self._node.get_topic_names_and_types()
        count = self._node.count_publishers
        return [name for name, types in known if self._kind in types and count(name) > 0]
