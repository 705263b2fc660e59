# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An acknowledgement is waited for, but not for ever."""

import signal

import pytest
from rclpy.qos import ReliabilityPolicy

from test.nodes.conftest import NS
from test.nodes.player.test_flow_control import TOPICS, write_bag
from valve_twin.nodes.player import acknowledgements
from valve_twin.nodes.player.acknowledgements import Acknowledgements
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.player.outbox import Outbox
from valve_twin.nodes.player.playback import Phase


class Publisher:
    """A publisher whose subscribers acknowledge when the test says so."""

    def __init__(self, topic_name: str) -> None:
        self.topic_name = topic_name
        self.acked = False
        self.published: list[int] = []

    def wait_for_all_acked(self, timeout) -> bool:
        assert timeout.nanoseconds == 0
        return self.acked

    def publish(self, message) -> None:
        self.published.append(message)


@pytest.fixture
def clock():
    return [0.0]


@pytest.fixture
def acks(graph, clock):
    return Acknowledgements(graph.node, lambda: clock[0])


def test_a_publisher_is_waited_for_as_long_as_patience_lasts(acks, clock, capfd):
    owed = Publisher("/owed")
    for clock[0] in (0.0, 15.0, 30.0):
        assert not acks.is_complete(owed)
    assert not capfd.readouterr().err
    clock[0] = 30.1
    assert acks.is_complete(owed)
    clock[0] = 90.0
    assert acks.is_complete(owed)
    said = capfd.readouterr().err
    assert (
        said.count("topic '/owed': a subscriber has not acknowledged its messages for 30 s") == 1
    )


def test_patience_begins_anew_after_every_acknowledgement(acks, clock):
    slow = Publisher("/slow")
    for clock[0] in (0.0, 40.0, 80.0):
        slow.acked = False
        assert not acks.is_complete(slow)
        slow.acked = True
        assert acks.is_complete(slow)


def test_who_has_caught_up_is_waited_for_again(acks, clock):
    late = Publisher("/late")
    assert not acks.is_complete(late)
    clock[0] = 31.0
    assert acks.is_complete(late)
    late.acked = True
    assert acks.is_complete(late)
    late.acked = False
    assert not acks.is_complete(late)


def test_the_patience_with_several_publishers_runs_at_the_same_time(acks, clock):
    several = [Publisher("/a"), Publisher("/b")]
    assert not acks.are_complete(several)
    clock[0] = 30.1
    assert acks.are_complete(several)


def test_no_more_leaves_unacknowledged_than_the_publisher_keeps():
    publisher = Publisher("/kept")
    outbox = Outbox(lambda p: p.acked)
    outbox.keep(publisher, 4)
    for i in range(10):
        outbox.put(publisher, i)
    assert not outbox.send()
    assert publisher.published == [0, 1, 2, 3]
    publisher.acked = True
    assert outbox.send()
    assert publisher.published == list(range(10))


def test_a_depth_of_the_middleware_s_own_stops_nothing():
    publisher = Publisher("/kept")
    publisher.acked = True
    outbox = Outbox(lambda p: p.acked)
    outbox.keep(publisher, 0)
    for i in range(3):
        outbox.put(publisher, i)
    assert outbox.send()
    assert publisher.published == [0, 1, 2]


def test_a_node_that_stands_still_is_named_and_left_behind(graph, tmp_path, monkeypatch, capfd):
    """More messages than the publishers keep for it."""
    monkeypatch.setattr(acknowledgements, "PATIENCE_S", 1.0)
    monkeypatch.setattr("valve_twin.nodes.player.flow_control.PATIENCE_S", 1.0)
    monkeypatch.setattr("valve_twin.nodes.player.settings.DEPTH", 100)
    names = [f"/replay{topic}" for topic in TOPICS]
    stopped = graph.start("bag_recorder", topics=names, bag=str(tmp_path / "recorded"))
    bag = write_bag(tmp_path / "bag", 300)
    player = graph.host(
        BagPlayerNode, bag=bag, rate=0.0, window=100, wait_for_subscribers=1, start_paused=True
    )
    publishers = player._player_publishers

    def is_reliable(topic: str) -> bool:
        ends = player.get_subscriptions_info_by_topic(topic)
        return any(end.qos_profile.reliability == ReliabilityPolicy.RELIABLE for end in ends)

    graph.spin_until(lambda: publishers.has_subscribers(1), 120.0, "the recorder")
    graph.spin_until(  # it may listen with a second reader, which acknowledges nothing
        lambda: publishers.has_matched_all() and all(map(is_reliable, names)), what="its match"
    )
    stopped.process.send_signal(signal.SIGSTOP)
    try:
        player.playback.resume()
        graph.spin_until(lambda: player.playback.phase is Phase.ENDED, what="the end of the bag")
    finally:
        stopped.process.send_signal(signal.SIGCONT)
    said = capfd.readouterr().err
    for name in names:
        assert said.count(f"topic '{name}': a subscriber has not acknowledged") == 1
    assert f"one of {NS}/bag_recorder: it is not waited for" in said
