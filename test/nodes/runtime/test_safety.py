# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated or replayed command never reaches a real valve."""

import os
import subprocess
import sys
import time
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from valve_twin_msgs import srv
from valve_twin_msgs.msg import Float64Stamped

from test.bag_samples import write_sample
from test.nodes.conftest import NS
from valve_twin.io.bags.qos import QosProfile as Offered
from valve_twin.io.bags.writer import BagWriter
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.runtime.safety import CHECK_S, SETTLE_S, is_free
from valve_twin.nodes.simulator.node import SimulatedValveNode

POSITION, COMMAND = "/spool_position", "/command/v_in"


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(300):
            write_sample(writer, f"{NS}{COMMAND}", 10**9 + i * 10**7, 0.1)
    return {"bag": str(path), "publish_prefix": ""}


def settled(graph, node, topic: str, kind: str) -> None:
    """Wait until a node knows of each stranger by its name that it has the topic."""
    publishers, takers = node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic
    ends = publishers if kind == "publisher" else takers
    wanted = {s.get_name() for s in graph.strangers} or {graph.node.get_name()}
    graph.spin_until(
        lambda: wanted <= {end.node_name for end in ends(topic)},
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
    told = ""

    def is_told():
        nonlocal told
        told += capfd.readouterr().err
        return "stopped: topic" in told

    graph.spin_until(is_told, what="the word of it")


def test_a_tick_that_was_due_at_the_stop_publishes_nothing(graph):
    """The events executor runs a timer once more that was due when it was destroyed."""
    node = graph.host(SimulatedValveNode, rate=0.0)
    graph.spin_until(lambda: node._outbox.sent, what="samples")
    sensor = graph.stranger("real_sensor")
    sensor.create_publisher(Float64Stamped, f"/sim{NS}{POSITION}", 10)
    graph.spin_until(lambda: node.state == "inactive", what="the simulation to stop")
    sent = node._outbox.sent
    node._tick()
    node._watch()
    assert (node.state, node._outbox.sent) == ("inactive", sent)


def test_nothing_leaves_before_the_graph_is_known(graph):
    """A valve that is there from the start sees no command at all."""
    taken: list[Float64Stamped] = []
    valve = graph.stranger("real_valve")
    valve.create_subscription(Float64Stamped, f"{NS}{COMMAND}", taken.append, 10)
    node = graph.host(SimulatedValveNode, publish_prefix="")
    graph.spin_until(lambda: node.state == "inactive", what="the refusal")
    sent = node._outbox.sent
    assert sent == 0


@pytest.mark.parametrize("kind", ["simulated_valve", "bag_player"])
def test_a_time_in_which_the_node_stood_still_does_not_settle_the_graph(graph, bag, kind):
    """It met nobody then, and the first command left with the next tick."""
    if kind == "simulated_valve":
        outbox = graph.host(SimulatedValveNode, publish_prefix="")._outbox
    else:
        outbox = graph.host(BagPlayerNode, start_delay_s=0.0, **bag)._player_publishers.outbox
    graph.spin(2.0 * CHECK_S)
    time.sleep(SETTLE_S)
    graph.spin(3.0 * CHECK_S)
    assert not outbox.sent
    graph.spin_until(lambda: outbox.sent, what="the first sample")


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


# -- ways round it that are none


@pytest.mark.parametrize(
    "name",
    ["/replay/a", "/sim/a", "/sim_2/a", "/replay7/a", "/line2_replay/a", "/simulation", "replay"],
)
def test_below_replay_and_sim_no_real_valve_listens(name):
    assert is_free(name)


@pytest.mark.parametrize(
    "name",
    ["", "/", "/press/a", "/press/replay/a", "/replays/a", "/Sim/a", "/simon/a", "/presim/a"],
)
def test_any_other_name_may_be_a_real_valve(name):
    assert not is_free(name)


REAL = f"{NS}{COMMAND}"
BYPASSES: dict[str, dict[str, Any]] = {
    "no prefix": {"publish_prefix": ""},
    "a slash": {"publish_prefix": "//"},
    "a prefix that completes the name": {
        "publish_prefix": "/press",
        "remap": [f"{REAL}:=/v1{COMMAND}"],
    },
    "a remapped topic": {
        "publish_prefix": "/",
        "remap": [f"/other:={REAL}"],
        "topics": ["/other"],
    },
    "a remapped node": {"extra": ("-r", f"/replay{REAL}:={REAL}")},
    "a remapped topic of another prefix": {
        "publish_prefix": "/mine",
        "extra": ("-r", f"/mine{REAL}:={REAL}"),
    },
}


@pytest.mark.parametrize("way", BYPASSES)
def test_no_name_leads_to_a_real_valve(graph, tmp_path, capfd, way):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(100):
            for topic in (REAL, "/other"):
                write_sample(writer, topic, 10**9 + i * 10**7, 0.1)
    taken: list[Float64Stamped] = []
    valve = graph.stranger("real_valve")
    valve.create_subscription(Float64Stamped, REAL, taken.append, 10)
    options = {"bag": str(path), "rate": 0.0, **BYPASSES[way]}
    node = graph.host(BagPlayerNode, start=False, **options)
    settled(graph, node, REAL, "subscriber")
    node.start()
    assert node.state == "inactive"
    assert f"topic '{REAL}' is a command that is taken by node /plant/real_valve" in (
        capfd.readouterr().err
    )
    assert graph.call(srv.Burst, f"{NS}/bag_player/burst", num_messages=3).actually_burst == 0
    assert not graph.call(srv.Play, f"{NS}/bag_player/play").success


def test_a_valve_of_the_player_s_own_name_is_still_another(graph, bag, capfd):
    node = graph.host(BagPlayerNode, start=False, **bag)
    context = Context()
    rclpy.init(args=[], context=context, domain_id=graph.domain)
    valve = Node("bag_player", context=context, namespace=NS, start_parameter_services=False)
    graph.strangers.append(valve)
    valve.create_subscription(Float64Stamped, REAL, lambda _: None, 10)

    def known() -> bool:
        takers = node.get_subscriptions_info_by_topic(REAL)
        return [t.node_name for t in takers] == ["bag_player"]

    graph.spin_until(
        lambda: known() and node.get_node_names().count("bag_player") == 2, what="the valve"
    )
    node.start()
    assert node.state == "inactive"
    assert f"is taken by node {NS}/bag_player" in capfd.readouterr().err


def test_a_valve_that_comes_while_it_plays_gets_no_command(graph, tmp_path, capfd):
    """Neither a later one nor the last, which a latched topic would hand to a latecomer."""
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        offer = (Offered(durability="transient_local"),)
        writer.add_topic("/mode", "std_msgs/msg/String", qos=offer)
        for i in range(100_000):  # 100 s: the valve may need long to be seen
            writer.write("/mode", b"\0\1\0\0\2\0\0\0a\0", log_ns=10**9 + i * 10**7)
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node = graph.host(BagPlayerNode, bag=str(path), publish_prefix="", rate=10.0)
    graph.spin_until(lambda: node._player_publishers.outbox.sent > 50, what="commands to nobody")
    taken: list[String] = []
    valve = graph.stranger("real_valve")
    for profile in (latched, 10):
        valve.create_subscription(String, "/mode", taken.append, profile)
    graph.executor.add_node(valve)
    graph.spin_until(lambda: node.state == "inactive", what="the player to stop")
    graph.spin(0.5)
    assert not taken
    assert "stopped: topic '/mode' is a command that is taken by" in capfd.readouterr().err


def test_another_publisher_that_comes_later_stops_the_player(graph, tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(300):
            write_sample(writer, REAL, 10**9 + i * 10**7, 0.1)
    node = graph.host(BagPlayerNode, bag=str(path), start_paused=True)
    assert node.state == "active"
    graph.stranger("second_player").create_publisher(Float64Stamped, f"/replay{REAL}", 10)
    graph.spin_until(lambda: node.state == "inactive", what="the player to stop")


def test_the_rule_cannot_be_lifted_while_it_plays(graph, bag):
    node = graph.host(BagPlayerNode, **{**bag, "publish_prefix": "/replay"})
    for name, value in (("allow_live", True), ("publish_prefix", "")):
        (result,) = node.set_parameters([node.get_parameter(name).__class__(name, value=value)])
        assert not result.successful
        assert "takes effect at" in result.reason
    (result,) = node.set_parameters([node.get_parameter("allow_live")])  # as `ros2 param load`
    assert result.successful, result.reason


def test_the_command_line_ends_before_a_real_valve(graph, bag):
    taken: list[Float64Stamped] = []
    graph.node.create_subscription(Float64Stamped, REAL, taken.append, 10)
    command = [sys.executable, "-m", "valve_twin.cli", "replay", bag["bag"], "--prefix", ""]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    graph.spin_until(lambda: process.poll() is not None, 120.0, "the end of the command")
    _, told = process.communicate()
    assert process.returncode == 1
    assert f"topic '{REAL}' is a command that is taken by" in told
    assert "Traceback" not in told
    assert not taken
