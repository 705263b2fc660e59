# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Publish the samples of a simulated press valve from a test."""

from __future__ import annotations

from typing import Any

from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from valve_twin_msgs.msg import Float64Stamped

from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.cdr.codec import encode_stamped

START_NS = 1_000_000_000_000
REARM = {"cycles.rearm_signal": "v_out", "estimate_wait_s": 0.0}
"""The press valve's cycle begins with v_in and re-arms with v_out; what comes as fast as it can be
published is no live input, so that an estimate is waited for."""


AT_ONCE = 50
"""Samples in flight: shared memory has room for 512 messages, and a slow reader loses more."""


class Feeder:
    """Hardware of a test: position and both commands, deterministic."""

    def __init__(self, graph, ns: str, *, seed: int = 1, qos: QoSProfile | None = None) -> None:
        self._valve = SimulatedValve(get_simulation("press_cartridge"), seed)
        self.cycle_samples = self._valve.config.cycle_samples
        self.period_ns = self._valve.period_ns
        self._graph, self._ns = graph, ns
        self._publishers: list[Any] = []
        self._open(qos)
        self.sent = 0

    @property
    def publishers(self) -> list[Any]:
        """Publishers of v_in, v_out and the position."""
        return self._publishers

    def restart(self, qos: QoSProfile | None = None) -> None:
        """Publish from new publishers, as hardware does that was switched off and on."""
        for publisher in self._publishers:
            self._graph.node.destroy_publisher(publisher)
        self._open(qos)

    def _open(self, qos: QoSProfile | None) -> None:
        profile = qos or QoSProfile(depth=20000)
        make = self._graph.node.create_publisher
        self._publishers = [
            make(Float64Stamped, f"{self._ns}/{topic}", profile)
            for topic in ("command/v_in", "command/v_out", "spool_position")
        ]
        self._graph.spin_until(
            lambda: all(p.get_subscription_count() for p in self._publishers), what="subscribers"
        )

    def wait_until_received(self) -> None:
        """Wait until the middleware of every subscriber has what was sent."""
        for publisher in self._publishers:
            assert publisher.wait_for_all_acked(Duration(seconds=60))

    def feed(
        self, samples: int, offset_ns: int = START_NS, position=None, *, paced: bool = True
    ) -> None:
        """Publish the next samples; `position` replaces the measured values.

        As readers take them, unless they are not `paced`: to one that is held up.
        """
        taken = paced
        block = self._valve.advance(samples)
        for i in range(samples):
            stamp = int(block.stamp_ns[i]) + offset_ns
            values = (block.inputs[i, 0], block.inputs[i, 1], block.position[i])
            for publisher, value in zip(self._publishers, values, strict=True):
                own = position is not None and publisher is self._publishers[2]
                publisher.publish(encode_stamped(stamp, float(position if own else value)))
            self.sent += 1
            if taken and (i + 1) % AT_ONCE == 0:  # the dead take none
                taken = all(p.wait_for_all_acked(Duration(seconds=3)) for p in self._publishers)
