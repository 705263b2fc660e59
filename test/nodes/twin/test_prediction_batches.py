# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Predictions of single samples leave in batches: nothing lost, order kept, no wait for ever."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from valve_twin_msgs.msg import CycleSummary, Prediction, PredictionSeries

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, START_NS, Feeder
from valve_twin.core.types import Prediction as Block
from valve_twin.nodes.player.outbox import SubscriberGate
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.nodes.twin import publishers
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.prediction_batches import PredictionBatches, mean_period_s

PERIOD_S = 0.01
BATCH = 10


def block(steps, cycle: int = 1, sigma: float = 0.1) -> Block:
    """Return a block whose values tell its steps of the period."""
    steps = np.asarray(steps)
    values = steps.astype(float)
    stamps = 10_000_000 * steps.astype(np.int64)
    validity = (steps % 5).astype(np.uint8)
    return Block(cycle, stamps, values, values + 0.1, values + 0.2, values + 0.3, sigma, validity)


@pytest.fixture
def batches():
    return PredictionBatches(BATCH * PERIOD_S, PERIOD_S, 1.0)


def fed(batches, *blocks) -> list[list[int]]:
    """Return the steps of the series that come out, the last one flushed."""
    found = [s for b in blocks for s in batches.add(b, 0.0)] + batches.flush()
    for series in found:
        np.testing.assert_array_equal(series.stamp_ns, 10_000_000 * series.measured.astype(int))
        np.testing.assert_array_equal(series.residual, series.measured + 0.3)
        np.testing.assert_array_equal(series.validity, series.measured.astype(int) % 5)
    return [series.measured.astype(int).tolist() for series in found]


@pytest.mark.parametrize("size", [1, 3, 10, 25, 50])
def test_series_begin_and_end_with_the_data_however_it_comes(batches, size):
    parts = [block(range(k, min(k + size, 35))) for k in range(0, 35, size)]
    ends = [[0, 10], [10, 20], [20, 30], [30, 35]]
    assert fed(batches, *parts) == [list(range(*e)) for e in ends]


def test_a_gap_ends_a_series(batches):
    assert fed(batches, block([1, 2, 4, 5]), block([8])) == [[1, 2], [4, 5], [8]]


def test_a_stamp_that_goes_back_ends_a_series(batches):
    assert fed(batches, block([5, 6]), block([1, 2])) == [[5, 6], [1, 2]]


def test_a_series_belongs_to_one_cycle_and_one_model(batches):
    parts = block([1, 2]), block([3], cycle=2), block([4], cycle=2, sigma=0.2)
    assert fed(batches, *parts) == [[1, 2], [3], [4]]


def test_a_series_is_reproducible_or_not(batches):
    assert fed(batches, block([1]), replace(block([2]), reproducible=False)) == [[1], [2]]


def test_a_series_without_a_model_is_not_torn(batches):
    assert fed(batches, block([1], sigma=np.nan), block([2], sigma=np.nan)) == [[1, 2]]


def test_what_waits_is_due_by_the_steady_clock(batches):
    assert batches.due_s == np.inf
    batches.add(block([1]), 5.0)
    batches.add(block([2]), 5.5)
    assert batches.due_s == 6.0
    batches.flush()
    assert batches.due_s == np.inf


def test_the_period_of_a_series_is_that_of_its_stamps():
    assert mean_period_s(block([1, 2, 3]), 0.5) == 0.01
    assert mean_period_s(block([1]), 0.5) == 0.5


@pytest.fixture
def parameters(tmp_path):
    return {
        "history_url": f"sqlite:///{tmp_path}/history.sqlite",
        "prediction_batch_s": 0.6,
        **REARM,
    }


def stamps(series) -> list[int]:
    """Return the stamps of all samples, in the order in which they came [ns]."""
    return [
        from_time(m.header.stamp) + round(1e9 * m.period * k)
        for m in series
        for k in range(len(m.measured))
    ]


