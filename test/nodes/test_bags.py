# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recording and playing: what was on the network comes back, in its order, at any rate."""

import os
import signal
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from valve_twin_msgs.msg import Float64Stamped, RecorderStatus, Verdict
from valve_twin_msgs.srv import GetRate, IsPaused, Pause, Resume, SetRate, TogglePaused

from test.bag_samples import write_sample
from test.nodes.conftest import NS
from test.nodes.feeding import START_NS, Feeder
from valve_twin.io.bags.read import bag_info
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.playback.player import bag_topics, read_messages
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.nodes.twin.inputs import InputConfig, TopicInput, by_topic

TOPICS = [f"{NS}/{t}" for t in ("command/v_in", "command/v_out", "spool_position")]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PERIOD_NS = 10_000_000


@pytest.fixture
def bag(tmp_path):
    """Three topics of 100 samples each; the values count the messages."""
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(100):
            for k, topic in enumerate(TOPICS):
                write_sample(writer, topic, START_NS + i * PERIOD_NS + k, float(3 * i + k))
    return str(path)


def listen(graph, prefix="/replay"):
    """Return what comes on all topics, in the order of its arrival."""
    found: list[Any] = []
    for topic in TOPICS:
        graph.node.create_subscription(Float64Stamped, f"{prefix}{topic}", found.append, 1000)
    return found


def test_what_is_recorded_is_what_was_published(graph, tmp_path):
    path = tmp_path / "recorded"
    recorder = graph.host(BagRecorderNode, bag=str(path))
    status = graph.record(f"{NS}/bag_recorder/status", RecorderStatus)
    feeder = Feeder(graph, NS)
    feeder.feed(50)
    graph.spin_until(
        lambda: status and sum(status[-1].messages) >= 150, what="150 recorded messages"
    )
    assert sum(status[-1].lost_transport) + sum(status[-1].lost_recorder) == 0
    recorder.trigger_deactivate()
    recorder.trigger_cleanup()
    counts = {t.name: t.count for t in bag_info(path).topics}
    assert [counts[t] for t in TOPICS] == [50, 50, 50]
    stamps = [m.data[4:12] for m in read_messages(path, [TOPICS[2]])]
    sent = [START_NS + i * feeder.period_ns for i in range(50)]
    wanted = [Float64Stamped() for _ in sent]
    for message, stamp in zip(wanted, sent, strict=True):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    assert stamps == [serialize_message(m)[4:12] for m in wanted]


def test_a_latched_message_is_recorded_and_its_quality_kept(graph, tmp_path):
    publisher = graph.node.create_publisher(Verdict, f"{NS}/aging_monitor/verdict", LATCHED)
    publisher.publish(Verdict(text="ok"))
    path = tmp_path / "recorded"
    recorder = graph.host(BagRecorderNode, bag=str(path))
    graph.spin_until(
        lambda: recorder._recording.counts.get(publisher.topic_name), what="the verdict"
    )
    recorder.trigger_shutdown()
    offered = {t.name: t.qos for t in bag_topics(path)}
    assert offered[publisher.topic_name].durability == "transient_local"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_leaves_a_finished_bag(graph, tmp_path, number):
    path = tmp_path / "recorded"
    process = graph.start("bag_recorder", bag=str(path))
    feeder = Feeder(graph, NS)
    feeder.feed(200)
    feeder.wait_until_received()
    assert process.end(number) == 0
    assert (path / "metadata.yaml").is_file()
    counts = {t.name: t.count for t in bag_info(path).topics}
    assert [counts[t] for t in TOPICS] == [200, 200, 200]


def test_an_existing_bag_is_not_overwritten(graph, tmp_path, capfd):
    path = tmp_path / "recorded"
    path.mkdir()
    graph.host(BagRecorderNode, bag=str(path))
    assert f"{path} exists already: recording to {path}_002" in capfd.readouterr().err
    assert not list(path.iterdir())


def test_a_bag_comes_back_in_its_order_as_fast_as_possible(graph, bag):
    found = listen(graph)
    graph.host(BagPlayerNode, bag=bag, rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: len(found) == 300, what="300 messages")
    by_stamp = sorted(found, key=lambda m: from_time(m.header.stamp))
    assert [m.value for m in by_stamp] == [float(i) for i in range(300)]


