# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters and event log of a running twin, and of the next one."""

from __future__ import annotations

import pytest
from valve_twin_msgs.msg import Counters, Estimate, Trend, Verdict
from valve_twin_msgs.srv import (
    AcknowledgeEvent,
    GetEvents,
    GetHistory,
    MarkMaintenance,
    WithdrawMaintenance,
)

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, Feeder
from test.nodes.twin.test_node import feed_cycles
from valve_twin.io.history.store import History
from valve_twin.nodes.twin.node import TwinNode
from valve_twin.nodes.twin.publishers import LAST


@pytest.fixture
def parameters(tmp_path):
    return {"history_url": f"sqlite:///{tmp_path}/history.sqlite", **REARM}


def codes(answer):
    return [e.code for e in answer.events]


def test_counters_are_those_of_the_history_and_go_on_in_the_next_twin(graph, parameters):
    estimates = graph.record(f"{NS}/twin/estimate", Estimate)
    heard = graph.record(f"{NS}/twin/counters", Counters, LAST)
    first = graph.host(TwinNode, **parameters)
    feeder = Feeder(graph, NS)
    feed_cycles(graph, feeder, estimates, 3)
    graph.spin_until(lambda: heard and heard[-1].cycle == 2, what="the counters")
    told = heard[-1]
    with History(parameters["history_url"], read_only=True) as history:
        kept = history.log.counters(NS)
    assert kept is not None
    assert (told.cycles, told.movements, told.travel) == (2, kept.movements, kept.travel)
    assert told.cycles == 2
    assert told.movements >= 4  # each cycle fills and empties once at least
    assert told.travel == pytest.approx(told.strokes)
    assert told.hours_open + told.hours_closed == pytest.approx(told.hours, rel=0.01)
    assert sum(told.span_counts) == told.reversals == told.movements - 1
    assert len(told.span_edges) == len(told.span_counts) + 1
    first.stop()
    graph.executor.remove_node(first)
    graph.hosted.remove(first)
    first.destroy_node()
    again = graph.record(f"{NS}/twin/counters", Counters, LAST)
    graph.host(TwinNode, **parameters)
    graph.spin_until(lambda: bool(again), what="the counters of the next twin")
    assert (again[-1].cycles, again[-1].travel) == (2, told.travel)


def test_an_unknown_estimator_is_told_also_of_an_empty_history(graph, parameters):
    graph.host(TwinNode, **parameters)
    name = f"{NS}/twin/get_history"
    answer = graph.call(GetHistory, name, estimator="output_eror")
    assert answer.success
    assert "no estimator 'output_eror': did you mean 'output_error'" in answer.message
    assert not graph.call(GetHistory, name, estimator="output_error").message


def test_events_are_listed_and_acknowledged(graph, parameters):
    graph.host(TwinNode, **parameters)
    monitor = graph.stranger("monitor")
    says = monitor.create_publisher(Verdict, f"{NS}/aging_monitor/verdict", LAST)
    mark = graph.call(MarkMaintenance, f"{NS}/twin/mark_maintenance", note="new seal")
    assert mark.success
    graph.spin_until(lambda: says.get_subscription_count() > 0, what="the twin's ear")
    message = Verdict(verdict=Verdict.SENSOR, text="sensor", fault="sensor_freeze", cycle=3)
    says.publish(message)

    def listed(**asked):
        return graph.call(GetEvents, f"{NS}/twin/get_events", **asked)

    graph.spin_until(lambda: len(listed().events) == 3, what="the fault in the log")
    found = listed()
    assert codes(found) == ["twin.start", "maintenance.marked", "fault.sensor_freeze"]
    assert (found.success, found.more, found.events[2].status) == (True, False, "failure")
    page = listed(limit=1)
    assert (codes(page), page.more) == (["twin.start"], True)
    assert codes(listed(first_id=page.events[0].id + 1, limit=1)) == ["maintenance.marked"]
    name = f"{NS}/twin/acknowledge_event"
    refused = graph.call(AcknowledgeEvent, name, id=found.events[2].id)
    assert (refused.success, refused.acknowledged) == (False, 0)
    assert "who is empty" in refused.message
    seen = graph.call(AcknowledgeEvent, name, id=found.events[2].id, who="J. Doe", note="cable")
    assert (seen.success, seen.acknowledged) == (True, 1)
    assert codes(listed(open_only=True)) == []
    assert listed().events[2].acknowledged_by == "J. Doe"


def test_a_limit_that_is_passed_enters_the_log_of_a_twin_once(graph, parameters):
    graph.host(TwinNode, **parameters)
    monitor = graph.stranger("monitor")
    says = monitor.create_publisher(Trend, f"{NS}/aging_monitor/trend/K_in", LAST)
    graph.spin_until(lambda: says.get_subscription_count() > 0, what="the twin's ear")

    def logged():
        return codes(graph.call(GetEvents, f"{NS}/twin/get_events"))

    states = (Trend.LIMIT_WITHIN, Trend.LIMIT_WARNING, Trend.LIMIT_WARNING, Trend.LIMIT_ALARM)
    wanted = ["twin.start"]
    for second, state in enumerate(states, 1):
        message = Trend(valve=NS, parameter="K_in", unit="1", limit_state=state)
        message.header.stamp.sec = second
        says.publish(message)
        entry = {Trend.LIMIT_WARNING: "limit_warning.K_in", Trend.LIMIT_ALARM: "limit_alarm.K_in"}
        if state in entry and entry[state] not in wanted:
            wanted.append(entry[state])
        graph.spin_until(lambda: logged() == wanted, what=f"{wanted} in the log")


def test_numbers_beyond_all_and_texts_without_end_are_answered_in_one_line(graph, parameters):
    graph.host(TwinNode, **parameters)
    most = 2**64 - 1
    history = graph.call(GetHistory, f"{NS}/twin/get_history", first_cycle=most, limit=2**32 - 1)
    assert (history.success, history.message, history.estimates) == (True, "", [])
    events = graph.call(GetEvents, f"{NS}/twin/get_events", first_id=most, limit=2**32 - 1)
    assert (events.success, events.message, events.events) == (True, "", [])
    name = f"{NS}/twin/acknowledge_event"
    seen = graph.call(AcknowledgeEvent, name, id=most, who="me")
    assert seen.message == f"{NS}: there is no entry {most}: get_events lists them"
    seen = graph.call(AcknowledgeEvent, name, id=0, who="w" * 10**6)
    assert seen.message == f"{NS}: who has 1000000 bytes, 200 at most: shorten it"
    back = graph.call(WithdrawMaintenance, f"{NS}/twin/withdraw_maintenance", cycle=most, note="n")
    assert "is not there" in back.message
    assert (seen.success, back.success) == (False, False)
