# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The simulated valve as a joint: states out, commands in, below the prefix, nobody in between."""

from itertools import pairwise

import pytest
from sensor_msgs.msg import JointState
from valve_twin_msgs.msg import Faults, Float64Stamped

from test.nodes.conftest import NS
from valve_twin.io.errors import ConfigError
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.nodes.simulator.node import SimulatedValveNode

VALVE = {
    "model": "first_order",
    "period_s": 0.05,
    "signals.command.topic": "command/command",
    "signals.position.topic": "spool_position",
    "joint": "spool",
    "joint_stroke": 0.008,
    "wait_for_subscribers": 0,
    "simulation.measurement.noise": 0.0,
}
EXTERNAL = {**VALVE, "simulation.controller": "external", "rate": 20.0}
STATES, COMMANDS = f"/sim{NS}/joint_states", f"/sim{NS}/joint_commands"


def test_it_shows_its_position_as_a_joint_with_the_same_stamps(graph):
    joints = graph.record(STATES, JointState)
    positions = graph.record(f"/sim{NS}/spool_position", Float64Stamped)
    graph.host(SimulatedValveNode, **VALVE, rate=0.0, stop_after_cycles=1)
    graph.spin_until(lambda: len(joints) >= 150 and len(positions) >= 150, what="150 samples")
    told = {from_time(m.header.stamp): m.value for m in positions}
    seen = {from_time(m.header.stamp): m for m in joints}
    both = told.keys() & seen.keys()
    assert len(both) >= 140
    assert all(seen[t].position[0] == told[t] * 0.008 for t in both)
    assert {tuple(m.name) for m in joints} == {("spool",)}
    assert max(told.values()) > 0.5


def test_a_batch_is_a_message_of_the_joint_for_each_sample(graph):
    joints = graph.record(STATES, JointState)
    graph.host(SimulatedValveNode, **VALVE, rate=0.0, batch=10, stop_after_cycles=1)
    graph.spin_until(lambda: len(joints) >= 40, what="40 samples")
    stamps = [from_time(m.header.stamp) for m in joints[:40]]
    assert {b - a for a, b in pairwise(stamps)} == {50_000_000}


@pytest.mark.parametrize(("name", "position"), [("spool", 0.7 * 0.008), ("command", 0.7)])
def test_a_command_to_the_joint_moves_the_valve(graph, name, position):
    joints = graph.record(STATES, JointState)
    publisher = graph.node.create_publisher(JointState, COMMANDS, 10)
    graph.host(SimulatedValveNode, **EXTERNAL)
    graph.spin_until(lambda: len(joints) > 5, what="states")
    assert joints[-1].position[0] == 0.0

    def arrived():
        publisher.publish(JointState(name=["other", name], position=[9.0, position]))
        return joints[-1].position[0] > 0.68 * 0.008

    graph.spin_until(arrived, what="the position")
    assert joints[-1].position[0] < 0.7 * 0.008  # the dead band


def test_commands_that_are_no_positions_are_told_and_the_last_one_is_held(graph):
    joints = graph.record(STATES, JointState)
    faults = graph.record(f"{NS}/simulated_valve/faults", Faults)
    publisher = graph.node.create_publisher(JointState, COMMANDS, 10)
    graph.host(SimulatedValveNode, **EXTERNAL)
    graph.spin_until(lambda: publisher.get_subscription_count() and joints, what="the valve")

    def told(text, *wrong):
        for message in wrong:
            publisher.publish(message)
        return [f for m in faults[-1:] for f in m.faults if text in f.evidence]

    good = JointState(name=["spool"], position=[0.5 * 0.008])
    empty = JointState(name=["spool"])
    graph.spin_until(lambda: told("has no position that is a number", good, empty), what="empty")
    beyond = JointState(name=["spool"], position=[0.5])
    graph.spin_until(lambda: told("command = 62.5: must be a number", beyond), what="beyond")
    assert 0.0 <= joints[-1].position[0] <= 0.008


def test_without_an_external_controller_no_command_is_taken(graph):
    publisher = graph.node.create_publisher(JointState, COMMANDS, 10)
    node = graph.host(SimulatedValveNode, **VALVE)
    graph.spin_until(lambda: node._valves[0].publishers, what="the publishers")
    graph.spin(0.5)
    assert publisher.get_subscription_count() == 0


def test_a_foreign_publisher_of_the_joint_is_refused(graph):
    stranger = graph.stranger("robot")
    stranger.create_publisher(JointState, STATES, 10)
    graph.spin_until(lambda: graph.node.count_publishers(STATES), what="the stranger")
    node = graph.host(SimulatedValveNode, start=False, **VALVE)
    node.configure()
    graph.spin_until(lambda: node.count_publishers(STATES), what="the stranger")
    with pytest.raises(ConfigError, match="joint_states' is already published by node"):
        node.activate()


def test_without_a_joint_there_is_no_such_topic(graph):
    node = graph.host(SimulatedValveNode, **{**VALVE, "joint": ""})
    graph.spin_until(lambda: node._valves[0].publishers, what="the publishers")
    assert not graph.node.count_publishers(STATES)
