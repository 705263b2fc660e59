# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""At rate 0 the subscribers set the pace: nothing is lost, however slow they are."""

import signal

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.qos import QoSProfile as RosProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from valve_twin_msgs.msg import Float64Stamped

from test.bag_samples import write_sample
from test.nodes.conftest import NS
from test.nodes.feeding import REARM, START_NS
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.writer import BagWriter
from valve_twin.nodes.player import flow_control
from valve_twin.nodes.player.node import BagPlayerNode

TOPICS = [f"{NS}/{t}" for t in ("command/v_in", "command/v_out", "spool_position")]
PERIOD_NS = 30_000_000


def write_bag(path, samples: int) -> str:
    with BagWriter(path) as writer:
        for i in range(samples):
            for topic in TOPICS:
                write_sample(writer, topic, START_NS + i * PERIOD_NS, float(i % 7))
    return str(path)


def figures(statuses) -> dict[str, tuple[int, ...]]:
    """Return received, lost and unreadable of every topic as the twin told them last."""
    found: dict[str, tuple[int, ...]] = {}
    for array in statuses:
        for status in array.status:
            for value in status.values:
                if value.key.endswith("received/lost/unreadable"):
                    found[value.key.split()[0]] = tuple(map(int, value.value.split("/")))
    return found


def start(graph, bag: str, **options):
    """Start a player and a twin with a short queue; return them and what the twin will tell."""
    statuses = graph.record("/diagnostics", DiagnosticArray)
    valve = {"model": "press_cartridge", "period_s": 0.03, **REARM}
    url = f"sqlite:///{graph.folder / 'history.sqlite'}"
    twin = graph.start("twin", input_queue=3000, topic_prefix="/replay", history_url=url, **valve)
    player = graph.start(
        "bag_player",
        **{"bag": bag, "rate": 0.0, "wait_for_subscribers": 1, "exit_at_end": True, **options},
    )
    return twin, player, statuses


def counted(
    graph, player, statuses, samples: int, limit_s: float = 120.0
) -> list[tuple[int, ...]]:
    """Wait for the end of the bag; return what the twin counted of each topic."""
    graph.spin_until(lambda: player.process.poll() is not None, limit_s, "the end of the bag")
    assert player.process.returncode == 0, player.log
    told = len(statuses)
    graph.spin_until(lambda: len(statuses) > told + 2, what="the diagnostics after the end")

    def all_counted() -> dict[str, tuple[int, ...]]:
        found = figures(statuses[-1:])
        return found if found and all(sum(f) >= samples for f in found.values()) else {}

    found = graph.spin_until(all_counted, what=f"{samples} samples of each in the diagnostics")
    assert [name.removeprefix("/replay") for name in sorted(found)] == sorted(TOPICS)
    return list(found.values())


def test_a_twin_with_a_short_queue_loses_nothing(graph, tmp_path):
    """More than six times what its queue holds, faster than it can follow."""
    samples = 20_000
    _, player, statuses = start(graph, write_bag(tmp_path / "bag", samples), window=2500)
    assert counted(graph, player, statuses, samples) == [(samples, 0, 0)] * 3


@pytest.mark.slow
def test_three_hundred_thousand_messages_reach_the_twin(graph, tmp_path):
    samples = 100_000
    _, player, statuses = start(graph, write_bag(tmp_path / "bag", samples), window=2500)
    assert counted(graph, player, statuses, samples, 300.0) == [(samples, 0, 0)] * 3


def test_a_twin_that_stands_still_for_a_while_misses_nothing(graph, tmp_path):
    """Its process is stopped as soon as it has data: the player waits for it, then goes on."""
    samples = 5000
    heard = [graph.record(f"/replay{topic}", Float64Stamped) for topic in TOPICS]
    twin, player, statuses = start(
        graph, write_bag(tmp_path / "bag", samples), window=1000, wait_for_subscribers=2
    )
    graph.spin_until(lambda: heard[0], what="the first message")
    twin.process.send_signal(signal.SIGSTOP)
    try:
        graph.spin(2.0)
        assert player.process.poll() is None
        assert len(heard[0]) < samples
    finally:
        twin.process.send_signal(signal.SIGCONT)
    assert counted(graph, player, statuses, samples) == [(samples, 0, 0)] * 3
    graph.spin_until(lambda: [len(h) for h in heard] == [samples] * 3, what="all, here too")


def test_a_state_of_depth_one_is_not_overwritten(graph, tmp_path):
    """Every change of a latched topic arrives, though its publisher keeps only the last."""
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        offer = QosProfile(durability="transient_local", depth=1)
        writer.add_topic("/state", "std_msgs/msg/String", qos=(offer,))
        for i in range(200):
            data = serialize_message(String(data=str(i)))
            writer.write("/state", data, log_ns=START_NS + i)
    latched = RosProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    found = graph.record("/replay/state", String, latched)
    graph.start("bag_player", bag=str(path), rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: len(found) >= 200, what="200 states")
    assert [m.data for m in found] == [str(i) for i in range(200)]


def test_a_node_that_never_answers_is_named_and_left_behind(graph, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(flow_control, "PATIENCE_S", 1.0)
    context = Context()
    rclpy.init(args=[], context=context, domain_id=graph.domain)
    stuck = Node("stuck", context=context, namespace="/plant")  # nobody runs its callbacks
    graph.strangers.append(stuck)
    for topic in TOPICS:
        stuck.create_subscription(Float64Stamped, f"/replay{topic}", lambda _: None, 10)
    bag = write_bag(tmp_path / "bag", 30)
    player = graph.host(BagPlayerNode, bag=bag, rate=0.0, window=10, wait_for_subscribers=1)
    sent = player._player_publishers.outbox
    graph.spin_until(lambda: sent.sent >= 20, what="the first window")
    assert sent.sent == 20  # with /clock
    graph.spin_until(lambda: sent.sent == 180, what="the rest")
    said = capfd.readouterr().err
    assert said.count("node /plant/stuck has not answered for 1 s") == 1
