# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From a PLC in its own process over the node to topics and to a twin that stores its cycles."""

from __future__ import annotations

import math
import re
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from valve_twin_msgs.msg import Float64Series, Float64Stamped

pytest.importorskip("asyncua", reason="needs the extra gateway")

from test.nodes.conftest import DEEP, NS
from test.nodes.opcua_source.plc import Plc
from test.nodes.opcua_source.test_subscription import BAD_SENSOR, LATER_NS, MS, START_NS
from test.ports import free_port
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.history.store import History
from valve_twin.nodes.opcua_source.node import OpcuaSourceNode
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.report.language.words import sentence, words

pytestmark = pytest.mark.usefixtures("patience")

TOPIC = f"/plc{NS}/position"
HOUR_NS = 3600 * 10**9


@pytest.fixture
def plc():
    made = Plc(free_port(), 3)
    yield made
    made.kill()


def diagnostics(graph) -> dict[str, str]:
    """Fill with the figures of the node as they come."""
    figures: dict[str, str] = {}

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            if "tags of opc.tcp" in status.name:
                figures.update({v.key: v.value for v in status.values}, message=status.message)

    graph.node.create_subscription(DiagnosticArray, "/diagnostics", take, DEEP)
    return figures


def host(graph, plc, tags, **more):
    figures = diagnostics(graph)
    graph.host(OpcuaSourceNode, address=plc.address, tags=tags, **more)
    graph.spin_until(lambda: figures.get("connected") == "True", what="the PLC")
    return figures


def test_tags_are_published_with_the_stamps_of_their_source_and_masked_where_bad(graph, plc):
    found = graph.record(TOPIC, Float64Stamped)
    figures = host(graph, plc, ["position ns=1;s=tag0", "other ns=1;s=renamed"])
    graph.spin_until(lambda: graph.connected(TOPIC), what="a publisher")
    plc.write({0: [1.0, 1.0, 2.0]}, START_NS, 30 * MS)
    plc.write({0: [7.0]}, START_NS + 90 * MS, 30 * MS, status=BAD_SENSOR)

    def mine():
        return [m for m in found if from_time(m.header.stamp) < LATER_NS]

    graph.spin_until(lambda: len(mine()) >= 4, what="samples")
    assert [from_time(m.header.stamp) for m in mine()] == [
        START_NS + i * 30 * MS for i in range(4)
    ]
    assert [m.value for m in mine()][:3] == [1.0, 1.0, 2.0]
    assert math.isnan(mine()[3].value)
    graph.spin_until(lambda: figures["masked (status not good)"] == "1", what="a count")
    assert "the server has no tag ns=1;s=renamed (BadNodeIdUnknown)" in figures["message"]
    assert "the PLC's clock is -" in figures["message"]


def test_a_clock_that_is_an_hour_wrong_is_told_and_an_old_value_is_no_wrong_clock(graph, plc):
    plc.write({2: [1.0]}, time.time_ns() - 2 * HOUR_NS, MS)  # has not changed since
    figures = host(graph, plc, [f"t{tag} ns=1;s=tag{tag}" for tag in (0, 1, 2)])
    graph.spin_until(lambda: figures["samples"] == "3", what="the values of the start")
    assert figures["clock of the PLC ahead [s]"] == "0.000"
    assert "clock" not in figures["message"]
    plc.write({2: [2.0]}, time.time_ns() - HOUR_NS, MS)
    graph.spin_until(lambda: "clock" in figures["message"], what="a word")
    assert re.search(r"the PLC's clock is -36\d\d s from this", figures["message"])
    plc.write({2: [3.0]}, time.time_ns() + HOUR_NS, MS)
    ahead = re.compile(r"the PLC's clock is \+3[56]\d\d s from this machine's")
    graph.spin_until(lambda: ahead.search(figures["message"]), what="another word")


def test_many_missing_tags_are_one_line(graph, plc, capfd):
    tags = ["position ns=1;s=tag0", *(f"t{number} ns=1;s=gone{number}" for number in range(40))]
    figures = host(graph, plc, tags)
    word = "the server has none of 40 of 41 tags, the first is ns=1;s=gone0 (BadNodeIdUnknown)"
    graph.spin_until(lambda: word in figures["message"], what="a word")
    assert capfd.readouterr().err.count("BadNodeIdUnknown") == 1


