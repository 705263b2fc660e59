# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The monitor takes what is published and asks the history only for what it missed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs.msg import CycleSummary, Estimate, Maintenance
from valve_twin_msgs.srv import GetHistory

from test.nodes.aging.test_node import aging_valve
from test.nodes.conftest import NS
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.past.columns import past_of
from valve_twin.core.types import Maintenance as MaintenanceValue
from valve_twin.core.valves.registry import get_model
from valve_twin.nodes.aging import monitored_valve
from valve_twin.nodes.aging.node import AgingMonitorNode
from valve_twin.nodes.runtime.messages import estimate_message, to_message
from valve_twin.nodes.runtime.worker import Outcome

STORED, CYCLES = 12, 30
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
VALVE = [replace(e, missed_cycles=e.cycle % 3 - 1) for e in aging_valve(CYCLES)]


class Twin:
    """What a twin says of a history that the test makes."""

    def __init__(self, graph) -> None:
        self.graph, self.calls = graph, 0
        self.events: list[MaintenanceValue] = []
        self.history = list(VALVE[:STORED])
        make, base = graph.node.create_publisher, f"{NS}/twin"
        self.cycles = make(CycleSummary, f"{base}/cycle", LATCHED)
        self.estimates = make(Estimate, f"{base}/estimate", LATCHED)
        self.maintenance = make(Maintenance, f"{base}/maintenance", LATCHED)
        self.start()

    def start(self) -> None:
        name = f"{NS}/twin/get_history"
        self.service = self.graph.node.create_service(GetHistory, name, self.answer)

    def answer(self, request, response):
        self.calls += 1
        found = [e for e in self.history if e.cycle >= request.first_cycle]
        page = found[: request.limit]
        response.estimates = [estimate_message(NS, e, {}, stored=True) for e in page]
        response.missed_cycles = [e.missed_cycles for e in page]
        response.maintenance = [to_message(e) for e in self.events]
        response.more, response.success = len(found) > len(page), True
        return response

    def close_cycle(self, number: int, *, accepted: bool = True) -> None:
        missed = VALVE[number - 1].missed_cycles
        self.cycles.publish(CycleSummary(cycle=number, missed_cycles=missed, accepted=accepted))

    def publish_cycle(self, number: int) -> None:
        """Store a cycle and publish all that a twin publishes of it."""
        estimate = VALVE[number - 1]
        self.history.append(estimate)
        self.close_cycle(number)
        for other in ("kalman", "output_error"):
            message = estimate_message(NS, replace(estimate, estimator=other), {}, stored=True)
            self.estimates.publish(message)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Ask nobody twice where the machine has no core for the answer."""
    monkeypatch.setattr(monitored_valve, "ANSWER_S", 600.0)


@pytest.fixture
def twin(graph):
    return Twin(graph)


@pytest.fixture
def monitor(graph, twin):
    node = graph.host(AgingMonitorNode, retry_s=0.2)
    (valve,) = node._valves
    graph.spin_until(lambda: valve.assessment and valve.cycles == STORED, what="the history")
    publishers = (twin.cycles, twin.estimates, twin.maintenance)
    graph.spin_until(lambda: all(p.get_subscription_count() for p in publishers), what="a reader")
    return valve


def wait(graph, monitor, cycles: int) -> None:
    graph.spin_until(lambda: monitor.cycles == cycles, what=f"{cycles} cycles")


def assert_says_what_the_history_says(graph, twin, monitor) -> None:
    with np.printoptions(floatmode="unique", threshold=10**6):
        assert repr(monitor._buffer.past) == repr(past_of(twin.history))
    said = assess(
        twin.history, twin.events, AgingConfig(),
        parameters=get_model("press_cartridge").parameters, valve=NS,
    )  # fmt: skip
    graph.spin_until(lambda: repr(monitor.assessment.trends) == repr(said.trends))


def test_without_a_loss_the_history_is_asked_once(graph, twin, monitor):
    for number in range(STORED + 1, STORED + 6):
        twin.publish_cycle(number)
        wait(graph, monitor, number)
    graph.spin(0.5)  # more than two ticks of retry_s
    assert twin.calls == 1
    assert_says_what_the_history_says(graph, twin, monitor)


def test_a_lost_message_is_fetched(graph, twin, monitor):
    twin.publish_cycle(STORED + 1)
    wait(graph, monitor, STORED + 1)
    twin.history.append(VALVE[STORED + 1])  # stored, but not published
    twin.publish_cycle(STORED + 3)
    wait(graph, monitor, STORED + 3)
    assert twin.calls == 2
    twin.publish_cycle(STORED + 4)
    wait(graph, monitor, STORED + 4)
    assert twin.calls == 2
    assert_says_what_the_history_says(graph, twin, monitor)


def test_a_lost_summary_is_made_up_for(graph, twin, monitor):
    estimate = VALVE[STORED]
    twin.history.append(estimate)
    twin.estimates.publish(estimate_message(NS, estimate, {}, stored=True))
    wait(graph, monitor, STORED + 1)
    assert twin.calls == 2
    assert_says_what_the_history_says(graph, twin, monitor)


def test_a_refused_cycle_is_no_gap(graph, twin, monitor):
    twin.close_cycle(STORED + 1, accepted=False)
    twin.publish_cycle(STORED + 2)
    wait(graph, monitor, STORED + 1)
    graph.spin(0.5)
    assert twin.calls == 1
    assert_says_what_the_history_says(graph, twin, monitor)


def test_what_is_not_stored_waits_until_it_is(graph, twin, monitor):
    twin.close_cycle(STORED + 1)
    twin.estimates.publish(estimate_message(NS, VALVE[STORED], {}, stored=False))
    graph.spin(0.5)
    assert monitor.cycles == STORED
    twin.estimates.publish(estimate_message(NS, VALVE[STORED], {}, stored=True))
    wait(graph, monitor, STORED + 1)
    assert twin.calls == 1


def test_maintenance_is_told(graph, twin, monitor):
    event = MaintenanceValue(5, 7, "new seal", new_reference=True)
    twin.events.append(event)
    twin.maintenance.publish(to_message(event))
    graph.spin_until(lambda: monitor.assessment.trends[0].segments == 2, what="a new segment")
    assert twin.calls == 1
    assert_says_what_the_history_says(graph, twin, monitor)


def test_a_twin_that_was_away_is_asked_again(graph, twin, monitor):
    graph.node.destroy_service(twin.service)
    graph.spin_until(lambda: not monitor._answered, what="the twin to be missed")
    twin.history.append(VALVE[STORED])  # stored while it went down
    twin.start()
    wait(graph, monitor, STORED + 1)
    assert_says_what_the_history_says(graph, twin, monitor)


def test_a_cycle_that_is_stored_late_is_noticed(graph, twin):
    late = twin.history.pop(4)
    node = graph.host(AgingMonitorNode, retry_s=0.2)
    (monitor,) = node._valves
    graph.spin_until(lambda: monitor.assessment and monitor.cycles == STORED - 1, what="the rest")
    graph.spin_until(twin.estimates.get_subscription_count, what="a reader")
    twin.history.insert(4, late)
    message = estimate_message(NS, replace(late, estimator="output_error"), {}, stored=True)
    twin.estimates.publish(message)
    wait(graph, monitor, STORED)
    calls = twin.calls
    assert_says_what_the_history_says(graph, twin, monitor)
    twin.estimates.publish(message)  # which is known by now
    graph.spin(0.5)
    assert twin.calls == calls


def publish_late(twin, number):
    """Publish as stored an estimate of a cycle that the monitor did not read."""
    late = replace(VALVE[number - 1], estimator="output_error")
    twin.estimates.publish(estimate_message(NS, late, {}, stored=True))


def test_a_late_cycle_that_the_history_lacks_is_sought_once(graph, twin):
    twin.history.pop(4)
    node = graph.host(AgingMonitorNode, retry_s=0.2)
    (monitor,) = node._valves
    graph.spin_until(lambda: monitor.assessment and monitor.cycles == STORED - 1, what="the rest")
    graph.spin_until(twin.estimates.get_subscription_count, what="a reader")
    publish_late(twin, 5)
    graph.spin_until(lambda: twin.calls == 2 and monitor.cycles == STORED - 1, what="all anew")
    publish_late(twin, 5)  # as when it is latched and the monitor activated again
    graph.spin(0.5)
    assert twin.calls == 2


def test_a_history_that_is_read_anew_is_not_assessed_before_its_end(twin, monitor):
    known, monitor._buffer.late, monitor._busy = monitor.assessment, True, True
    monitor._on_estimate(estimate_message(NS, VALVE[0], {}, stored=True))
    monitor._changed = True  # the first page came
    monitor._on_assessed(Outcome(known, "", 0.0))  # of what was known before
    assert not monitor._busy


def test_an_answer_to_a_question_of_before_is_not_taken(monitor):
    known = monitor._buffer
    monitor._begin()
    monitor._on_answer(known, None)
    assert monitor.cycles == 0
    assert not monitor.failure
