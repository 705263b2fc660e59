# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What comes in, in whatever shape, and what is said about what does not."""

import math
import os
import signal
import subprocess
import sys
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from valve_twin_msgs.msg import Float64Series, Float64Stamped, Prediction, PredictionSeries

from test.nodes.conftest import NS, CoreWait, ready_s
from test.nodes.feeding import START_NS, Feeder
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.nodes.runtime.stamps import from_time, to_time
from valve_twin.nodes.twin.inputs import DEAF_FROM_START, MOST_BYTES, OVERRUN_S
from valve_twin.nodes.twin.node import TwinNode

PERIOD_S = 0.02
RECOVERY_S = 1.0
HEARD_S = 5.0
S = 10**9


@pytest.fixture
def history(tmp_path):
    return {"history_url": f"sqlite:///{tmp_path}/history.sqlite"}


def newest(diagnostics):
    return diagnostics[-1].status[0] if diagnostics else None


def test_every_sample_is_predicted_with_its_own_stamp(graph, history):
    graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder = Feeder(graph, NS)
    feeder.feed(50)
    graph.spin_until(lambda: len(found) == 50, what="50 predictions")
    stamps = [p.header.stamp.sec * 10**9 + p.header.stamp.nanosec for p in found]
    assert stamps == [START_NS + i * feeder.period_ns for i in range(50)]
    assert found[0].validity == Prediction.NO_MODEL


