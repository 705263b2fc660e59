# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bytes that are made without the message class are those that the class makes."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from valve_twin_msgs.msg import PredictionSeries

from valve_twin.core.types import Prediction
from valve_twin.nodes.convert import series_bytes

PERIOD_S = 0.01


@pytest.mark.parametrize("count", [1, 2, 3, 100])
def test_a_series_is_serialized_as_its_message_class_does(count):
    rng = np.random.default_rng(count)
    stamps = 5_000_000_123 + 10_000_000 * np.arange(count)
    columns = rng.normal(size=(4, count))
    validity = rng.integers(0, 6, count).astype(np.uint8)
    measured, *others = columns
    prediction = Prediction(7, stamps, measured, others[0], others[1], others[2], 0.25, validity)
    (data,) = series_bytes(prediction, PERIOD_S)
    message = deserialize_message(data, PredictionSeries)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 123)
    assert (message.period, message.cycle, message.residual_sigma) == (PERIOD_S, 7, 0.25)
    for name, column in zip(
        ("measured", "predicted", "simulated", "residual"), columns, strict=True
    ):
        assert list(getattr(message, name)) == column.tolist()
    assert list(message.validity) == validity.tolist()
    assert len(serialize_message(message)) - len(data) in range(4)  # the class pads its end


def test_a_gap_parts_a_series():
    stamps = 10_000_000 * np.array([1, 2, 4, 5, 6])
    column, nothing = np.arange(5.0), np.full(5, np.nan)
    validity = np.zeros(5, dtype=np.uint8)
    prediction = Prediction(1, stamps, column, nothing, nothing, nothing, np.nan, validity)
    found = [deserialize_message(d, PredictionSeries) for d in series_bytes(prediction, PERIOD_S)]
    assert [list(m.measured) for m in found] == [[0.0, 1.0], [2.0, 3.0, 4.0]]
