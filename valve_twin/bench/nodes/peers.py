# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a user would write: bare rclpy nodes on the default executor; run as a program.

`peers.py echo Float64Stamped TOPIC...` publishes every message again under TOPIC/echo;
`peers.py count Float64Stamped TOPIC...` only takes them and publishes their number under /taken.

`peers.py relay Float64Series TOPIC...` is the smallest program that takes and sends what a twin
does: serialized messages on the events executor, for each third topic, the position's, a message
of predictions of as many samples, always the same bytes, under TOPIC/echo; their number likewise.
"""

from __future__ import annotations

import sys
from array import array
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeAlias

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Int64
from valve_twin_msgs import msg

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.publisher import Publisher

Sample: TypeAlias = "msg.Float64Stamped | msg.Float64Series"

_DEEP = QoSProfile(depth=100_000)  # type: ignore[no-untyped-call]
_TELL_S = 0.5


class Peer(Node):
    """Subscribes; publishes what it takes again where it is an echo."""

    def __init__(self, role: str, kind: str, topics: Sequence[str]) -> None:
        super().__init__("peer", start_parameter_services=False)
        message, raw = getattr(msg, kind), role == "relay"
        self._taken, self._answer = 0, b""
        for number, topic in enumerate(topics, start=1):
            take: Callable[[Any], None] = self._count
            if role == "echo":
                take = self._echo(self.create_publisher(message, f"{topic}/echo", _DEEP))
            elif raw and number % 3 == 0:
                answers = self.create_publisher(msg.PredictionSeries, f"{topic}/echo", _DEEP)
                take = self._relay(answers, message)
            self.create_subscription(message, topic, take, _DEEP, raw=raw)
        if role != "echo":
            self._taken_publisher = self.create_publisher(Int64, "/taken", 10)
            self.create_timer(_TELL_S, self._tell)

    def _echo(self, publisher: Publisher) -> Callable[[Sample], None]:
        def echo(message: Sample) -> None:
            publisher.publish(message)

        return echo

    def _relay(self, publisher: Publisher, kind: type) -> Callable[[bytes], None]:
        def relay(data: bytes) -> None:
            self._taken += 1
            if not self._answer:
                self._answer = _predictions(len(deserialize_message(data, kind).values))
            publisher.publish(self._answer)

        return relay

    def _count(self, message: Sample | bytes) -> None:
        del message
        self._taken += 1

    def _tell(self) -> None:
        self._taken_publisher.publish(Int64(data=self._taken))


def _predictions(count: int) -> bytes:
    """Return a serialized message of so many predictions."""
    values = array("d", [0.5] * count)
    columns = dict.fromkeys(("measured", "predicted", "simulated", "residual"), values)
    validity = array("B", [0] * count)
    return serialize_message(msg.PredictionSeries(**columns, validity=validity))


def main() -> None:
    """Run until the process is told to end."""
    rclpy.init()
    peer = Peer(sys.argv[1], sys.argv[2], sys.argv[3:])
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        if sys.argv[1] != "relay":
            rclpy.spin(peer)
        executor = EventsExecutor()
        executor.add_node(peer)
        while rclpy.ok():  # its `spin` lets no timer run
            executor.spin_once(timeout_sec=_TELL_S)


if __name__ == "__main__":
    main()
