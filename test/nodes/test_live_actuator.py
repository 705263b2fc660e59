# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The hybrid actuator live at its own 10 kHz: real processes, batches of 100 samples a message."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
import yaml
from valve_twin_msgs.msg import Estimate, Float64Series, PredictionSeries, Trend

from test.nodes.conftest import make_graph
from valve_twin.core.simulation import simulate_cycles
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.run import run_bag
from valve_twin.io.offline.simulated_bag import simulation_of, write_simulated_bag
from valve_twin.nodes.runtime.stamps import from_time

NAME = "/engine/valve_1"
BATCH, PERIOD_NS, SAMPLES = 100, 100_000, 2000
CYCLES = 13
"""Estimated ones: the monitor judges from ten on. One more is simulated, which ends the last."""


@dataclass
class Run:
    """What was on the network."""

    inputs: dict[str, list[Any]] = field(default_factory=dict)
    predictions: list[Any] = field(default_factory=list)
    estimates: list[Any] = field(default_factory=list)
    trend: list[Any] = field(default_factory=list)
    config: Any = None


@pytest.fixture(scope="module")
def run(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("actuator")
    graph = make_graph(folder)
    try:
        yield _live(graph, folder, root / "config" / "hybrid_actuator.yaml")
    finally:
        graph.close()


def _live(graph, folder, file) -> Run:
    (config,) = load_config(file)
    run = Run(config=config)
    for name in (*get_model(config.model).inputs, "position"):
        run.inputs[name] = graph.record(config.signals[name].topic, Float64Series)
    run.predictions = graph.record(f"{NAME}/twin/prediction", PredictionSeries)
    run.estimates = graph.record(f"{NAME}/twin/estimate", Estimate)
    run.trend = graph.record(f"{NAME}/aging_monitor/trend/magnet_force", Trend)
    given = ["--params-file", str(file)]
    history = {"history_url": f"sqlite:///{folder}/history.sqlite"}
    graph.start("twin", NAME, given, **history)
    graph.start("aging_monitor", NAME, given, **history)
    graph.be_heard(f"{NAME}/twin")
    live = {"rate": 1.0, "stop_after_cycles": CYCLES + 1, "wait_for_subscribers": 2}
    graph.start("simulated_valve", NAME, given, **live)
    graph.spin_until(
        lambda: sum(e.used_by_trend for e in run.estimates) >= CYCLES, 120.0, "the estimates"
    )
    graph.spin_until(lambda: run.trend and run.trend[-1].samples >= CYCLES, 120.0, "the trend")
    total = (CYCLES + 1) * SAMPLES
    graph.spin_until(lambda: _count(run.inputs["position"]) >= total, 120.0, "all positions")
    graph.spin_until(lambda: _count(run.predictions) >= CYCLES * SAMPLES, 120.0, "predictions")
    return run


def _count(messages) -> int:
    return sum(len(_values(m)) for m in messages)


def _values(message):
    return message.values if isinstance(message, Float64Series) else message.measured


def test_every_sample_comes_in_batches_at_ten_kilohertz(run):
    for name, messages in run.inputs.items():
        stamps = np.array([from_time(m.header.stamp) for m in messages])
        assert (np.diff(stamps) == BATCH * PERIOD_NS).all(), name
        assert {len(m.values) for m in messages} == {BATCH}
        assert {m.period for m in messages} == {1e-4}


def test_the_samples_are_those_of_the_seed(run):
    simulation = simulation_of(run.config)
    blocks = list(simulate_cycles(simulation, 2, 1))
    found = np.concatenate([m.values for m in run.inputs["position"]])[: 2 * SAMPLES]
    np.testing.assert_array_equal(found, np.concatenate([b.position for b in blocks]))


def test_every_sample_has_its_prediction(run):
    measured = np.concatenate([m.measured for m in run.predictions])
    sent = np.concatenate([m.values for m in run.inputs["position"]])
    np.testing.assert_array_equal(measured[: CYCLES * SAMPLES], sent[: CYCLES * SAMPLES])


def test_the_live_estimates_are_those_of_a_bag(run, tmp_path):
    write_simulated_bag(run.config, tmp_path / "bag", cycles=CYCLES + 1, seed=1)
    offline = run_bag(run.config, tmp_path / "bag").estimates
    fed = [e for e in run.estimates if e.used_by_trend]
    assert [e.cycle for e in fed] == list(range(1, CYCLES + 1))
    assert {e.status for e in fed} == {Estimate.ACCEPTED}
    by_key = {(e.cycle, e.estimator): e for e in offline}
    for live in run.estimates:
        own = by_key[live.cycle, live.estimator]
        np.testing.assert_array_equal(live.values, [p.value for p in own.parameters])


def test_the_next_cycle_is_predicted(run):
    fed = [e for e in run.estimates if e.used_by_trend]
    assert all(e.fit_test > 99.5 for e in fed[2:])


def test_the_trend_follows(run):
    last = run.trend[-1]
    assert last.parameter == "magnet_force"
    assert last.samples >= CYCLES


def test_a_soft_landing_is_the_same_live_and_offline(root, tmp_path):
    tree = yaml.safe_load((root / "config" / "hybrid_actuator.yaml").read_text(encoding="utf-8"))
    tree["/**"]["ros__parameters"]["simulation"]["plant"]["control"] = "soft_landing"
    file = tmp_path / "soft.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    (config,) = load_config(file)
    write_simulated_bag(config, tmp_path / "bag", cycles=3, seed=1)
    offline = [e for e in run_bag(config, tmp_path / "bag").estimates if e.used_by_trend]
    graph = make_graph(tmp_path)
    try:
        estimates = graph.record(f"{NAME}/twin/estimate", Estimate)
        given = ["--params-file", str(file)]
        graph.start("twin", NAME, given, history_url=f"sqlite:///{tmp_path}/history.sqlite")
        graph.be_heard(f"{NAME}/twin")
        live: dict[str, Any] = {"rate": 1.0, "stop_after_cycles": 3, "wait_for_subscribers": 1}
        graph.start("simulated_valve", NAME, given, **live)
        graph.spin_until(lambda: sum(e.used_by_trend for e in estimates) >= 2, 120.0, "estimates")
    finally:
        graph.close()
    fed = [e for e in estimates if e.used_by_trend]
    for here, own in zip(fed, offline, strict=False):
        np.testing.assert_array_equal(here.values, [p.value for p in own.parameters])
        by_name = dict(zip(here.names, here.values, strict=True))
        assert by_name["seating_speed_open"] < 0.1
        assert by_name["seating_speed_closed"] < 0.1
        assert by_name["spring_rate"] == pytest.approx(18820.0, rel=0.01)
        assert by_name["magnet_force"] == pytest.approx(128.0, rel=0.02)
