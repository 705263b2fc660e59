# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a publisher does to a recorder that listens to it from another process."""

import time

import pytest
from valve_twin_msgs.msg import Float64Stamped
from valve_twin_msgs.srv import Stop

from test.nodes.conftest import DEEP, NS
from test.nodes.feeding import Feeder
from valve_twin.io.bags.read import bag_info, read_columns
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.recorder.recorded_topic import RecordedTopic


@pytest.mark.slow
def test_a_message_of_0_bytes_costs_what_is_sent_in_half_a_second(graph, tmp_path):
    recorder = graph.start("bag_recorder", bag=str(tmp_path / "bag"))
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/bag_recorder")
    end = time.monotonic() + 14.0
    bad = 0
    while time.monotonic() < end:
        feeder.feed(1)
        graph.spin(0.02)
        if feeder.sent == 50:
            feeder.publishers[2].publish(b"")
            bad += 1
    graph.spin(1.0)
    recorder.end()
    counts = {t.name: t.count for t in bag_info(tmp_path / "bag").topics}
    assert bad == 1
    assert counts[f"{NS}/command/v_in"] == feeder.sent
    assert counts[f"{NS}/spool_position"] > feeder.sent - 40
    assert recorder.log.count("a message of 0 bytes") == 1


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
