# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Predictions and commands of one valve taken off their topics while somebody looks.

The readers are best effort, so that no publisher waits for them, and belong to a node that no
executor drives: what came is taken five times a second, which costs a tenth of a callback each.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from valve_twin_msgs.msg import Prediction, PredictionSeries

from valve_twin.compat.ros import take_waiting
from valve_twin.core.valves.registry import get_model
from valve_twin.gateway.live.plot import MOST_COMMANDS
from valve_twin.io.cdr.message_types import RosTypes, message_class
from valve_twin.io.cdr.predictions import decode_prediction_run
from valve_twin.io.cdr.signals import Extractor, batch_stamps
from valve_twin.nodes.runtime.stamps import from_time

if TYPE_CHECKING:
    from rclpy.node import Node

    from valve_twin.core.types import FloatArray
    from valve_twin.gateway.live.channel import LiveValve
    from valve_twin.io.config.valve import ValveConfig

DEPTH = 4000
"""Messages that may wait for the next look; of more the oldest are left out of the plot [1]."""

FIT_EVERY = 5
"""What type the twin publishes is asked at one look in so many that found nothing [1]."""

BEST_EFFORT = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
"""No publisher waits for such a reader."""
_SERIES = "valve_twin_msgs/msg/PredictionSeries"


class LiveFeed:
    """Reads the topics of one valve; on the node's thread only.

    Parameters
    ----------
    reader : Node
        Holds the subscriptions; driven by nobody.
    config : ValveConfig
        The valve.
    valve : LiveValve
        Takes what comes.
    """

    def __init__(self, reader: Node, config: ValveConfig, valve: LiveValve) -> None:
        self._reader, self._valve = reader, valve
        self._topic = f"{config.name}/twin/prediction"
        model = get_model(config.model)
        self._series = config.signals[model.output].batched
        names = [name for name in model.inputs if name in config.signals][:MOST_COMMANDS]
        where = reader.get_fully_qualified_name()
        self._commands = {
            f"s{k}": Extractor(config.signals[name], RosTypes(), where)
            for k, name in enumerate(names)
        }
        self._readers: dict[str, Any] = {}
        self._in_vain = 0

    def begin(self) -> None:
        """Subscribe."""
        self.end()
        self._subscribe()
        for curve, extractor in self._commands.items():
            kind = message_class(extractor.source.type)
            self._readers[curve] = self._reader.create_subscription(
                kind, extractor.source.topic, nothing, BEST_EFFORT, raw=True
            )

    def end(self) -> None:
        """Unsubscribe."""
        for subscription in self._readers.values():
            self._reader.destroy_subscription(subscription)
        self._readers = {}

    def look(self) -> None:
        """Take what came since the last look."""
        if not self._readers:
            return
        for curve, extractor in self._commands.items():
            self._take_commands(curve, extractor, take_waiting(self._readers[curve], DEPTH))
        found = take_waiting(self._readers[""], DEPTH)
        self._in_vain = 0 if found else self._in_vain + 1
        if not found:
            if self._in_vain % FIT_EVERY == 1:
                self._fit_type()
        elif self._series:
            for data in found:
                self._take_series(deserialize_message(data, PredictionSeries))
        else:
            self._take_single(found)

    def _subscribe(self) -> None:
        old = self._readers.pop("", None)
        if old is not None:
            self._reader.destroy_subscription(old)
        kind = PredictionSeries if self._series else Prediction
        self._readers[""] = self._reader.create_subscription(
            kind, self._topic, nothing, BEST_EFFORT, raw=True
        )

    def _fit_type(self) -> None:
        """Take the type that the twin publishes, where it is the other one."""
        offered = self._reader.get_publishers_info_by_topic(self._topic)
        series = {info.topic_type == _SERIES for info in offered}
        if len(series) == 1 and self._series not in series:
            self._series = not self._series
            self._subscribe()

    def _take_commands(self, curve: str, extractor: Extractor, found: list[bytes]) -> None:
        if not found:
            return
        now_ns = time.time_ns()
        if extractor.is_raw_readable:
            run = extractor.from_run(found, [now_ns] * len(found))
            blocks = [run] if run else [extractor.from_raw(data, now_ns) for data in found]
        else:
            kind = message_class(extractor.source.type)
            blocks = [extractor(deserialize_message(data, kind), now_ns) for data in found]
        for block in blocks:
            self._valve.take(block.stamp_ns, {curve: block.values})

    def _take_single(self, found: list[bytes]) -> None:
        rows = decode_prediction_run(found)
        if rows is None:
            for data in found:
                self._take_one(deserialize_message(data, Prediction))
            return
        stamp_ns = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        curves = _curves(*(rows[name] for name in _FIELDS))
        sigma, cycle = float(rows["residual_sigma"][-1]), int(rows["cycle"][-1])
        self._valve.take(stamp_ns, curves, sigma, cycle)

    def _take_one(self, message: Any) -> None:
        stamp_ns = np.array([from_time(message.header.stamp)], dtype=np.int64)
        curves = _curves(*(np.array([getattr(message, name)]) for name in _FIELDS))
        self._valve.take(stamp_ns, curves, message.residual_sigma, message.cycle)

    def _take_series(self, message: Any) -> None:
        count = len(message.measured)
        stamp_ns = batch_stamps(from_time(message.header.stamp), message.period, count)
        columns = [np.asarray(getattr(message, name), dtype=float) for name in _FIELDS]
        if any(len(column) != count for column in columns):
            return
        self._valve.take(stamp_ns, _curves(*columns), message.residual_sigma, message.cycle)


_FIELDS = ("measured", "predicted", "simulated", "residual")


def _curves(
    measured: FloatArray, predicted: FloatArray, simulated: FloatArray, residual: FloatArray
) -> dict[str, FloatArray]:
    return {
        "measured": measured,
        "predicted": predicted,
        "freerun": simulated,
        "residual": residual,
    }


def nothing(_: object) -> None:
    """Stand for the callback that nobody calls."""
