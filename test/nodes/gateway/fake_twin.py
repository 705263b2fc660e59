# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A process that speaks on the topics of a twin: values that follow from their stamps."""

from __future__ import annotations

import math
import sys
import time

RATE_HZ = 200.0


def expected(stamp_ns: int) -> dict[str, float]:
    """Return what is published with a stamp."""
    t = stamp_ns * 1e-9 % 1000.0
    measured = 0.5 + 0.4 * math.sin(2.0 * t)
    residual = 0.002 * math.sin(17.0 * t)
    return {
        "measured": measured,
        "predicted": measured - residual,
        "freerun": measured + 0.01,
        "residual": residual,
    }


def main() -> None:
    """Publish predictions and a command of a valve until the process is ended."""
    import rclpy
    from rclpy.qos import QoSProfile
    from valve_twin_msgs.msg import Float64Stamped, Prediction

    rate_hz, name = float(sys.argv[1]), sys.argv[2]
    rclpy.init()
    node = rclpy.create_node("fake_twin")
    deep = QoSProfile(depth=5000)
    predictions = node.create_publisher(Prediction, f"{name}/twin/prediction", deep)
    commands = node.create_publisher(Float64Stamped, f"{name}/command/v_in", deep)
    begun_s, count = time.monotonic(), 0
    while True:
        due = int((time.monotonic() - begun_s) * rate_hz)
        for _ in range(min(due - count, 2000)):
            stamp_ns = time.time_ns() // 1_000_000 * 1_000_000
            values = expected(stamp_ns)
            message = Prediction(cycle=7, residual_sigma=0.001)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            message.measured, message.predicted = values["measured"], values["predicted"]
            message.simulated, message.residual = values["freerun"], values["residual"]
            predictions.publish(message)
            command = Float64Stamped(header=message.header, value=float(stamp_ns // 10**9 % 2))
            commands.publish(command)
        count = due
        time.sleep(0.02 if rate_hz < 500 else 0.005)


if __name__ == "__main__":
    main()