def test_a_best_effort_publisher_is_taken_as_it_is(graph, history):
    graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder = Feeder(
        graph, NS, qos=QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    feeder.feed(20)
    graph.spin_until(lambda: len(found) >= 19, what="predictions")


def test_values_that_are_no_number_are_marked_and_the_next_ones_used(graph, history):
    graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder = Feeder(graph, NS)
    feeder.feed(5)
    feeder.feed(5, position=math.nan)
    feeder.feed(5, position=math.inf)
    feeder.feed(5)
    graph.spin_until(lambda: len(found) == 20, what="20 predictions")
    measured = [math.isfinite(p.measured) for p in found]
    assert measured == [True] * 5 + [False] * 10 + [True] * 5


def test_a_missing_topic_is_named_with_the_remedy(graph, history, capfd):
    graph.host(TwinNode, silence_s=0.5, **history)
    graph.node.create_publisher(Float64Series, f"{NS}/spool_positions", 10)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    graph.spin_until(lambda: newest(diagnostics))
    status = newest(diagnostics)
    assert status.level == DiagnosticStatus.WARN
    assert status.hardware_id == NS
    assert (
        f"topic '{NS}/spool_position' (signal spool_position) has no publisher" in status.message
    )
    assert "start it or correct signals.spool_position.topic" in status.message
    assert "has no publisher" in capfd.readouterr().err


def test_a_channel_made_from_others_is_told_to_be_taken_as_it_is(graph, history, capfd):
    graph.host(TwinNode, **history, **{"signals.v_in.column": "p_a - p_b"})
    said = capfd.readouterr().err
    (line,) = [x for x in said.splitlines() if "p_a - p_b" in x]
    assert "signals.v_in.column 'p_a - p_b' is made by `valve-twin import` and not by" in line
    assert f"'{NS}/command/v_in' as it is: publish 'p_a - p_b' there" in line


def test_a_topic_of_another_type_is_named_with_the_remedy(graph, history):
    graph.host(TwinNode, **history)
    graph.stranger("plc").create_publisher(Float64, f"{NS}/command/v_in", 10)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    wanted = (
        f"topic '{NS}/command/v_in' (signal v_in) carries std_msgs/msg/Float64, not "
        "valve_twin_msgs/msg/Float64Stamped: set signals.v_in.type to std_msgs/msg/Float64"
    )
    graph.spin_until(lambda: diagnostics and wanted in newest(diagnostics).message, what=wanted)


def test_a_publisher_of_an_incompatible_quality_is_named(graph, history):
    graph.host(TwinNode, deadline_s=0.1, **history)
    graph.stranger("plc").create_publisher(Float64Stamped, f"{NS}/command/v_in", 10)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    wanted = "its publisher /plant/plc offers an incompatible DEADLINE: change that policy there"
    graph.spin_until(lambda: diagnostics and wanted in newest(diagnostics).message, what=wanted)


def test_no_reader_has_an_event_that_may_be_queued_when_it_is_made_anew(graph, history):
    """Under the events executor it would end the process: docs/developers/upstream.md."""
    node = graph.host(TwinNode, **history)
    topic = node._valves[0].inputs.topics[0]
    beside = topic._listen_beside(print)
    assert not topic._subscription.event_handlers
    assert not beside.event_handlers
    node.destroy_subscription(beside)


def test_another_publisher_counts_for_itself(graph, history):
    """What the first had sent is no loss of the second, and the other way round."""
    node = graph.host(TwinNode, **history)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    for count in (8, 3):
        publisher = graph.node.create_publisher(Float64Stamped, topic.topic, 10)
        graph.spin_until(lambda p=publisher: p.get_subscription_count() == 1, what="its reader")
        before = topic.received
        for i in range(count):
            publisher.publish(Float64Stamped(value=0.1 * i))
            graph.spin(0.05)
        graph.spin_until(lambda b=before, n=count: topic.received == b + n, what="its messages")
        graph.node.destroy_publisher(publisher)
        graph.spin_until(lambda: topic._subscription.get_publisher_count() == 0, what="its end")
    assert topic.lost == 0


def test_a_publisher_that_leaves_is_no_loss_of_the_one_that_stays(graph, history):
    node = graph.host(TwinNode, **history)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    stays = graph.node.create_publisher(Float64Stamped, topic.topic, 1000)
    graph.spin_until(lambda: stays.get_subscription_count() == 1, what="its reader")
    for i in range(50):
        stays.publish(Float64Stamped(value=0.1 * i))
    graph.spin_until(lambda: topic.received == 50, what="its messages")
    leaves = graph.node.create_publisher(Float64Stamped, topic.topic, 10)

    def both():
        return topic._matched == 2 and leaves.get_subscription_count() == 1

    graph.spin_until(both, what="both")
    leaves.publish(Float64Stamped(value=0.1))
    graph.spin_until(lambda: topic.received == 51, what="the message of the other")
    graph.node.destroy_publisher(leaves)
    graph.spin_until(lambda: topic._matched == 1, what="one")
    for i in range(5):
        stays.publish(Float64Stamped(value=0.1 * i))
    graph.spin_until(lambda: topic.received == 56, what="the rest")
    assert topic.lost == 0


def test_what_is_offered_of_another_type_makes_no_reader_best_effort(graph, history, capfd):
    node = graph.host(TwinNode, **history)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    graph.node.create_publisher(Float64Stamped, topic.topic, 10)
    graph.spin_until(lambda: topic._matched == 1, what="its publisher")
    qos = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    graph.stranger("plc").create_publisher(Float64, topic.topic, qos)
    graph.spin_until(lambda: graph.node.count_publishers(topic.topic) == 2, what="the other")
    graph.spin(2.5)  # it is looked for every second
    assert topic._reliable
    assert "taken so" not in capfd.readouterr().err


def test_what_a_refused_publisher_sends_is_not_taken_past_the_refusal(graph, history, monkeypatch):
    """It offers no deadline: a second reader, put there after a second, would hear it.

    What it offers is asked for every second then, not at each of the 25 looks.
    """
    node = graph.host(TwinNode, deadline_s=0.5, **history)
    publisher = graph.node.create_publisher(Float64Stamped, f"{NS}/spool_position", 10)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    graph.spin_until(lambda: topic.refused_policy, what="the refusal")
    looks: list[str] = []
    began = time.monotonic()
    ask = node.count_publishers

    def count(name: str) -> int:
        looks.append(name)
        return int(ask(name))

    monkeypatch.setattr(node, "count_publishers", count)
    for _ in range(25):
        publisher.publish(Float64Stamped(value=0.1))
        graph.spin(0.1)
    assert (topic.received, topic.deaf) == (0, 0)
    assert topic.problem()[0] == "input.qos"
    elapsed = time.monotonic() - began
    assert looks.count(topic.topic) < 5 + 2 * elapsed


def test_an_input_that_falls_silent_is_stale(graph, history):
    graph.host(TwinNode, silence_s=1.0, **history)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    Feeder(graph, NS).feed(5)
    graph.spin_until(
        lambda: diagnostics and newest(diagnostics).level == DiagnosticStatus.STALE, what="stale"
    )
    assert "is silent for" in newest(diagnostics).message


def test_a_publisher_that_comes_late_was_not_silent_before(graph, history):
    node = graph.host(TwinNode, silence_s=60.0, **history)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    topics = node._valves[0].inputs.topics
    for topic in topics:
        topic._since -= 300.0  # since five minutes
    graph.spin_until(lambda: diagnostics, what="diagnostics")
    assert "has no publisher" in newest(diagnostics).message
    Feeder(graph, NS)
    graph.spin_until(
        lambda: all(node.count_publishers(t.topic) for t in topics), what="the publishers"
    )
    assert [t.problem() for t in topics] == [("", "")] * len(topics)


def test_signals_of_one_foreign_message_without_stamps_share_its_receive_time(graph, history):
    joint = {"topic": "/plc/joints", "type": "sensor_msgs/msg/JointState"}
    mapping = {
        f"signals.{signal}.{key}": value
        for signal, field in (
            ("v_in", "effort[0]"),
            ("v_out", "effort[1]"),
            ("spool_position", "position[0]"),
        )
        for key, value in {**joint, "field": field, "scale": 0.001}.items()
    }
    graph.host(TwinNode, **history, **mapping)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    publisher = graph.node.create_publisher(JointState, "/plc/joints", 10)
    graph.spin_until(publisher.get_subscription_count)
    publisher.publish(JointState(position=[500.0], effort=[100.0, 0.0]))
    graph.spin_until(lambda: found, what="a prediction")
    assert found[0].measured == 0.5
    assert found[0].header.stamp.sec > 0


def test_a_batch_comes_back_as_a_batch(graph, history):
    series = {
        f"signals.{s}.type": "valve_twin_msgs/msg/Float64Series"
        for s in ("v_in", "v_out", "spool_position")
    }
    graph.host(TwinNode, **history, **series)
    found = graph.record(f"{NS}/twin/prediction", PredictionSeries)
    topics = ("command/v_in", "command/v_out", "spool_position")
    publishers = [graph.node.create_publisher(Float64Series, f"{NS}/{t}", 10) for t in topics]
    graph.spin_until(lambda: all(p.get_subscription_count() for p in publishers))
    for publisher in publishers:
        message = Float64Series(period=0.03, values=[0.1] * 40)
        message.header.stamp = to_time(START_NS)
        publisher.publish(message)
    graph.spin_until(lambda: sum(len(m.measured) for m in found) == 40, what="40 samples")
    assert found[0].period == 0.03
    assert found[0].header.stamp == to_time(START_NS)


def test_nothing_is_processed_before_the_first_clock(graph, history):
    node = graph.host(TwinNode, use_sim_time=True, **history)
    topics = node._valves[0].inputs.topics
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    clock = graph.node.create_publisher(Clock, "/clock", 10)
    feeder = Feeder(graph, NS)
    graph.spin_until(clock.get_subscription_count)
    feeder.feed(10)
    graph.spin_until(lambda: all(t.received == 10 for t in topics), what="all inputs")
    assert not found
    clock.publish(Clock(clock=to_time(START_NS)))
    graph.spin_until(lambda: node.get_clock().now().nanoseconds, what="the clock")
    feeder.feed(10)
    graph.spin_until(lambda: len(found) == 10, what="the samples after the clock")


def test_a_clock_that_is_set_back_drops_the_cycle_and_goes_on(graph, history, capfd):
    graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    feeder = Feeder(graph, NS)
    feeder.feed(100)
    graph.spin_until(lambda: len(found) == 100)
    feeder.feed(100, offset_ns=START_NS - 500_000_000_000)
    graph.spin_until(lambda: len(found) > 190, what="predictions after the jump")
    assert "the clock of the data was set back" in capfd.readouterr().err


@pytest.mark.parametrize("ahead_s", [3600, -3600])
def test_signals_whose_clocks_differ_are_named_with_the_offset(graph, history, capfd, ahead_s):
    graph.host(TwinNode, **history)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    feeder = Feeder(graph, NS)
    where = "ahead of" if ahead_s > 0 else "behind"
    wanted = f"signal v_in is stamped 3600 s {where} spool_position: their clocks differ"
    said = ""

    def told():
        nonlocal said
        stamp_ns = 10 * START_NS + feeder.sent * feeder.period_ns
        for publisher, ahead_ns in zip(feeder.publishers, (ahead_s * S, 0, 0), strict=True):
            publisher.publish(encode_stamped(stamp_ns + ahead_ns, 0.0))
        feeder.sent += 1
        graph.spin(0.03)
        said += capfd.readouterr().err
        return wanted in said

    graph.spin_until(told, what=wanted)
    key = "clock of v_in ahead of spool_position [s]"
    graph.spin_until(lambda: key in figures(diagnostics), what=key)
    assert float(figures(diagnostics)[key]) == pytest.approx(ahead_s, abs=0.1)
    assert said.count("their clocks differ") == 1


def test_two_sources_of_the_clock_are_named_once(graph, history, capfd):
    graph.host(TwinNode, use_sim_time=True, **history)
    publishers = [graph.stranger(name).create_publisher(Clock, "/clock", 10) for name in "ab"]
    said, k = "", 0

    def told():
        nonlocal said, k
        for i, publisher in enumerate(publishers):
            publisher.publish(Clock(clock=to_time(START_NS + k * S // 50 + i * 100 * S)))
        k += 1
        graph.spin(0.02)
        said += capfd.readouterr().err
        return k > 80 and "[clock.sources]" in said

    graph.spin_until(told, what="the two sources")
    assert said.count("2 publishers of /clock: /plant/a, /plant/b: time jumps") == 1
    assert said.count("the clock of the data was set back") <= 1


def test_topics_can_be_remapped(graph, history):
    graph.host(TwinNode, extra=["-r", "twin/prediction:=elsewhere"], **history)
    found = graph.record(f"{NS}/elsewhere", Prediction)
    Feeder(graph, NS).feed(5)
    graph.spin_until(lambda: len(found) == 5, what="predictions on the other topic")


def test_one_process_hosts_many_valves_each_in_its_namespace(graph, history):
    graph.host(TwinNode, ns="/press", **history, valves=["v1", "v2"], **{"v2.period_s": 0.03})
    first = graph.record("/press/v1/twin/prediction", Prediction)
    second = graph.record("/press/v2/twin/prediction", Prediction)
    Feeder(graph, "/press/v1").feed(10)
    Feeder(graph, "/press/v2").feed(20)
    graph.spin_until(lambda: (len(first), len(second)) == (10, 20), what="10 and 20 predictions")


@pytest.mark.parametrize(
    ("waited_s", "code"), [(0.0, "input.loss"), (2.0 * OVERRUN_S, "input.overrun")]
)
def test_what_our_own_queue_overwrote_is_told_apart_from_a_loss_on_the_way(
    graph, history, waited_s, code
):
    """Before a message that waited long for us others were overwritten."""
    node = graph.host(TwinNode, **history)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    received_ns = time.time_ns() - round(waited_s * 1e9)
    for sequence in (1, 2, 10):
        data = encode_stamped(START_NS + sequence * 30_000_000, 0.1)
        info = {"received_timestamp": received_ns, "publication_sequence_number": sequence}
        topic._on_message((data, info))

    def found():
        return {f.kind.code: f.events for f in node.faults.faults(NS) if f.subject == topic.topic}

    graph.spin_until(lambda: {"input.overrun", "input.loss"} & set(found()), what="the count")
    assert {c: n for c, n in found().items() if c in {"input.overrun", "input.loss"}} == {code: 7}


def at_pace(graph, feeder, seconds):
    """Feed samples at the pace of a plant."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        feeder.feed(1)
        graph.spin(PERIOD_S)


def figures(diagnostics):
    """Return the newest figures of the valve."""
    found = [s for m in diagnostics for s in m.status if s.hardware_id == NS]
    return {v.key: v.value for v in found[-1].values} if found else {}


def silence_s(graph, feeder, found, twin):
    """Return how long what is fed from now on is not predicted while cores are free [s]."""
    begun_s, waited = time.monotonic(), CoreWait(twin.pid, os.getpid())

    def with_a_core_s():
        return time.monotonic() - begun_s - waited.so_far_s()

    first_ns = START_NS + feeder.period_ns * feeder.sent
    while from_time(found[-1].header.stamp) < first_ns:
        at_pace(graph, feeder, PERIOD_S)
        assert with_a_core_s() < 60.0, twin.log[-3000:]
    return with_a_core_s()


def test_a_message_of_0_bytes_silences_a_topic_for_a_second_at_most_and_costs_no_sample(
    graph, history
):
    twin = graph.start("twin", **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    feeder = Feeder(graph, NS)
    graph.be_heard(f"{NS}/twin")
    topic = f"{NS}/spool_position"
    silences = []
    for _ in range(3):
        at_pace(graph, feeder, 0.5)
        graph.spin_until(lambda: len(found) > 0, what="predictions")
        feeder.publishers[2].publish(b"")
        silences.append(silence_s(graph, feeder, found, twin))
    assert max(silences) < RECOVERY_S, silences
    graph.spin_until(lambda: figures(diagnostics).get(f"{topic} listened anew") == "3")
    graph.spin_until(lambda: len(found) >= feeder.sent, what="a prediction of every sample")
    graph.wait_log(twin, "sent a message of 0 bytes", "[input.deaf]")
    assert twin.log.count("sent a message of 0 bytes") == 1


def test_an_input_that_hears_nothing_from_the_start_on_is_made_anew(graph, history):
    """A reader that was matched and gets nothing, as one on the port of a killed process."""
    node = graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    feeder = Feeder(graph, NS)
    topic._subscription._callback = lambda *_: None  # deaf, and nobody tells the input
    begin_s = time.monotonic() - ready_s(os.getpid())
    while not found:
        at_pace(graph, feeder, 0.1)
        assert time.monotonic() - ready_s(os.getpid()) - begin_s < HEARD_S
    assert (topic.deaf, topic.deaf_why) == (1, DEAF_FROM_START)
    at_pace(graph, feeder, 1.0)
    assert not topic._second.stands_in, "the new one is heard"
    stamps = [p.header.stamp.sec * 10**9 + p.header.stamp.nanosec for p in found]
    assert len(set(stamps)) == len(stamps), "nothing is taken twice"
    (told,) = [f for f in node.faults.faults(NS) if f.kind.code == "input.deaf"]
    assert (told.subject, told.events) == (topic.topic, 1)


@pytest.mark.slow
def test_a_twin_restarted_after_kills_is_heard_within_5_s_under_load(graph, history):
    """Its first messages are those of a process that takes the port of a killed one."""
    burning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    waited = []
    try:
        twin = graph.start("twin", **history)
        found = graph.record(f"{NS}/twin/prediction", Prediction)
        feeder = Feeder(graph, NS)
        for _ in range(8):
            while "is active" not in twin.log:
                at_pace(graph, feeder, 0.1)
            begin = time.monotonic()
            while not found:
                at_pace(graph, feeder, 0.1)
            waited.append(time.monotonic() - begin)
            at_pace(graph, feeder, 1.0)
            os.kill(twin.pid, signal.SIGKILL)  # its shared memory is left to the next one
            twin.process.wait()
            found.clear()
            twin = graph.start("twin", **history)
    finally:
        for process in burning:
            process.kill()
            process.wait()
    assert max(waited[1:]) < HEARD_S, waited


@pytest.mark.parametrize("bad", [b"\0", b"\0\1\0\0", b"\0\1\0\0" + bytes(5), b"\xff" * 40])
def test_a_message_that_cannot_be_read_is_counted_and_the_next_one_is_used(graph, history, bad):
    graph.host(TwinNode, **history)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    feeder = Feeder(graph, NS)
    feeder.feed(10)
    for publisher in feeder.publishers:
        publisher.publish(bad)
    feeder.feed(10)
    graph.spin_until(lambda: len(found) == 20, what="20 predictions")
    key = f"{NS}/spool_position received/lost/unreadable"
    graph.spin_until(lambda: figures(diagnostics).get(key) == "21/0/1", what="the count")


def test_a_message_of_more_than_a_million_samples_is_refused(graph, history):
    node = graph.host(TwinNode, **history)
    topic = next(t for t in node._valves[0].inputs.topics if t.topic.endswith("position"))
    for size in (MOST_BYTES + 1, 40):
        info = {"received_timestamp": time.time_ns(), "publication_sequence_number": 1}
        topic._on_message((bytes(size), info))
    topic.drain()
    assert (topic.received, topic.broken) == (2, 1)


def test_a_foreign_message_that_cannot_be_read_is_counted_as_such(graph, history):
    """Not as one that was lost on the way."""
    joint = {"topic": "/plc/joints", "type": "sensor_msgs/msg/JointState"}
    fields = {"v_in": "effort[0]", "v_out": "effort[1]", "spool_position": "position[0]"}
    mapping = {
        f"signals.{signal}.{key}": value
        for signal, field in fields.items()
        for key, value in {**joint, "field": field}.items()
    }
    graph.host(TwinNode, **history, **mapping)
    found = graph.record(f"{NS}/twin/prediction", Prediction)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    publisher = graph.node.create_publisher(JointState, "/plc/joints", 10)
    graph.spin_until(publisher.get_subscription_count)
    good = JointState(position=[0.5], effort=[0.1, 0.0])
    for message in (good, b"\0\1\0\0" + bytes(12) + b"\xff\xff\xff\x7f" * 6, good):
        publisher.publish(message)
    graph.spin_until(lambda: len(found) == 2, what="2 predictions")
    key = "/plc/joints received/lost/unreadable"
    graph.spin_until(lambda: figures(diagnostics).get(key) == "3/0/1", what="the count")
