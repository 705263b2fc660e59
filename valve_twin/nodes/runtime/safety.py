# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated or replayed command must never move a real valve.

A topic that already has a foreign publisher is refused, and so is a command that somebody else
takes unless the first part of its name says replay or sim (/replay, /sim, /line2_replay), whatever
prefix, parameter or remapping led to that name. Looked at before anything is published and again
whenever the graph may have changed; only the user's `allow_live` lifts it.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from valve_twin.io.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rclpy.node import Node

CHECK_S = 0.5
"""How often the graph is looked at [s]."""

SETTLE_S = 5.0
"""Time for the graph to become known before the first message to a real topic [s]; nodes
of one machine were seen to need up to 2.6 s to find each other. Of a time without a look, in which
the process stood still and met nobody, at most CHECK_S counts."""

_FREE = re.compile(r"/([A-Za-z]\w*_)?(replay(ed)?|sim|simulat(ed|ion|or))\d*(_\w+)?(/|$)")

_REPLAYED = re.compile(r"/([A-Za-z]\w*_)?replay(ed)?\d*(_\w+)?(/|$)")


@dataclass(frozen=True, slots=True)
class PublishedTopic:
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


def is_free(name: str) -> bool:
    """Return whether a name lies where no real valve listens: below /replay, /sim_2..."""
    return _FREE.match(f"/{name.lstrip('/')}") is not None


def is_replayed(name: str) -> bool:
    """Return whether a name lies where a recorded valve is played: below /replay, /replay_2..."""
    return _REPLAYED.match(f"/{name.lstrip('/')}") is not None


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
        What stands before all topics; empty = real topics.
    allow_live : bool
        Refuse nothing.
    """

    def __init__(self, node: Node, *, prefix: str, allow_live: bool) -> None:
        self._node = node
        self._real = not is_free(prefix)
        self._allowed = allow_live
        self.watch_anew()

    def watch_anew(self) -> None:
        """Let the time before the first message begin again."""
        self._looked_s, self._watched_s = math.inf, 0.0

    def is_settled(self, now_s: float) -> bool:
        """Return whether the graph was watched for long enough at a steady time [s]."""
        self._watched_s += min(max(now_s - self._looked_s, 0.0), CHECK_S)
        self._looked_s = now_s
        return not self._real or self._allowed or self._watched_s >= SETTLE_S

    def is_real(self, published: PublishedTopic) -> bool:
        """Return whether a topic may be published only where nobody takes it."""
        return published.command and not self._allowed and not is_free(self._name(published))

    def check(self, topics: Iterable[PublishedTopic]) -> None:
        """Look at the graph.

        Raises
        ------
        ConfigError
            Naming the topic, the foreign node and what to do.
        """
        if self._allowed:
            return
        for published in topics:
            name = self._name(published)
            self._refuse(name, "is already published by", self._publishers(name))
            if self.is_real(published):
                self._real = True
                self._refuse(name, "is a command that is taken by", self._takers(name))

    def check_taken(self, publishers: Iterable[Any]) -> None:
        """Look whether anybody has begun to take a real command; cheap enough for every message.

        Raises
        ------
        ConfigError
            Naming the topic and what to do.
        """
        for publisher in publishers:
            if publisher.get_subscription_count():
                name = publisher.topic_name
                takers = self._takers(name) or ["(name not known yet)"]
                self._refuse(name, "is a command that is taken by", takers)

    def _name(self, published: PublishedTopic) -> str:
        """Return the name on the network, after any remapping of the node."""
        return self._node.resolve_topic_name(published.topic)

    def _publishers(self, topic: str) -> list[str]:
        own = sum(p.topic_name == topic for p in self._node.publishers)
        # one that was just taken down may still be in sight
        return self._foreign(self._node.get_publishers_info_by_topic(topic), max(own, 1))

    def _takers(self, topic: str) -> list[str]:
        own = sum(s.topic_name == topic for s in self._node.subscriptions)
        return self._foreign(self._node.get_subscriptions_info_by_topic(topic), own)

    def _foreign(self, endpoints: list[Any], own: int) -> list[str]:
        """Return the names of other nodes; what this node did not make is another's."""
        name = self._node.get_fully_qualified_name()
        names = [node_name(e) for e in endpoints]
        twin = [name] if names.count(name) > own else []
        return [n for n in names if n != name] + twin

    def _refuse(self, topic: str, what: str, nodes: list[str]) -> None:
        if nodes:
            msg = (
                f"topic '{topic}' {what} node {nodes[0]}: nothing is published; set "
                "publish_prefix (to a name that begins with "
                "/sim or /replay), stop that node, or set allow_live to true if it may be driven"
            )
            raise ConfigError(msg)
