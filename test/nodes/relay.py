# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A relay process that loses messages at random: relay.py FROM TO SHARE SEED TOPIC...

It says "met" once readers of all that it sends are there. When it is to end it forwards what has
arrived and waits until that is received; what it dropped stands in the last line of its output:
stamps a topic, as JSON.
"""

from __future__ import annotations

import json
import signal
import sys

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from valve_twin_msgs.msg import Float64Stamped

from valve_twin.io.cdr.codec import decode_stamped

DEEP = QoSProfile(depth=20000)
QUIET = 25
"""So many turns of the executor without a message say that none is left to forward [1]."""


def main(source: str, target: str, share: str, seed: str, *topics: str) -> None:
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("relay", start_parameter_services=False)
    running = [True]
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: running.clear())
    dropped: dict[str, list[int]] = {t: [] for t in topics}
    publishers, taken = [], [0]

    def forward(topic: str) -> None:
        random = np.random.default_rng([int(seed), topics.index(topic)])
        publisher = node.create_publisher(Float64Stamped, f"{target}/{topic}", DEEP)
        publishers.append(publisher)

        def take(data: bytes) -> None:
            taken[0] += 1
            if random.random() < float(share):
                dropped[topic].append(decode_stamped(data)[0])
            else:
                publisher.publish(data)

        node.create_subscription(Float64Stamped, f"{source}/{topic}", take, DEEP, raw=True)

    for topic in topics:
        forward(topic)
    met = False
    while running:
        rclpy.spin_once(node, timeout_sec=0.05)
        if not met and all(p.get_subscription_count() for p in publishers):
            met = True
            sys.stdout.write("met\n")
            sys.stdout.flush()
    before, quiet = taken[0], 0
    while quiet < QUIET:
        rclpy.spin_once(node, timeout_sec=0.02)
        quiet = quiet + 1 if taken[0] == before else 0
        before = taken[0]
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=60))
    sys.stdout.write(json.dumps(dropped) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
