# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a user would write: bare rclpy nodes on the default executor; run as a program.

`peers.py echo Float64Stamped TOPIC...` publishes every message again under TOPIC/echo;
`peers.py count Float64Stamped TOPIC...` only takes them and publishes their number under /taken.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING, TypeAlias

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
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
        message = getattr(msg, kind)
        self._taken = 0
        for topic in topics:
            take: Callable[[Sample], None] = self._count
            if role == "echo":
                take = self._echo(self.create_publisher(message, f"{topic}/echo", _DEEP))
            self.create_subscription(message, topic, take, _DEEP)
        if role == "count":
            self._taken_publisher = self.create_publisher(Int64, "/taken", 10)
            self.create_timer(_TELL_S, self._tell)

    def _echo(self, publisher: Publisher) -> Callable[[Sample], None]:
        def echo(message: Sample) -> None:
            publisher.publish(message)

        return echo

    def _count(self, message: Sample) -> None:
        del message
        self._taken += 1

    def _tell(self) -> None:
        self._taken_publisher.publish(Int64(data=self._taken))


def main() -> None:
    """Run until the process is told to end."""
    rclpy.init()
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        rclpy.spin(Peer(sys.argv[1], sys.argv[2], sys.argv[3:]))


if __name__ == "__main__":
    main()