def test_overflows_are_told_again_after_a_restart(graph, plc):
    node = graph.host(OpcuaSourceNode, address=plc.address, tags=["position ns=1;s=tag0"])
    graph.spin_until(lambda: node._subscription.figures.connected, what="the PLC")
    for _ in range(2):
        node._subscription.figures.overflows = 3
        before = lost(node)
        list(node._reports())
        assert lost(node) == before + 3
        assert any("one sample or more is lost" in f.evidence for f in node.faults.faults())
        assert node.trigger_deactivate() == node.trigger_activate()


def test_what_the_node_does_not_take_in_time_is_told_as_a_loss(graph, plc):
    node = graph.host(OpcuaSourceNode, address=plc.address, tags=["position ns=1;s=tag0"])
    graph.spin_until(lambda: node._subscription.figures.connected, what="the PLC")
    node._subscription.figures.dropped = 5
    graph.spin_until(lambda: lost(node) == 5, what="a word")
    (fault,) = (f for f in node.faults.faults() if f.kind.code == "input.loss")
    assert "5 samples came faster than this node publishes" in fault.evidence
    assert "lang=" not in sentence(fault.evidence, words("de"))


def test_where_stamps_tell_what_is_missing_samples_not_taken_in_time_are_among_it(graph, plc):
    tags = ["position ns=1;s=tag0"]
    node = graph.host(OpcuaSourceNode, address=plc.address, tags=tags, period_s=0.001)
    graph.spin_until(lambda: node._subscription.figures.connected, what="the PLC")
    node._subscription.figures.dropped = 5
    (grid,) = node._grids
    grid.missing = 5
    graph.spin_until(lambda: lost(node), what="a word")
    (fault,) = (f for f in node.faults.faults() if f.kind.code == "input.loss")
    assert fault.events == 5
    assert fault.evidence.endswith("or give the process more computing time")
    assert "lang=" not in sentence(fault.evidence, words("de"))
    grid.missing = 8
    graph.spin_until(lambda: lost(node) == 8, what="what the network lost")
    (fault,) = (f for f in node.faults.faults() if f.kind.code == "input.loss")
    assert fault.evidence.endswith("look at the load of PLC and network")


def test_stamps_that_go_back_are_told_and_a_clock_that_was_set_once_is_not(graph, plc):
    figures = host(graph, plc, ["position ns=1;s=tag0", "other ns=1;s=tag1"])
    (node,) = graph.hosted
    plc.write({0: [1.0, 2.0]}, START_NS, 30 * MS)  # what it began with is of today
    plc.write({1: [1.0] * 8}, START_NS, -30 * MS)
    counted = "stamped before the one before"
    graph.spin_until(lambda: figures[counted] == "9", what="a count")
    (fault,) = (f for f in node.faults.faults() if f.kind.code == "stamps.late")
    assert "of ns=1;s=tag1 the most, 8 in all" in fault.evidence
    assert "lang=" not in sentence(fault.evidence, words("de"))


def test_a_message_that_cannot_be_read_is_told_as_a_loss(graph, plc):
    node = graph.host(OpcuaSourceNode, address=plc.address, tags=["position ns=1;s=tag0"])
    graph.spin_until(lambda: node._subscription.figures.connected, what="the PLC")
    node._subscription._said.lost, node._subscription._said.lost_why = 2, "cut short"
    graph.spin_until(lambda: lost(node) == 2, what="a word")
    (fault,) = (f for f in node.faults.faults() if f.kind.code == "input.loss")
    assert "2 messages of the server cannot be read, whatever samples they" in fault.evidence
    assert "cut short" in fault.evidence


def test_what_a_short_queue_loses_is_counted_by_stamps_and_told_with_what_to_do(graph, capfd):
    plc, period_ms = Plc(free_port(), 2, queue=10, publishing_ms=1000.0), 20
    tags = ["position ns=1;s=tag0", "other ns=1;s=tag1"]
    figures = diagnostics(graph)
    node = graph.host(OpcuaSourceNode, address=plc.address, tags=tags, period_s=period_ms / 1e3)
    try:
        graph.spin_until(lambda: figures.get("samples") == "2", what="the first values")
        plc.write({0: [0.0]}, START_NS, period_ms * MS)
        graph.spin_until(lambda: figures.get("samples") == "3", what="one that counts")
        plc.begin(
            {0: [1.0] * 100}, START_NS + period_ms * MS, period_ms * MS, pace=1e3 / period_ms
        )
        graph.spin_until(
            lambda: int(figures["samples"]) + int(figures["lost (stamps missing)"]) == 103,
            what="all, here or counted",
        )
        assert figures["sent every [ms]"] == "1000"
        assert lost(node) == int(figures["lost (stamps missing)"]) > 20
        word = (
            "the server keeps 10 samples of ns=1;s=tag0 and of 1 tags more, 200 ms at 50 Hz, and"
        )
        assert word in figures["message"]
        (fault,) = (f for f in node.faults.faults() if f.kind.code == "input.loss")
        assert re.search(
            r"\d+ samples are missing by their stamps, of ns=1;s=tag0", fault.evidence
        )
        assert "let the server's settings allow a queue of 100" in fault.evidence
        said = capfd.readouterr().err
        assert len([line for line in said.splitlines() if line.endswith("cannot help")]) == 1
    finally:
        plc.kill()