def test_the_clock_goes_before_every_message(graph, bag):
    clock = graph.record("/clock", Clock)
    found = listen(graph)
    graph.host(BagPlayerNode, bag=bag, wait_for_subscribers=1)
    graph.spin_until(lambda: len(found) == 300, what="300 messages")
    last = from_time(found[-1].header.stamp)
    graph.spin_until(lambda: clock and from_time(clock[-1].clock) == last, what="the last clock")
    times = [from_time(c.clock) for c in clock]
    assert times == sorted(times)
    assert len(times) == 300


@pytest.mark.alone
def test_the_rate_is_kept(graph, tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for i in range(1000):
            write_sample(writer, TOPICS[0], START_NS + i * PERIOD_NS, float(i))
    found: list[Any] = []

    def take(message, info) -> None:
        found.append((from_time(message.header.stamp), info["source_timestamp"]))

    graph.node.create_subscription(Float64Stamped, f"/replay{TOPICS[0]}", take, 1000)
    graph.host(BagPlayerNode, bag=str(tmp_path / "bag"), rate=2.0, wait_for_subscribers=1)
    graph.spin_until(lambda: len(found) == 1000, what="1000 messages")
    data, wall = np.diff(np.array(found)[::111], axis=0).T  # nine stretches of 0.56 s
    assert np.median(data / wall) == pytest.approx(2.0, rel=0.1)


def test_playing_pauses_and_goes_on(graph, bag):
    found = listen(graph)
    given = {"start_paused": True, "wait_for_subscribers": 1}
    player = graph.host(BagPlayerNode, bag=bag, rate=0.05, **given)  # 20 s
    base = f"{NS}/bag_player"
    assert graph.call(IsPaused, f"{base}/is_paused").paused
    graph.spin(0.3)
    assert not found
    graph.call(Resume, f"{base}/resume")
    graph.spin_until(lambda: len(found) > 10, what="messages")
    graph.call(Pause, f"{base}/pause")
    played = player.playback.played
    graph.spin_until(lambda: len(found) == played, what="what was played")
    graph.spin(0.3)
    assert len(found) == player.playback.played == played < 300
    assert graph.call(SetRate, f"{base}/set_rate", rate=50.0).success
    assert graph.call(GetRate, f"{base}/get_rate").rate == 50.0
    assert not graph.call(SetRate, f"{base}/set_rate", rate=-1.0).success
    graph.call(TogglePaused, f"{base}/toggle_paused")
    graph.spin_until(lambda: len(found) == 300, what="the rest")


def test_a_slow_subscriber_sets_the_pace_and_loses_nothing(graph, tmp_path):
    """More messages than any queue of the middleware holds, to a reader that stops for a while."""
    path = tmp_path / "long"
    with BagWriter(path) as writer:
        for i in range(15000):
            write_sample(writer, TOPICS[0], START_NS + i * PERIOD_NS, float(i))
    values: list[Any] = []
    source = SignalSource("v_in", f"/replay{TOPICS[0]}")
    reader = TopicInput(
        graph.node,
        by_topic(graph.node, [source])[0],
        InputConfig(depth=0),
        lambda _: None,
        lambda block, _: values.extend(float(v) for v in block.values),
        lambda: 1,
    )

    def taken(count: int) -> bool:
        reader.drain()
        return len(values) >= count

    graph.start("bag_player", bag=str(path), rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: taken(1), 120.0, "the first message")
    signal.pthread_sigmask(signal.SIG_BLOCK, [])  # no callbacks run until the next spin
    end = graph.node.get_clock().now().nanoseconds + 10**9
    while graph.node.get_clock().now().nanoseconds < end:
        pass
    graph.spin_until(lambda: taken(15000), 120.0, "all messages")
    assert values == [float(i) for i in range(15000)]
    assert reader.lost == 0


def test_the_command_replays_and_ends(graph, bag):
    found = listen(graph, prefix="/replay_again")
    call = "import sys; from valve_twin.cli import main; sys.exit(main())"
    command = [
        sys.executable,
        "-c",
        call,
        "replay",
        bag,
        "--rate",
        "0",
        "--prefix",
        "/replay_again",
        "--wait-for-subscribers",
        "1",
    ]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
    process = subprocess.Popen(command, env=environment)
    graph.spin_until(lambda: process.poll() is not None, 120.0, "the end of the command")
    assert process.returncode == 0
    graph.spin_until(lambda: len(found) == 300, 120.0, "300 messages")
