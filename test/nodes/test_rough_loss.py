# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Ten percent of all messages are lost by a relay between the plant and the twin."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from valve_twin_msgs.msg import CycleSummary, Estimate, Faults, Prediction

from test.nodes.conftest import NodeProcess, make_graph
from test.nodes.feeding import START_NS, Feeder
from test.nodes.rough import LATCHED, TREND_ESTIMATOR

CLEAN, LOSSY = "/press/v1", "/press/v2"
SHARE = 0.1
CYCLES = 10
TOPICS = ("command/v_in", "command/v_out", "spool_position")


@dataclass
class Run:
    """What came of the same samples with and without loss."""

    feeder: Any
    dropped: dict[str, list[int]]
    predictions: list[Any]
    cycles: list[Any]
    clean: dict[int, Any]
    lossy: dict[int, Any]
    faults: dict[str, Any]
    figures: dict[str, str]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loss")
    graph = make_graph(folder)
    try:
        yield _run(graph, folder)
    finally:
        graph.close()


def _run(graph, folder: Path) -> Run:
    found = {v: graph.record(f"{v}/twin/estimate", Estimate, LATCHED) for v in (CLEAN, LOSSY)}
    predictions = graph.record(f"{LOSSY}/twin/prediction", Prediction)
    cycles = graph.record(f"{LOSSY}/twin/cycle", CycleSummary, LATCHED)
    told = graph.record("/press/twin/faults", Faults, LATCHED)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    relay = _relay(graph, folder)
    graph.start(
        "twin",
        ns="/press",
        valves=["v1", "v2"],
        history_url=f"sqlite:///{folder}/history.sqlite",
        **{"cycles.rearm_signal": "v_out"},
    )
    feeder = Feeder(graph, CLEAN)
    graph.spin_until(
        lambda: all(
            _readers(graph, f"{CLEAN}/{t}") == {"relay", "twin"}
            and _readers(graph, f"{LOSSY}/{t}") == {"twin"}
            and len(graph.node.get_publishers_info_by_topic(f"{LOSSY}/{t}")) == 1
            for t in TOPICS
        ),
        120.0,
        "relay and twin",
    )
    graph.wait_log(relay, "met")  # both sides of every match know of it
    graph.be_heard("/press/twin")
    for _ in range(CYCLES + 1):
        feeder.feed(feeder.cycle_samples)
        graph.spin(0.05)

    def by_cycle(valve: str) -> dict[int, Any]:
        return {m.cycle: m for m in found[valve] if m.estimator == TREND_ESTIMATOR}

    graph.spin_until(lambda: len(by_cycle(CLEAN)) == CYCLES, 120.0, "the clean estimates")
    graph.spin_until(lambda: len(by_cycle(LOSSY)) >= CYCLES, 120.0, "the lossy estimates")
    last = START_NS + (feeder.sent - 20) * feeder.period_ns
    graph.spin_until(lambda: stamps_of(predictions[-1:])[0] > last, 120.0, "the last samples")
    assert relay.end() == 0
    seen = len(diagnostics)
    graph.spin_until(lambda: len(diagnostics) > seen + 2, what="diagnostics")
    return Run(
        feeder,
        json.loads(relay.log.splitlines()[-1]),
        predictions,
        cycles,
        by_cycle(CLEAN),
        by_cycle(LOSSY),
        {f.code: f for f in told[-1].faults if f.valve == LOSSY},
        {
            v.key: v.value
            for s in diagnostics[-1].status
            if s.hardware_id == LOSSY
            for v in s.values
        },
    )


def _readers(graph, topic: str) -> set[str]:
    """Return who listens; a twin that hears nothing for seconds listens twice."""
    return {s.node_name for s in graph.node.get_subscriptions_info_by_topic(topic)}


def _relay(graph, folder: Path) -> NodeProcess:
    import os

    command = [sys.executable, str(Path(__file__).with_name("relay.py"))]
    command += [CLEAN, LOSSY, str(SHARE), "1", *TOPICS]
    # over UDP: shared memory may leave a reader deaf that a busy machine held for a second
    udp = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    environment = {**os.environ, **udp, "ROS_DOMAIN_ID": str(graph.domain)}
    process = NodeProcess(command, environment, folder / "relay.log")
    graph.processes.append(process)
    return process


def stamps_of(predictions) -> list[int]:
    return [p.header.stamp.sec * 10**9 + p.header.stamp.nanosec for p in predictions]


def test_every_sample_that_came_is_predicted_and_no_other(run):
    sent = {START_NS + i * run.feeder.period_ns for i in range(run.feeder.sent)}
    came = sent - set(run.dropped["spool_position"])
    assert len(came) == pytest.approx((1.0 - SHARE) * len(sent), rel=0.03)
    seen = stamps_of(run.predictions)
    assert seen == sorted(came)[: len(seen)]
    assert len(seen) >= len(came) - 100  # the last ones wait for a command


def test_every_lost_sample_is_counted(run):
    seen = stamps_of(run.predictions)
    inside = [s for s in run.dropped["spool_position"] if seen[0] < s < seen[-1]]
    fault = run.faults["input.gaps"]
    assert fault.events == len(inside)
    assert fault.subject == "spool_position"
    for topic in TOPICS:
        received, lost, _ = run.figures[f"{LOSSY}/{topic} received/lost/unreadable"].split("/")
        assert int(received) == run.feeder.sent - len(run.dropped[topic])
        assert lost == "0"  # the relay numbers what it sends by itself


def test_every_cycle_says_how_many_samples_it_lacks(run):
    for cycle in run.cycles:
        begin, end = (t.sec * 10**9 + t.nanosec for t in (cycle.start, cycle.end))
        assert cycle.lost == sum(begin < s < end for s in run.dropped["spool_position"])


@pytest.mark.parametrize(("gain", "one", "middle"), [("K_in", 0.05, 0.02), ("K_out", 0.15, 0.04)])
def test_an_estimate_is_near_that_without_loss_or_refused_with_its_reason(run, gain, one, middle):
    """A command that is lost is taken as held: the gains scatter more, their middle stays.

    The outlet is five times as fast, so that a lost command weighs more there.
    """
    pairs = []
    for number, estimate in run.lossy.items():
        if estimate.status == Estimate.REFUSED:
            assert estimate.reason
        elif number in run.clean:
            at = list(estimate.names).index(gain)
            pairs.append((estimate.values[at], run.clean[number].values[at]))
    ratio = np.array([a / b for a, b in pairs])
    assert len(pairs) >= CYCLES // 2
    assert np.abs(ratio - 1.0).max() < one
    assert abs(np.median(ratio) - 1.0) < middle