def lost(node) -> int:
    return sum(f.events for f in node.faults.faults() if f.kind.code == "input.loss")


def test_with_a_period_they_go_in_series_and_a_missing_one_is_counted(graph, plc):
    found = graph.record(TOPIC, Float64Series)
    figures = host(graph, plc, ["position ns=1;s=tag0"], period_s=0.001)
    graph.spin_until(lambda: graph.connected(TOPIC), what="a publisher")
    plc.write({0: [float(i) for i in range(300)]}, START_NS, MS, pace=1000.0)
    plc.write({0: [301.0]}, START_NS + 301 * MS, MS)

    def values():
        return [v for m in found for v in m.values if from_time(m.header.stamp) < LATER_NS]

    graph.spin_until(lambda: len(values()) >= 301, what="samples")
    assert [v for v in values() if v != 0.0] == [*map(float, range(1, 300)), 301.0]
    assert len(found) < 100
    graph.spin_until(lambda: figures["lost (stamps missing)"] == "1", what="a count")


def test_cycles_of_a_plc_are_estimated_and_stored_by_a_twin(graph, plc, tmp_path):
    simulation = get_simulation("press_cartridge")
    block = SimulatedValve(simulation, 5).advance(3000)
    url = f"sqlite:///{tmp_path}/history.sqlite"
    signals = {"v_in": "command/v_in", "v_out": "command/v_out", "spool_position": "position"}
    twin = {f"signals.{name}.topic": topic for name, topic in signals.items()}
    figures = host(
        graph, plc, [f"{topic} ns=1;s=tag{tag}" for tag, topic in enumerate(signals.values())]
    )
    stored = graph.record(f"{NS}/twin/cycle", msg_cycle())
    graph.start("twin", topic_prefix="/plc", history_url=url, period_s=simulation.period_s, **twin)
    topics = [f"/plc{NS}/{topic}" for topic in signals.values()]
    mine = [p for p in graph.hosted[-1].publishers if p.topic_name in topics]
    graph.spin_until(
        lambda: len(mine) == 3 and all(p.get_subscription_count() for p in mine), what="the twin"
    )
    graph.be_heard(f"{NS}/twin")
    columns = {0: block.inputs[:, 0], 1: block.inputs[:, 1], 2: block.position}
    period_ns = round(simulation.period_s * 1e9)
    plc.begin({k: list(v) for k, v in columns.items()}, START_NS, period_ns, pace=1500.0)
    graph.spin_until(lambda: len(stored) >= 2, what="two cycles")
    plc.wait()
    assert figures["lost (queue of the server), at least"] == "0"

    def estimates() -> int:
        with History(url, read_only=True) as history:
            return len(history.estimates(NS, "output_error"))

    graph.spin_until(lambda: estimates() >= 2, what="two estimates")
    with History(url, read_only=True) as history:
        assert all(r.accepted for r in history.cycles(NS)[:2])


def msg_cycle():
    from valve_twin_msgs.msg import CycleSummary

    return CycleSummary


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"tags": ["position"]}, "is no tag"),
        ({"tags": ["position tag0"]}, "is no node id"),
        ({"tags": ["position i=1"], "address": "http://plc"}, "is none: write opc.tcp://"),
        ({"tags": ["position i=1"], "pki": "/nowhere"}, "/nowhere/certificate.der: No such file"),
    ],
)
def test_a_wrong_parameter_is_one_line(graph, capfd, more, why):
    node = graph.host(OpcuaSourceNode, **more)
    graph.spin_until(lambda: True)
    assert node.state == "unconfigured"
    assert why in capfd.readouterr().err
