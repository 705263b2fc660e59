# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A relay process that loses messages at random: relay.py FROM TO SHARE SEED TOPIC...

What it dropped stands in the last line of its output when it ends: stamps a topic, as JSON.
"""

from __future__ import annotations

import json
import signal
import sys

import numpy as np
import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from valve_twin_msgs.msg import Float64Stamped

from valve_twin.io.cdr.codec import decode_stamped

DEEP = QoSProfile(depth=20000)


def main(source: str, target: str, share: str, seed: str, *topics: str) -> None:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("relay", start_parameter_services=False)
    running = [True]
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: running.clear())
    dropped: dict[str, list[int]] = {t: [] for t in topics}

    def forward(topic: str) -> None:
        random = np.random.default_rng([int(seed), topics.index(topic)])
        publisher = node.create_publisher(Float64Stamped, f"{target}/{topic}", DEEP)

        def take(data: bytes) -> None:
            if random.random() < float(share):
                dropped[topic].append(decode_stamped(data)[0])
            else:
                publisher.publish(data)

        node.create_subscription(Float64Stamped, f"{source}/{topic}", take, DEEP, raw=True)

    for topic in topics:
        forward(topic)
    while running:
        rclpy.spin_once(node, timeout_sec=0.05)
    sys.stdout.write(json.dumps(dropped) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