def test_every_sample_leaves_once_in_order_in_batches(graph, parameters, monkeypatch):
    def patient(batch_s, period_s, _):  # a stall of the machine is no end of the stream
        return PredictionBatches(batch_s, period_s, 600.0)

    monkeypatch.setattr(publishers, "PredictionBatches", patient)
    node = graph.host(TwinNode, **parameters)
    found = graph.record(f"{NS}/twin/prediction", PredictionSeries)
    feeder = Feeder(graph, NS)
    feeder.feed(200)
    topics = node._valves[0].inputs.topics  # what the middleware still has ends with the readers
    graph.spin_until(lambda: all(t.received == 200 for t in topics), what="all inputs")
    graph.spin_until(lambda: len(stamps(found)) > 180, what="all but the last batch")
    node.trigger_deactivate()
    graph.spin_until(lambda: len(stamps(found)) >= 200, what="200 samples")
    assert stamps(found) == [START_NS + i * feeder.period_ns for i in range(200)]
    first, *others = (sum(m.cycle == c for m in found) for c in (0, 1))
    assert others
    full = [len(m.measured) for m in found]
    del full[first - 1], full[-1]  # these end with their cycle and with the stream
    assert set(full) == {20}


def test_the_samples_are_those_of_single_messages(graph, parameters, tmp_path):
    single = {**parameters, "prediction_batch_s": 0.0, **_signals_of(NS)}
    single["history_url"] = f"sqlite:///{tmp_path}/single.sqlite"
    batched = graph.record(f"{NS}/twin/prediction", PredictionSeries)
    singles = graph.record("/single/twin/prediction", Prediction)
    graph.start("twin", **parameters)
    graph.start("twin", ns="/single", **single)
    own = [f"{ns}/twin/prediction" for ns in (NS, "/single")]
    graph.spin_until(lambda: graph.connected(*own), 120.0, "the publishers of both")
    for ns in (NS, "/single"):
        graph.be_heard(f"{ns}/twin")
    feeder = Feeder(graph, NS)
    gate = SubscriberGate(graph.node)
    graph.spin_until(
        lambda: gate.is_open(feeder.publishers, 2, time.monotonic()), 120.0, "both twins' inputs"
    )
    count = 2 * feeder.cycle_samples + 200  # the first estimate is in force from cycle 3 on
    feeder.feed(count)
    graph.spin_until(lambda: len(singles) >= count, what="single predictions")
    graph.spin_until(lambda: len(stamps(batched)) >= count, what="batched predictions")
    assert Prediction.VALID in {m.validity for m in singles}
    for name in ("measured", "predicted", "simulated", "residual", "validity"):
        together = np.concatenate([getattr(m, name) for m in batched])
        np.testing.assert_array_equal(together, [getattr(m, name) for m in singles])


def _signals_of(ns: str) -> dict[str, str]:
    names = {"v_in": "command/v_in", "v_out": "command/v_out", "spool_position": "spool_position"}
    return {f"signals.{signal}.topic": f"{ns}/{topic}" for signal, topic in names.items()}


def test_predictions_leave_before_the_end_of_their_cycle_is_told(graph, parameters):
    seen: list[tuple[str, int]] = []
    node = graph.host(TwinNode, **parameters | {"prediction_batch_s": 60.0})
    add = graph.node.create_subscription
    add(PredictionSeries, f"{NS}/twin/prediction", lambda m: seen.append(("series", m.cycle)), 100)
    add(CycleSummary, f"{NS}/twin/cycle", lambda m: seen.append(("cycle", m.cycle)), 100)
    feeder = Feeder(graph, NS)
    feeder.feed(2 * feeder.cycle_samples)
    graph.spin_until(lambda: ("cycle", 1) in seen and ("series", 1) in seen, what="cycle 1")
    assert ("series", 2) not in seen
    node.trigger_deactivate()
    graph.spin_until(lambda: ("series", 2) in seen, what="the rest")


def test_a_stream_that_stops_is_not_waited_for(graph, parameters):
    graph.host(TwinNode, **parameters)
    found = graph.record(f"{NS}/twin/prediction", PredictionSeries)
    feeder = Feeder(graph, NS)
    feeder.feed(7)
    graph.spin_until(lambda: len(stamps(found)) == 7, what="the samples before the stop")


def test_deactivation_loses_nothing(graph, parameters):
    node = graph.host(TwinNode, **parameters | {"prediction_batch_s": 60.0})
    found = graph.record(f"{NS}/twin/prediction", PredictionSeries)
    feeder = Feeder(graph, NS)
    feeder.feed(33)
    feeder.wait_until_received()
    graph.spin_until(lambda: sum(t.received + len(t._pending) for t in graph_inputs(node)) == 99)
    node.trigger_deactivate()
    graph.spin_until(lambda: len(stamps(found)) == 33, what="33 samples")


def graph_inputs(node):
    return [topic for valve in node._valves for topic in valve.inputs.topics]
