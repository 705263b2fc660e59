# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a publisher does to a recorder that listens to it from another process."""

import time
from types import SimpleNamespace
from typing import Any, cast

import pytest
from rclpy.qos import QoSProfile
from valve_twin_msgs.msg import Float64Stamped
from valve_twin_msgs.srv import Stop

from test.nodes.conftest import DEEP, NS
from test.nodes.feeding import Feeder
from valve_twin.io.bags.read import read_columns
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.offline.recover import recover
from valve_twin.nodes.recorder import recorded_topic
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.recorder.recorded_topic import RecordedTopic


def feed_for(graph, feeder, seconds):
    """Send samples at a plant's pace."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        feeder.feed(1)
        graph.spin(0.02)


def recorded(bag, topic):
    """Return the stamps that a bag holds of a topic [ns]."""
    (column,) = read_columns(bag, [SignalSource("x", topic)])
    return column.stamp_ns.tolist()


@pytest.mark.slow
def test_a_message_of_0_bytes_costs_nothing(graph, tmp_path):
    recorder = graph.start("bag_recorder", bag=str(tmp_path / "bag"))
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/bag_recorder")
    feed_for(graph, feeder, 1.0)
    feeder.publishers[2].publish(b"")
    feed_for(graph, feeder, 13.0)
    graph.spin(1.0)
    recorder.end()
    whole = recorded(tmp_path / "bag", f"{NS}/command/v_in")
    assert len(whole) == feeder.sent
    assert sorted(recorded(tmp_path / "bag", f"{NS}/spool_position")) == sorted(whole)
    assert recorder.log.count("a message of 0 bytes") == 1


def test_a_recorder_that_is_killed_seconds_after_a_message_of_0_bytes_has_what_followed(
    graph, tmp_path
):
    """It hears again within a second, by a second reader, and what that hears is on the disk."""
    recorder = graph.start("bag_recorder", bag=str(tmp_path / "bag"))
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/bag_recorder")
    feed_for(graph, feeder, 1.0)
    feeder.publishers[2].publish(b"")
    before = feeder.sent
    feed_for(graph, feeder, 4.0)
    recorder.kill()
    recover(tmp_path / "bag", tmp_path / "whole")
    first_ns = recorded(tmp_path / "whole", f"{NS}/command/v_in")[before]
    behind = [s for s in recorded(tmp_path / "whole", f"{NS}/spool_position") if s >= first_ns]
    assert len(behind) > 0.3 * (feeder.sent - before)


def test_a_subscription_that_is_deaf_from_the_start_is_made_anew_and_loses_nothing(
    graph, tmp_path, capfd, monkeypatch
):
    """As after a kill, when the publisher owes the dead one first: here it listens elsewhere."""
    subscribe = RecordedTopic._subscribe
    made: list[str] = []

    def first_deaf(self):
        name, made_before = self.name, len(made)
        made.append(name)
        self.name = name if made_before else f"{name}_of_nobody"
        try:
            return subscribe(self)
        finally:
            self.name = name

    monkeypatch.setattr(RecordedTopic, "_subscribe", first_deaf)
    topic = f"{NS}/spool_position"
    publishers = [graph.node.create_publisher(Float64Stamped, topic, DEEP) for _ in range(2)]
    graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=[topic])
    graph.spin_until(lambda: publishers[0].get_subscription_count() == 1, what="a second reader")
    graph.spin_until(lambda: publishers[1].get_subscription_count() == 1, what="a second reader")
    for number in range(100):
        for k, publisher in enumerate(publishers):
            publisher.publish(encode_stamped(10**18 + (2 * number + k) * 10**6, 0.5))
        graph.spin(0.02)
    graph.spin(0.5)
    graph.call(Stop, f"{NS}/bag_recorder/stop")
    (column,) = read_columns(tmp_path / "bag", [SignalSource("x", topic)])
    assert len(made) == 2
    assert "heard nothing since it listens" in capfd.readouterr().err
    assert sorted(column.stamp_ns) == [10**18 + n * 10**6 for n in range(200)]


class Desk(SimpleNamespace):
    """A node whose subscriptions the test calls back, on a clock of its own."""

    def __init__(self, monkeypatch):
        self.now_s = 0.0
        self.made: list[Any] = []
        self.waiting: list[tuple[bytes, dict[str, int]]] = []
        self.kept: list[int] = []
        self.handle = SimpleNamespace(
            take_message=lambda *_: self.waiting.pop(0) if self.waiting else None
        )
        self.get_logger = lambda: SimpleNamespace(warning=lambda *_, **__: None)
        clock = SimpleNamespace(monotonic=lambda: self.now_s)
        monkeypatch.setattr(recorded_topic, "time", clock)
        node, kind = cast("Any", self), "valve_twin_msgs/msg/Float64Stamped"
        self.topic = RecordedTopic(node, "/valve/x", kind, self.keep)

    def get_parameter(self, name):
        return SimpleNamespace(value=False)

    def get_publishers_info_by_topic(self, name):
        kind = "valve_twin_msgs/msg/Float64Stamped"
        return [SimpleNamespace(qos_profile=QoSProfile(depth=1), topic_type=kind)]

    def count_publishers(self, name):
        return 1

    def create_subscription(self, kind, name, callback, profile, **_):
        self.made.append(callback)
        return SimpleNamespace(
            handle=self.handle,
            msg_type=kind,
            get_publisher_count=lambda: 1,
            CallbackType=SimpleNamespace(WithMessageInfo=2),
        )

    def destroy_subscription(self, subscription):
        pass

    def keep(self, message, topic):
        self.kept.append(int(message.data))

    def look(self, seconds=0.1):
        self.now_s += seconds
        self.topic.adapt()

    def hear(self, reader, *numbers):
        for number in numbers:
            self.made[reader](*sent(number))


def sent(number):
    info = {
        "publication_sequence_number": number,
        "source_timestamp": 10**18 + number,
        "received_timestamp": 10**18,
    }
    return str(number).encode(), info


@pytest.fixture
def desk(monkeypatch):
    made = Desk(monkeypatch)
    made.look()
    return made


@pytest.mark.parametrize("waiting", [[], [5], [5, 6, 7]])
def test_what_a_second_reader_kept_is_recorded_at_the_end(desk, waiting):
    """A message of 0 bytes was sent, then the recorder is stopped before the first is deaf."""
    desk.hear(0, 1, 2, 3)
    for _ in range(6):
        desk.look()
    assert len(desk.made) == 3
    desk.hear(2, 5, 6, 7)
    desk.waiting = [sent(number) for number in waiting]
    desk.topic.silence()
    assert desk.kept == [1, 2, 3, 5, 6, 7]


def test_a_reader_that_hears_everything_late_records_nothing_twice(desk):
    """At 10 kHz a second makes more than a second reader keeps."""
    desk.hear(1, *range(1, 20_001))
    desk.look()
    desk.hear(0, *range(1, 20_011))
    assert sorted(desk.kept) == list(range(1, 20_011))
    assert desk.topic.lost_transport == 0


def test_what_was_sent_before_the_second_reader_hides_no_loss(desk):
    desk.hear(1, 100, 104)
    assert desk.topic.lost_transport == 3
    desk.hear(0, 97, 98, 99)
    assert desk.topic.lost_transport == 3
    desk.hear(0, 100, 101)
    assert desk.topic.lost_transport == 2
    desk.hear(0, 104, 105)
    assert desk.topic.lost_transport == 2


def test_who_listens_again_to_a_publisher_with_an_older_clock_counts_its_losses(desk):
    desk.hear(1, 1000, 1001)
    desk.look()
    desk.topic.silence()
    desk.topic.listen()
    desk.hear(-1, 5, 9)
    assert desk.topic.lost_transport == 3
    assert desk.topic.heard
