# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Play no faster than the subscribers work, so that no queue of theirs overruns.

A reliable subscriber acknowledges what lies in its queue, not what it has worked off, and a queue
of limited depth drops its oldest message in silence. So after every window of messages all have to
be acknowledged and then every subscribing node has to answer a call of a service that it has
anyway: an events executor answers in the order of arrival, hence after it has taken every message
before the call.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import GetState
from rcl_interfaces.srv import GetParameters

from valve_twin.nodes.player.acknowledgements import PATIENCE_S
from valve_twin.nodes.runtime.safety import node_name

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.node import Node

    from valve_twin.nodes.player.acknowledgements import Acknowledgements

_SERVICES = (
    ("get_state", "lifecycle_msgs/srv/GetState", GetState),
    ("get_parameters", "rcl_interfaces/srv/GetParameters", GetParameters),
)


class FlowControl:
    """Lets a window of messages pass at a time, until the subscribers have followed.

    Parameters
    ----------
    node : Node
        That publishes.
    publishers : sequence
        Its publishers.
    window : int
        Messages between two answers of the subscribers [1], 0 = never wait.
    acks : Acknowledgements
        What their subscribers have acknowledged.
    now_s : callable
        Steady clock [s].
    """

    def __init__(
        self,
        node: Node,
        publishers: Sequence[Any],
        *,
        window: int,
        acks: Acknowledgements,
        now_s: Callable[[], float],
    ) -> None:
        self._node = node
        self._publishers = publishers
        self._window = window
        self._acks = acks
        self._now_s = now_s
        self._since = self._marked = 0
        self._asked_s = 0.0
        self._calls: dict[str, Any] | None = None
        self._clients: dict[str, Any] = {}
        self._mute: set[str] = set()

    def count(self) -> None:
        """Note a message that left."""
        self._since += 1

    def is_open(self, *, strict: bool) -> bool:
        """Return whether another message may leave; asks the subscribers where it is time.

        Parameters
        ----------
        strict : bool
            Wait for their answers at once; else another window may leave meanwhile, so that the
            time between messages is kept.
        """
        if not self._window or self._since < self._window:
            return True
        if self._have_followed():
            self._since, self._marked = self._since - self._marked, 0
            return True
        return not strict and self._since < 2 * self._window

    def _have_followed(self) -> bool:
        """Return whether all have taken what was sent until it was asked first."""
        if self._marked == 0:
            self._marked = self._since
        if self._calls is None and not self._acks.are_complete(self._publishers):
            return False
        if self._calls is None:
            self._calls, self._asked_s = self._ask(), self._now_s()
        late = self._now_s() - self._asked_s > PATIENCE_S
        answered = [self._is_answered(name, late=late) for name in self._calls]
        if not all(answered):
            return False
        self._calls = None
        return True

    def destroy(self) -> None:
        """Take the clients down."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        self._clients.clear()
        self._calls = None

    def find_subscribers(self) -> None:
        """Look up the nodes that subscribe and make a client for each that can be asked."""
        own = self._node.get_fully_qualified_name()
        names = {
            node_name(end)
            for publisher in self._publishers
            for end in self._node.get_subscriptions_info_by_topic(publisher.topic_name)
        }
        for name in names - {own} - set(self._clients) - self._mute:
            client = self._client(name) if name.startswith("/") else None
            if client is not None:
                self._clients[name] = client
        for name in set(self._clients) - names:
            self._node.destroy_client(self._clients.pop(name))

    def _client(self, name: str) -> Any:
        namespace, _, last = name.rpartition("/")
        try:
            served = self._node.get_service_names_and_types_by_node(last, namespace or "/")
        except Exception:  # the node has just gone, and the graph raises what it likes
            return None
        for service, kind, made in _SERVICES:
            if (f"{name}/{service}", [kind]) in [(n, list(k)) for n, k in served]:
                return self._node.create_client(made, f"{name}/{service}")
        return None

    def _ask(self) -> dict[str, Any]:
        """Call every node that can be asked; None where its server is not in sight yet."""
        self.find_subscribers()
        return dict.fromkeys(self._clients)

    def _is_answered(self, name: str, *, late: bool) -> bool:
        client = self._clients.get(name)
        if client is None or self._calls is None:
            return True
        if self._calls[name] is None and client.service_is_ready():
            self._calls[name] = client.call_async(client.srv_type.Request())
        call = self._calls[name]
        if call is not None and (call.done() or not client.service_is_ready()):
            return True
        if late:
            self._node.get_logger().warning(
                f"node {name} has not answered for {PATIENCE_S:.0f} s: it is not waited for any "
                "more and may lose messages; start it anew or play at a lower rate"
            )
            self._mute.add(name)
            self._node.destroy_client(self._clients.pop(name))
        return late
