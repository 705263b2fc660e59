# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a player begins: subscribers are counted by node."""

from __future__ import annotations

from types import SimpleNamespace

from rclpy.qos import qos_profile_sensor_data
from valve_twin_msgs.msg import Float64Stamped

from valve_twin.nodes.player.outbox import MATCHED_S, UNMATCHED_S, SubscriberGate

TOPIC = "/position"


def test_two_readers_of_one_node_are_one_subscriber(graph):
    """A recorder's second reader does not stand for the twin that is still to come."""
    player, recorder, twin = (graph.stranger(n) for n in ("player", "bag_recorder", "twin"))
    publisher = player.create_publisher(Float64Stamped, TOPIC, 10)
    for _ in range(2):
        recorder.create_subscription(Float64Stamped, TOPIC, print, 10)
    gate = SubscriberGate(player)
    graph.spin_until(lambda: publisher.get_subscription_count() == 2, what="the recorder")
    assert not gate.is_open([publisher], 1, 0.0)
    assert gate.is_open([publisher], 1, UNMATCHED_S)
    assert not gate.is_open([publisher], 2, 0.0)
    assert not gate.is_open([publisher], 2, 10 * UNMATCHED_S)

    twin.create_subscription(Float64Stamped, TOPIC, print, 10)
    graph.spin_until(
        lambda: publisher.get_subscription_count() == player.count_subscribers(TOPIC) == 3,
        what="the twin",
    )
    assert not gate.is_open([publisher], 2, 100.0)
    assert gate.is_open([publisher], 2, 100.0 + MATCHED_S)


def test_a_reader_whose_node_is_not_known_yet_is_no_further_subscriber():
    def reader(name: str, participant: int):
        gid = [participant] * 12 + [7, 7, 7, 7]
        return SimpleNamespace(node_name=name, node_namespace="/press", endpoint_gid=gid)

    known = [reader("bag_recorder", 1), reader("_NODE_NAME_UNKNOWN_", 1)]
    player = SimpleNamespace(get_subscriptions_info_by_topic=lambda topic: known)
    publisher = SimpleNamespace(get_subscription_count=lambda: len(known), topic_name=TOPIC)

    def opens(wanted: int) -> bool:
        gate = SubscriberGate(player)  # type: ignore[arg-type]
        return gate.is_open([publisher], wanted, 0.0) or gate.is_open([publisher], wanted, 100.0)

    assert opens(1)
    assert not opens(2)
    known.append(reader("_NODE_NAME_UNKNOWN_", 2))  # of a program without nodes, too
    assert opens(2)
    known[1:] = [reader("twin", 1)]  # two nodes of one process
    assert opens(2)
    assert not opens(3)


def test_a_reader_of_other_policies_delays_the_beginning_but_does_not_prevent_it(graph):
    player, twin = graph.stranger("player"), graph.stranger("twin")
    publisher = player.create_publisher(Float64Stamped, TOPIC, qos_profile_sensor_data)
    twin.create_subscription(Float64Stamped, TOPIC, print, qos_profile_sensor_data)
    twin.create_subscription(Float64Stamped, TOPIC, print, 10)  # reliable: never met
    graph.spin_until(
        lambda: publisher.get_subscription_count() == 1 and player.count_subscribers(TOPIC) == 2,
        what="both readers",
    )
    gate = SubscriberGate(player)
    assert not gate.is_open([publisher], 1, 0.0)
    assert not gate.is_open([publisher], 1, 2 * MATCHED_S)
    assert gate.is_open([publisher], 1, UNMATCHED_S)
