# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated or replayed command never reaches a real valve."""

import pytest
from valve_twin_msgs.msg import Float64Stamped

from test.nodes.conftest import NS
from valve_twin.io.bag_writer import BagWriter
from valve_twin.nodes.bag_player import BagPlayerNode
from valve_twin.nodes.simulated_valve import SimulatedValveNode

POSITION, COMMAND = "/spool_position", "/command/v_in"


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(300):
            writer.write_sample(f"{NS}{COMMAND}", 10**9 + i * 10**7, 0.1)
    return {"bag": str(path), "publish_prefix": ""}


def settled(graph, node, topic: str, kind: str) -> None:
    count = node.count_publishers if kind == "publisher" else node.count_subscribers
    strangers = {s.get_name() for s in graph.strangers}
    graph.spin_until(
        lambda: count(topic) and strangers <= set(node.get_node_names()),
        what=f"{kind} of {topic} in sight",
    )


def test_everything_is_published_under_the_prefix_by_default(graph):
    graph.host(SimulatedValveNode)
    found = graph.record(f"/sim{NS}{COMMAND}", Float64Stamped)
    graph.spin_until(lambda: found, what="a simulated command")
    names = [name for name, _ in graph.node.get_topic_names_and_types()]
    assert f"{NS}{COMMAND}" not in names


@pytest.mark.parametrize("kind", ["simulated_valve", "bag_player"])
def test_a_command_that_somebody_takes_is_refused(graph, capfd, bag, kind):
    taken: list[Float64Stamped] = []
    valve = graph.stranger("real_valve")
    valve.create_subscription(Float64Stamped, f"{NS}{COMMAND}", taken.append, 10)
    node = (
        graph.host(SimulatedValveNode, start=False, publish_prefix="")
        if kind == "simulated_valve"
        else graph.host(BagPlayerNode, start=False, **bag)
    )
    settled(graph, node, f"{NS}{COMMAND}", "subscriber")
    node.start()
    said = capfd.readouterr().err
    assert node.state == "inactive"
    assert f"topic '{NS}{COMMAND}' is a command that is taken by node /plant/real_valve" in said
    assert "set publish_prefix" in said


def test_a_topic_that_somebody_publishes_is_refused_also_under_a_prefix(graph, capfd):
    sensor = graph.stranger("real_sensor")
    sensor.create_publisher(Float64Stamped, f"/sim{NS}{POSITION}", 10)
    node = graph.host(SimulatedValveNode, start=False)
    settled(graph, node, f"/sim{NS}{POSITION}", "publisher")
    node.start()
    said = capfd.readouterr().err
    assert node.state == "inactive"
    assert f"topic '/sim{NS}{POSITION}' is already published by node /plant/real_sensor" in said


def test_a_valve_that_comes_later_stops_the_simulation(graph, capfd):
    node = graph.host(SimulatedValveNode, publish_prefix="")
    assert node.state == "active"
    graph.stranger("real_valve").create_subscription(
        Float64Stamped, f"{NS}{COMMAND}", lambda _: None, 10
    )
    graph.spin_until(lambda: node.state == "inactive", what="the simulation to stop")
    assert "stopped: topic" in capfd.readouterr().err


def test_nothing_leaves_before_the_graph_is_known(graph):
    """A valve that is there from the start sees no command at all."""
    taken: list[Float64Stamped] = []
    valve = graph.stranger("real_valve")
    valve.create_subscription(Float64Stamped, f"{NS}{COMMAND}", taken.append, 10)
    node = graph.host(SimulatedValveNode, publish_prefix="")
    graph.spin_until(lambda: node.state == "inactive", what="the refusal")
    sent = node._outbox.sent
    assert sent == 0


def test_a_user_may_allow_it(graph):
    taken: list[Float64Stamped] = []
    graph.node.create_subscription(Float64Stamped, f"{NS}{COMMAND}", taken.append, 10)
    node = graph.host(SimulatedValveNode, start=False, publish_prefix="", allow_live=True)
    settled(graph, node, f"{NS}{COMMAND}", "subscriber")
    node.start()
    graph.spin_until(lambda: taken, what="a command")


def test_a_reader_of_simulated_commands_is_no_obstacle(graph):
    found = graph.record(f"/sim{NS}{COMMAND}", Float64Stamped)
    node = graph.host(SimulatedValveNode, start=False)
    settled(graph, node, f"/sim{NS}{COMMAND}", "subscriber")
    node.start()
    graph.spin_until(lambda: found, what="a simulated command")
