# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A plant of simulated press valves that publishes at a given pace and takes what comes back."""

from __future__ import annotations

import os
import struct
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from valve_twin_msgs import msg

from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.cdr.codec import encode_series, encode_stamped

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import TracebackType

    from valve_twin.core.types import FloatArray

TOPICS = ("command/v_in", "command/v_out", "spool_position")
"""Of one valve, in the order in which they are published."""

_DEEP = QoSProfile(depth=100_000)  # type: ignore[no-untyped-call]
_NS = 1_000_000_000
_STAMP = struct.Struct("<II")
_STAMPED_BYTES = 28
_COUNT = struct.Struct("<I")
_COUNT_AT = 36  # of a PredictionSeries without a frame


@dataclass(slots=True)
class Taken:
    """Messages of one topic that came back.

    Attributes
    ----------
    messages, samples : int
        Their number, and that of the samples in batches.
    series : bool
        Whether a message holds a batch of predictions.
    last : bytes
        The newest, serialized.
    delay_ns : list of int
        Time from the stamp of a message, taken just before its input was published, to the moment
        at which its publisher sent it [ns].
    """

    messages: int = 0
    samples: int = 0
    series: bool = False
    last: bytes = b""
    delay_ns: list[int] = field(default_factory=list)


class Plant:
    """Publisher of valves' signals; its clock is the wall clock.

    Parameters
    ----------
    valves : sequence of str
        Namespaces of the valves.
    domain : int
        ROS domain.
    batch : int
        Samples a message; above 1 as Float64Series.
    slow : int
        Stretches a production cycle of 850 samples by this factor.
    """

    def __init__(
        self, valves: Sequence[str], domain: int, *, batch: int = 1, slow: int = 1
    ) -> None:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self._node = Node("plant", context=self._context, start_parameter_services=False)
        kind = msg.Float64Stamped if batch == 1 else msg.Float64Series
        self._batch = batch
        self._publishers = [
            [self._node.create_publisher(kind, f"{v}/{t}", _DEEP) for t in TOPICS] for v in valves
        ]
        self._subscriptions: dict[str, tuple[Any, Taken]] = {}
        self._columns = _columns(slow)
        self._begin_ns = time.time_ns()
        self.sent = 0

    def __enter__(self) -> Plant:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, err: BaseException | None, at: TracebackType | None
    ) -> None:
        """Leave the domain."""
        self._node.destroy_node()  # type: ignore[no-untyped-call]
        rclpy.shutdown(context=self._context)

    def listen(self, topic: str, kind: type) -> Taken:
        """Return what fills with the messages of a topic while the plant runs."""
        subscription = self._node.create_subscription(kind, topic, print, _DEEP, raw=True)
        taken = Taken(series=kind is msg.PredictionSeries)
        self._subscriptions[topic] = (subscription, taken)
        return taken

    def subscribers(self) -> int:
        """Return the least number of subscribers of any signal."""
        return min(p.get_subscription_count() for group in self._publishers for p in group)

    def heard(self) -> bool:
        """Return whether every topic that is listened to has a publisher."""
        return all(s.get_publisher_count() for s, _ in self._subscriptions.values())

    def run(self, seconds: float, rate_hz: float, period_s: float | None = None) -> None:
        """Publish for a time.

        Parameters
        ----------
        seconds : float
            How long [s].
        rate_hz : float
            Messages a second on every topic [Hz].
        period_s : float, optional
            Time between two samples of a batch [s].
        """
        begin = time.perf_counter()
        for k in range(round(seconds * rate_hz)):
            due = begin + k / rate_hz
            while (now := time.perf_counter()) < due:
                self.take()
                time.sleep(max(min(due - now, 0.002), 0.0))
            self._send(period_s)
        self.take()

    def _send(self, period_s: float | None) -> None:
        at = self.sent * self._batch
        self.sent += 1
        if self._batch == 1:
            stamp = time.time_ns()
            row = self._columns[at % len(self._columns)].tolist()
            data = [encode_stamped(stamp, value) for value in row]
        else:
            assert period_s is not None
            stamp = self._begin_ns + round(1e9 * at * period_s)
            rows = self._columns[np.arange(at, at + self._batch) % len(self._columns)]
            data = [encode_series(stamp, period_s, column) for column in rows.T]
        for group in self._publishers:
            for publisher, content in zip(group, data, strict=True):
                publisher.publish(content)

    def take(self) -> None:
        """Take what came back."""
        for subscription, taken in self._subscriptions.values():
            with subscription.handle:
                while (found := subscription.handle.take_message(None, True)) is not None:
                    data, info = found
                    taken.messages += 1
                    taken.last = data
                    if taken.series and len(data) > _COUNT_AT:
                        taken.samples += _COUNT.unpack_from(data, _COUNT_AT)[0]
                    if len(data) < _STAMPED_BYTES:
                        continue
                    sec, nanosec = _STAMP.unpack_from(data, 4)
                    sent = int(info["source_timestamp"])
                    taken.delay_ns.append(sent - (sec * _NS + nanosec))

    def wait(self, condition: Callable[[], bool], what: str, limit_s: float = 30.0) -> None:
        """Take until a condition holds.

        Parameters
        ----------
        condition : callable
            Tells whether it holds.
        what : str
            What is waited for, for the error.
        limit_s : float
            Longest wait [s].

        Raises
        ------
        TimeoutError
            If it does not hold in time.
        """
        end = time.monotonic() + limit_s
        while not condition():
            if time.monotonic() > end:
                msg = f"not within {limit_s:.0f} s: {what}"
                raise TimeoutError(msg)
            self.take()
            time.sleep(0.005)


def _columns(slow: int) -> FloatArray:
    """Return v_in, v_out and position of a few production cycles, (N, 3)."""
    config = get_simulation("press_cartridge")
    blocks = list(simulate_cycles(config, 4, seed=1))
    inputs = np.concatenate([b.inputs for b in blocks])
    rows = np.column_stack([inputs, np.concatenate([b.position for b in blocks])])
    at = np.arange(slow * len(rows)) / slow
    return np.column_stack([np.interp(at, np.arange(len(rows)), column) for column in rows.T])
