# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated or replayed command must never move a real valve.

A topic that already has a foreign publisher is refused, and so is a command outside the prefix
that somebody else
takes, unless the user allows it. Looked at before anything is published and again whenever the
graph may have changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node

CHECK_S = 0.5
"""How often the graph is looked at [s]."""

SETTLE_S = 5.0
"""Time for the graph to become known before the first message to a topic without prefix [s]; nodes
of one machine were seen to need up to 2.6 s to find each other."""


@dataclass(frozen=True, slots=True)
class Outlet:
    """A topic that is to be published.

    Attributes
    ----------
    topic : str
        Absolute name.
    command : bool
        It could move a valve.
    """

    topic: str
    command: bool


def node_name(endpoint: Any) -> str:
    """Return the full name of the node that an endpoint belongs to."""
    if endpoint.node_name.startswith("_NODE_NAME_UNKNOWN"):
        return "(name not known yet)"
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


class Guard:
    """Watches the topics that a node publishes.

    Parameters
    ----------
    node : Node
        The node.
    prefix : str
        What stands before all topics that cannot move a valve; empty = real topics.
    allow_live : bool
        Refuse nothing.
    """

    def __init__(self, node: Node, *, prefix: str, allow_live: bool) -> None:
        self._node = node
        self._real = not prefix.strip("/")
        self._allowed = allow_live

    @property
    def settle_s(self) -> float:
        """How long to wait before the first message [s]."""
        return SETTLE_S if self._real and not self._allowed else 0.0

    def check(self, outlets: Iterable[Outlet]) -> None:
        """Look at the graph.

        Raises
        ------
        ConfigError
            Naming the topic, the foreign node and what to do.
        """
        if self._allowed:
            return
        for outlet in outlets:
            self._refuse(outlet.topic, "is already published by", self._publishers(outlet.topic))
            if outlet.command and self._real:
                takers = self._foreign(self._node.get_subscriptions_info_by_topic(outlet.topic))
                self._refuse(outlet.topic, "is a command that is taken by", takers)

    def _publishers(self, topic: str) -> list[str]:
        return self._foreign(self._node.get_publishers_info_by_topic(topic))

    def _foreign(self, endpoints: list[Any]) -> list[str]:
        """Return the names of other nodes; a second node of this one's name is another."""
        own = self._node.get_fully_qualified_name()
        names = [node_name(e) for e in endpoints]
        twice = [own] if names.count(own) > 1 else []
        return [n for n in names if n != own] + twice

    def _refuse(self, topic: str, what: str, nodes: list[str]) -> None:
        if nodes:
            msg = (
                f"topic '{topic}' {what} node {nodes[0]}: nothing is published; set "
                "publish_prefix (for example "
                "/sim or /replay), stop that node, or set allow_live to true if it may be driven"
            )
            raise ConfigError(msg)
