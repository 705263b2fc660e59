# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Publish serialized messages in order, without loss where the subscribers are to set the pace."""

from __future__ import annotations

from collections import deque
from enum import Enum, auto
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from valve_twin.nodes.runtime.node import RCLError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.node import Node

MATCHED_S = 0.5
"""How long subscribers must have been matched before the first sample leaves [s]."""

UNMATCHED_S = 5.0
"""The same where the graph knows of more readers than have been matched [s]."""

_UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What the middleware calls a node that it does not know yet."""

DEPTH = 5000
"""Messages that a publisher keeps for subscribers that have not taken them [1]."""


def sending_profile() -> QoSProfile:
    """Return the profile of data that is played: reliable and deep."""
    return QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)


class Outbox:
    """Messages of any topics that leave in their order.

    A publisher keeps its last messages only and overwrites in silence what a subscriber has not
    acknowledged: with `keep` a message waits here instead.

    Parameters
    ----------
    is_acked : callable
        Returns whether a publisher has no acknowledgement to wait for.
    """

    def __init__(self, is_acked: Callable[[Any], bool]) -> None:
        self._is_acked = is_acked
        self._waiting: deque[tuple[Any, Any]] = deque()
        self._room: dict[Any, list[int]] = {}
        self.sent = 0

    def __bool__(self) -> bool:
        """Return whether messages wait."""
        return bool(self._waiting)

    def put(self, publisher: Any, message: Any) -> None:
        """Append a message."""
        self._waiting.append((publisher, message))

    def keep(self, publisher: Any, depth: int) -> None:
        """Let at most `depth` messages of a publisher be without acknowledgement, or one."""
        room = max(depth, 1)  # 0 is the middleware's own depth, which need not be more
        self._room[publisher] = [room, room]

    def send(self) -> bool:
        """Publish what waits; return whether all of it left."""
        while self._waiting:
            publisher, message = self._waiting[0]
            if self._room and not self._has_room(publisher):
                return False
            try:
                publisher.publish(message)
            except RCLError:
                return False
            self._waiting.popleft()
            self.sent += 1
        return True

    def clear(self) -> None:
        """Forget what waits."""
        self._waiting.clear()

    def release(self) -> None:
        """Forget what waits and all publishers."""
        self.clear()
        self._room.clear()

    def _has_room(self, publisher: Any) -> bool:
        room = self._room.get(publisher)
        if room is None:
            return True
        if 2 * room[0] <= room[1] and self._is_acked(publisher):
            room[0] = room[1]
        if not room[0]:
            return False
        room[0] -= 1
        return True


class SubscriberGate:
    """Opens when every publisher has had enough subscribers for a while.

    One side of a match knows of it before the other; what is sent in between may be lost.
    Subscribers are nodes: twin and recorder hold a second reader of a topic at times, and a
    recorder's two are not a recorder and a twin.

    Parameters
    ----------
    node : Node
        Whose view of the graph tells who subscribes.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._since_s: float | None = None

    def is_open(self, publishers: Iterable[Any], wanted: int, now_s: float) -> bool:
        """Return whether to begin.

        Parameters
        ----------
        publishers : iterable
            All that are to be subscribed to.
        wanted : int
            Nodes that each of them must have matched [1].
        now_s : float
            The steady clock [s].
        """
        states = [self._state(publisher, wanted) for publisher in publishers]
        if _Readers.TOO_FEW in states or not states:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        patience_s = UNMATCHED_S if _Readers.SOME_UNMATCHED in states else MATCHED_S
        return now_s - self._since_s >= patience_s

    def _state(self, publisher: Any, wanted: int) -> _Readers:
        """Compare what a publisher has matched with what the graph knows."""
        matched = publisher.get_subscription_count()
        if matched < wanted:
            return _Readers.TOO_FEW
        known = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
        if _nodes(known) < wanted:
            return _Readers.TOO_FEW
        return _Readers.SOME_UNMATCHED if matched < len(known) else _Readers.MATCHED


class _Readers(Enum):
    """How the readers of one topic stand."""

    TOO_FEW = auto()
    SOME_UNMATCHED = auto()  # about to be, or of other policies and never will be
    MATCHED = auto()


def _nodes(readers: Iterable[Any]) -> int:
    """Return how many nodes readers belong to [1].

    A reader can be known before its node is: it counts where no other one of its participant (12
    bytes of the GUID) does.
    """
    owners: dict[bytes, set[tuple[str, str]]] = {}
    for reader in readers:
        named = owners.setdefault(bytes(reader.endpoint_gid[:12]), set())
        if reader.node_name != _UNKNOWN:
            named.add((reader.node_namespace, reader.node_name))
    return sum(max(len(named), 1) for named in owners.values())
