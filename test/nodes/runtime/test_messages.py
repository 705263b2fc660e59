# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bytes that are made without the message class are those that the class makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from valve_twin_msgs import msg
from valve_twin_msgs.msg import PredictionSeries

from valve_twin.core.aging.verdict import Trend, TrendStatus, Verdict, VerdictKind
from valve_twin.core.types import (
    Condition,
    Disagreement,
    Estimate,
    EstimateStatus,
    Guard,
    MaskCounts,
    ParameterStatus,
    ParameterValue,
    Prediction,
)
from valve_twin.gateway.foxglove.messages import aging_bytes, estimate_bytes
from valve_twin.nodes.runtime.messages import (
    estimate_message,
    estimate_value,
    series_bytes,
    to_message,
)

PERIOD_S = 0.01


@pytest.mark.parametrize("count", [1, 2, 3, 100])
def test_a_series_is_serialized_as_its_message_class_does(count):
    rng = np.random.default_rng(count)
    stamps = 5_000_000_123 + 10_000_000 * np.arange(count)
    columns = rng.normal(size=(4, count))
    validity = rng.integers(0, 6, count).astype(np.uint8)
    x, p, s, r = columns
    said = count % 2 == 0
    prediction = Prediction(7, stamps, x, p, s, r, 0.25, validity, said)
    (data,) = series_bytes(prediction, PERIOD_S)
    message = deserialize_message(data, PredictionSeries)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 123)
    assert (message.period, message.cycle, message.residual_sigma) == (PERIOD_S, 7, 0.25)
    for name, column in zip(
        ("measured", "predicted", "simulated", "residual"), columns, strict=True
    ):
        assert list(getattr(message, name)) == column.tolist()
    assert list(message.validity) == validity.tolist()
    assert message.reproducible is said
    assert len(serialize_message(message)) - len(data) in range(4)  # the class pads its end


def test_a_gap_parts_a_series():
    stamps = 10_000_000 * np.array([1, 2, 4, 5, 6])
    column, nothing = np.arange(5.0), np.full(5, np.nan)
    validity = np.zeros(5, dtype=np.uint8)
    prediction = Prediction(1, stamps, column, nothing, nothing, nothing, np.nan, validity)
    found = [deserialize_message(d, PredictionSeries) for d in series_bytes(prediction, PERIOD_S)]
    assert [list(m.measured) for m in found] == [[0.0, 1.0], [2.0, 3.0, 4.0]]


ESTIMATE = Estimate(
    model="press_cartridge",
    estimator="output_error",
    cycle=7,
    start_ns=3_000_000_001,
    end_ns=9_000_000_002,
    parameters=(
        ParameterValue("K_in", 0.01, ParameterStatus.OK, "", 1e-4, 0.0098, 0.0102),
        ParameterValue("leak", 0.0, ParameterStatus.AT_BOUND, "rests on its bound 0"),
    ),
    status=EstimateStatus.PARTIAL,
    reason="at bound: leak",
    mse_test=1e-6,
    mse_train=2e-6,
    fit_test=97.0,
    fit_train=98.0,
    condition_number=float("inf"),
    lag=2,
    noise_sigma=1e-3,
    counts=MaskCounts(800, 30, 20, 10),
    missed_cycles=0,
    used_by_trend=True,
    trend_reason="output_error always feeds the trend",
    disagreements=(Disagreement("kalman", "K_in", 1e-5, 0.1),),
    guards=(Guard("bound", False, 1.0, 0.0, "leak rests on its bound"),),
    conditions=(Condition("stroke", 0.28),),
)


def test_an_estimate_comes_back_from_its_message_whole():
    message = estimate_message("/v", ESTIMATE, {"leak": "1/s"}, stored=True)
    back = estimate_value(deserialize_message(serialize_message(message), type(message)))
    assert repr(back) == repr(ESTIMATE)  # unlike ==, NaN is NaN


def test_the_gateway_makes_the_messages_of_the_nodes_without_ros():
    guards = (Guard("residual", True, 0.1, 0.2, "fine"),)
    estimate = replace(ESTIMATE, mse_train=np.nan, fit_test=np.nan, guards=guards)
    units = {"K_in": "1/s"}
    ours = estimate_bytes("/press/v1", estimate, units)
    theirs = serialize_message(estimate_message("/press/v1", estimate, units, stored=True))
    assert repr(deserialize_message(ours, msg.Estimate)) == repr(
        deserialize_message(theirs, msg.Estimate)
    )
    trend = Trend(5_000_000_001, "/press/v1", "K_in", "1/s", "cycles", TrendStatus.DRIFTING,
                  "it drifts", 30, 1, 1.0, 30.0, level=0.01, service_date_ns=2**62)  # fmt: skip
    verdict = Verdict(9, "/press/v1", VerdictKind.VALVE, "valve", "K_in -15 %", 30, "K_in")
    for record, kind in ((trend, msg.Trend), (verdict, msg.Verdict)):
        ours, theirs = aging_bytes(record), serialize_message(to_message(record))
        assert repr(deserialize_message(ours, kind)) == repr(deserialize_message(theirs, kind))
