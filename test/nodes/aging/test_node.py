# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The aging monitor says what the stored history says, whenever it comes."""

from dataclasses import replace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs.msg import Trend, Verdict
from valve_twin_msgs.srv import MarkMaintenance, WithdrawMaintenance

from test.nodes.conftest import NS
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.verdict import VerdictKind
from valve_twin.core.types import Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.registry import get_model
from valve_twin.io.history.store import History
from valve_twin.io.history.tables import CycleRecord
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.runtime.messages import to_message
from valve_twin.nodes.runtime.worker import Outcome
from valve_twin.nodes.twin.node import TwinNode

CYCLES = 40
CYCLE_NS = 25_000_000_000
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def aging_valve(cycles=CYCLES, drift=-0.002):
    """Estimates of a valve whose K_in falls by 0.2 % a cycle, with scatter."""
    random = np.random.default_rng(5)
    for n in range(1, cycles + 1):
        gain = 0.02 * (1.0 + drift * n) * (1.0 + 0.002 * random.standard_normal())
        yield Estimate(
            model="press_cartridge",
            estimator="output_error",
            cycle=n,
            start_ns=n * CYCLE_NS,
            end_ns=(n + 1) * CYCLE_NS - 30_000_000,
            parameters=(ParameterValue("K_in", gain),),
            status=EstimateStatus.ACCEPTED,
            reason="accepted",
            used_by_trend=True,
        )


def record_of(estimate):
    return CycleRecord(
        cycle=estimate.cycle,
        start_ns=estimate.start_ns,
        end_ns=estimate.end_ns,
        samples=850,
    )


@pytest.fixture
def history(tmp_path):
    url = f"sqlite:///{tmp_path}/history.sqlite"
    with History(url) as made:
        for estimate in aging_valve():
            made.store(NS, record_of(estimate), [estimate])
    return {"history_url": url}


def test_it_says_what_the_history_says_page_by_page(graph, history):
    graph.host(TwinNode, **history)
    graph.host(AgingMonitorNode, page=7)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend, LATCHED)
    graph.spin_until(lambda: trends and trends[-1].samples == CYCLES, what="a trend of all cycles")
    with History(history["history_url"], read_only=True) as stored:
        said = assess(
            stored.estimates(NS), (), AgingConfig(),
            parameters=get_model("press_cartridge").parameters, valve=NS,
        )  # fmt: skip
    trend = next(t for t in said.trends if t.parameter == "K_in")
    assert repr(trends[-1]) == repr(to_message(trend))  # what is not asked is NaN
    assert trends[-1].drift_reference < 0.0


def test_it_waits_for_a_twin_and_says_for_which(graph, history, capfd):
    graph.host(AgingMonitorNode, retry_s=0.1)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    missing = f"service {NS}/twin/get_history is not there"

    def is_told() -> bool:
        status = diagnostics[-1].status[0] if diagnostics else DiagnosticStatus()
        return status.level == DiagnosticStatus.STALE and (
            f"{missing}: start the twin" in status.message
        )

    graph.spin_until(lambda: diagnostics, what="the first diagnostics")
    assert missing not in diagnostics[0].status[0].message, "the twin may be starting"
    graph.spin_until(is_told, what="the diagnostics of the missing twin")
    log: list[str] = []

    def is_logged() -> bool:
        log.append(capfd.readouterr().err)
        return missing in "".join(log)

    graph.spin_until(is_logged, what="the log of the missing twin")
    verdicts = graph.record(f"{NS}/aging_monitor/verdict", Verdict, LATCHED)
    graph.host(TwinNode, **history)
    graph.spin_until(lambda: verdicts, what="a verdict once the twin is there")


def test_maintenance_begins_a_new_segment(graph, history):
    graph.host(TwinNode, **history)
    name = f"{NS}/twin/mark_maintenance"
    assert graph.call(MarkMaintenance, name, note="new seat", cycle=25).success
    graph.host(AgingMonitorNode)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend, LATCHED)
    graph.spin_until(lambda: trends, what="a trend")
    assert trends[-1].segments == 2
    assert trends[-1].segment_start >= 25.0
    assert trends[-1].samples <= CYCLES - 24


def test_a_running_monitor_sees_that_a_mark_is_withdrawn(graph, history):
    graph.host(TwinNode, **history)
    graph.host(AgingMonitorNode)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend, LATCHED)
    graph.spin_until(lambda: trends, what="a trend")
    before = repr(trends[-1])
    mark, withdraw = f"{NS}/twin/mark_maintenance", f"{NS}/twin/withdraw_maintenance"
    assert graph.call(MarkMaintenance, mark, note="new seat", cycle=25, new_reference=True).success
    graph.spin_until(lambda: trends[-1].segments == 2, what="a new segment")
    assert graph.call(WithdrawMaintenance, withdraw, note="another valve", cycle=25).success
    graph.spin_until(lambda: repr(trends[-1]) == before, what="the trend as it was")


def test_a_late_reader_gets_trend_and_verdict(graph, history):
    graph.host(TwinNode, **history)
    monitor = graph.host(AgingMonitorNode, **{"aging.default_percent": 5.0})
    graph.spin_until(
        lambda: monitor._valves[0].assessment is not None, what="the first assessment"
    )
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend, LATCHED)
    verdicts = graph.record(f"{NS}/aging_monitor/verdict", Verdict, LATCHED)
    graph.spin_until(lambda: trends and verdicts, what="the latched messages")
    assert verdicts[-1].text == "valve"
    assert "K_in" in verdicts[-1].evidence


def test_a_verdict_that_changes_is_logged_each_time(graph, history, capfd):
    graph.host(TwinNode, **history)
    monitor = graph.host(AgingMonitorNode, **{"aging.default_percent": 5.0})
    (valve,) = monitor._valves
    worn = graph.spin_until(lambda: valve.assessment, what="the first assessment")
    new = replace(worn, verdict=replace(worn.verdict, kind=VerdictKind.OK, text="ok"))
    for said in (new, worn, new):
        valve._on_assessed(Outcome(said, "", 0.0))
    levels = [line[:6] for line in capfd.readouterr().err.splitlines() if ": K_in -" in line]
    assert levels == ["[WARN]", "[INFO]", "[WARN]", "[INFO]"]
