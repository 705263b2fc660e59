# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recorder on real DDS: choice, quality of service, files, losses and snapshots."""

import os
import subprocess
import threading

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mcap.reader import make_reader
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from valve_twin_msgs.msg import (
    CycleSummary,
    Float64Stamped,
    RecorderStatus,
    Verdict,
    WriteSplitEvent,
)
from valve_twin_msgs.srv import IsPaused, Pause, Resume, Snapshot, SplitBagfile, Stop

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, START_NS, Feeder
from valve_twin.io.bags.read import bag_info
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.playback.player import bag_topics
from valve_twin.nodes.recorder import node as bag_recorder
from valve_twin.nodes.recorder.node import BagRecorderNode
from valve_twin.nodes.runtime.stamps import from_time, to_time
from valve_twin.nodes.twin.node import TwinNode

POSITION = f"{NS}/spool_position"
INPUTS = [f"{NS}/command/v_in", f"{NS}/command/v_out", POSITION]
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


def metadata(path):
    return yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def counts(path):
    return {t.name: t.count for t in bag_info(path).topics}


def stamps(path, topic=POSITION):
    """Return the header stamps of a file [ns]."""
    with path.open("rb") as stream:
        data = [m.data for _, _, m in make_reader(stream).iter_messages([topic])]
    pairs = [(int.from_bytes(d[4:8], "little"), int.from_bytes(d[8:12], "little")) for d in data]
    return [1_000_000_000 * seconds + rest for seconds, rest in pairs]


def notes(path):
    """Return the metadata records of a file."""
    with path.open("rb") as stream:
        return {m.name: m.metadata for m in make_reader(stream).iter_metadata()}


def written(recorder, topic):
    return recorder._recording.counts.get(topic, 0)


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """Let the disk finish a bag: that of a busy machine may need more than a node waits."""
    monkeypatch.setattr(bag_recorder, "CLOSE_S", 60.0)


def finish(recorder):
    recorder.trigger_deactivate()
    recorder.trigger_cleanup()


def meet(graph, recorder, topics, publishers=1):
    """Wait until the recorder has met the publishers of its topics, not only they it."""

    def met() -> bool:
        found = [recorder._topics.get(t) for t in topics]
        return all(t and t._subscription.get_publisher_count() >= publishers for t in found)

    graph.spin_until(met, what="the publishers")


@pytest.fixture
def feeder(graph):
    """Samples of a valve, made when a recorder listens."""

    def make(recorder) -> Feeder:
        made = Feeder(graph, NS)
        meet(graph, recorder, INPUTS)
        return made

    return make


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("keep_files", 1),
        ("max_bag_size", 1),
        ("max_bag_duration", 0.1),
        ("min_free_bytes", 2**50),
        ("when_disk_low", "delete_oldest"),
        ("queue_bytes", 2**40),
        ("snapshot_bytes", 2**40),
    ],
)
def test_what_deletes_or_bounds_recordings_is_not_set_from_afar(graph, tmp_path, name, value):
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=INPUTS)
    recorder.trigger_deactivate()
    recorder.trigger_cleanup()
    (result,) = recorder.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert "is not changed from afar" in result.reason


def test_topics_are_chosen_by_expression_and_type(graph, tmp_path):
    for name, kind in (("/x/one", String), ("/x/two", Float64Stamped), ("/y/one", String)):
        graph.node.create_publisher(kind, name, 10)
    recorder = graph.host(
        BagRecorderNode,
        bag=str(tmp_path / "bag"),
        regex="^/x/",
        types=["std_msgs/msg/String"],
        exclude_topics=["/x/one"],
        custom_data=["valve=/press/v1", "serial = 4711"],
    )
    graph.spin_until(lambda: len(recorder._topics) == 2, what="both topics")
    finish(recorder)
    content = metadata(tmp_path / "bag")
    names = {t["topic_metadata"]["name"] for t in content["topics_with_message_count"]}
    assert names == {"/x/two", "/y/one"}
    assert content["custom_data"]["serial"] == "4711"
    assert content["custom_data"]["lost_transport /x/two"] == "0"
    assert notes(tmp_path / "bag" / "bag_0.mcap")["valve_twin"]["valve"] == "/press/v1"


def test_it_says_when_publishers_are_there_and_nothing_comes(graph, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_recorder, "SILENT_S", 0.0)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    publisher = graph.node.create_publisher(String, POSITION, 10)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=[POSITION])

    def level_of_the_bag():
        of_bag = [s for m in diagnostics[-1:] for s in m.status if s.name.endswith("bag")]
        return of_bag[0].level if of_bag else None

    graph.spin_until(lambda: level_of_the_bag() == DiagnosticStatus.WARN, what="the warning")
    (told,) = [s.message for s in diagnostics[-1].status if s.name.endswith("bag")]
    assert f"on {POSITION}, which have publishers" in told
    meet(graph, recorder, [POSITION])
    publisher.publish(String(data="one"))
    graph.spin_until(lambda: level_of_the_bag() == DiagnosticStatus.OK, what="its end")
    finish(recorder)


@pytest.mark.parametrize(
    ("parameters", "line"),
    [
        ({"custom_data": ["4711"]}, "'4711' has no key; write KEY=VALUE"),
        ({"regex": "("}, "'regex': '(' is no regular expression"),
        ({"when_disk_low": "delete_oldest"}, "set max_bag_size or max_bag_duration too"),
        ({"qos_profile_overrides_path": "/nowhere.yaml"}, "/nowhere.yaml: cannot be read"),
    ],
)
def test_what_cannot_be_configured_is_one_clear_line(graph, tmp_path, capfd, parameters, line):
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), **parameters)
    assert recorder.state == "unconfigured"
    assert line in capfd.readouterr().err
    assert not (tmp_path / "bag").exists()


def test_a_bag_that_cannot_be_made_leaves_no_thread(graph, tmp_path, capfd):
    (tmp_path / "file").write_text("no folder")
    recorder = graph.host(BagRecorderNode, start=False, bag=str(tmp_path / "file" / "bag"))
    before = threading.active_count()
    for _ in range(2):
        recorder.start()
        assert recorder.state == "unconfigured"
    assert "cannot be written" in capfd.readouterr().err
    assert threading.active_count() == before


def test_the_service_splits_and_the_event_names_both_files(graph, tmp_path, feeder):
    events = graph.record(f"{NS}/bag_recorder/events/write_split", WriteSplitEvent)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=INPUTS)
    graph.spin_until(lambda: graph.connected(f"{NS}/bag_recorder/events/write_split"))
    source = feeder(recorder)
    source.feed(20)
    graph.spin_until(lambda: written(recorder, POSITION) == 20, what="20 samples")
    graph.call(SplitBagfile, f"{NS}/bag_recorder/split_bagfile")
    graph.spin_until(lambda: events, what="the event")
    assert (events[0].closed_file, events[0].opened_file) == ("bag_0.mcap", "bag_1.mcap")
    source.feed(30)
    graph.spin_until(lambda: written(recorder, POSITION) == 50, what="50 samples")
    finish(recorder)
    assert metadata(tmp_path / "bag")["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    assert [len(stamps(tmp_path / "bag" / f"bag_{i}.mcap")) for i in (0, 1)] == [20, 30]
    assert counts(tmp_path / "bag")[POSITION] == 50


def test_paused_nothing_is_written_and_stop_finishes_the_bag(graph, tmp_path, feeder):
    recorder = graph.host(
        BagRecorderNode, bag=str(tmp_path / "bag"), topics=INPUTS, start_paused=True
    )
    status = graph.record(f"{NS}/bag_recorder/status", RecorderStatus)
    source = feeder(recorder)
    assert graph.call(IsPaused, f"{NS}/bag_recorder/is_paused").paused
    source.feed(10)
    graph.spin_until(lambda: status and status[-1].state == "paused", what="a status")
    graph.spin_until(lambda: all(t._last == 10 for t in recorder._topics.values()))
    graph.call(Resume, f"{NS}/bag_recorder/resume")
    source.feed(15)
    graph.spin_until(lambda: written(recorder, POSITION) == 15, what="15 samples")
    graph.call(Pause, f"{NS}/bag_recorder/pause")
    assert graph.call(IsPaused, f"{NS}/bag_recorder/is_paused").paused
    graph.call(Stop, f"{NS}/bag_recorder/stop")
    assert recorder.state == "unconfigured"
    assert counts(tmp_path / "bag")[POSITION] == 15
    assert metadata(tmp_path / "bag")["custom_data"][f"lost_transport {POSITION}"] == "0"


def test_deactivated_and_activated_again_it_goes_on_in_the_same_bag(graph, tmp_path, feeder):
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=INPUTS)
    source = feeder(recorder)
    source.feed(5)
    graph.spin_until(lambda: written(recorder, POSITION) == 5, what="5 samples")
    recorder.trigger_deactivate()
    source.feed(5)
    recorder.trigger_activate()
    publishers = source._publishers
    graph.spin_until(lambda: all(p.get_subscription_count() for p in publishers))
    meet(graph, recorder, INPUTS)
    source.feed(7)
    graph.spin_until(lambda: written(recorder, POSITION) == 12, what="12 samples")
    finish(recorder)
    assert counts(tmp_path / "bag")[POSITION] == 12
    assert metadata(tmp_path / "bag")["custom_data"][f"lost_transport {POSITION}"] == "0"


def test_nothing_is_recorded_before_the_first_clock(graph, tmp_path, feeder):
    clock = graph.node.create_publisher(Clock, "/clock", 10)
    recorder = graph.host(
        BagRecorderNode, bag=str(tmp_path / "bag"), topics=INPUTS, use_sim_time=True
    )
    status = graph.record(f"{NS}/bag_recorder/status", RecorderStatus)
    source = feeder(recorder)
    source.feed(10)
    graph.spin_until(lambda: all(t._last == 10 for t in recorder._topics.values()))
    graph.spin_until(lambda: status and status[-1].state == "waiting for the clock")
    now = START_NS + 5_000_000_000
    clock.publish(Clock(clock=to_time(now)))
    graph.spin_until(lambda: recorder.get_clock().now().nanoseconds == now, what="the time")
    source.feed(4)
    graph.spin_until(lambda: written(recorder, POSITION) == 4, what="4 samples")
    finish(recorder)
    info = bag_info(tmp_path / "bag")
    assert info.start_ns == info.end_ns == now


def test_losses_on_the_way_are_counted_told_and_stored(graph, tmp_path):
    (tmp_path / "qos.yaml").write_text(yaml.safe_dump({"/x": {"depth": 1}}))
    publisher = graph.node.create_publisher(String, "/x", BEST_EFFORT)
    status = graph.record(f"{NS}/bag_recorder/status", RecorderStatus)
    recorder = graph.host(
        BagRecorderNode,
        bag=str(tmp_path / "bag"),
        topics=["/x"],
        qos_profile_overrides_path=str(tmp_path / "qos.yaml"),
    )
    meet(graph, recorder, ["/x"])
    publisher.publish(String(data="first"))
    graph.spin_until(lambda: written(recorder, "/x") == 1, what="the first")
    for i in range(50):  # nobody takes them: the recorder holds the last one
        publisher.publish(String(data=f"{i}"))
    graph.spin_until(lambda: written(recorder, "/x") > 1, what="the last")
    lost = 51 - written(recorder, "/x")
    assert lost > 0
    graph.spin_until(
        lambda: status and sum(status[-1].lost_transport) == lost, what="the loss in the status"
    )
    graph.spin_until(  # the diagnostics look after it at a time of their own
        lambda: "recorder.loss" in {f.kind.code for f in recorder.faults.faults("")},
        what="the fault",
    )
    finish(recorder)
    assert metadata(tmp_path / "bag")["custom_data"]["lost_transport /x"] == str(lost)


def test_a_slow_disk_costs_messages_that_are_counted_and_nothing_else(graph, tmp_path):
    publisher = graph.node.create_publisher(String, "/x", 1000)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=["/x"], queue=10)
    meet(graph, recorder, ["/x"])
    disk = threading.Event()
    recorder._disk.do(disk.wait)
    for i in range(100):
        publisher.publish(String(data=f"{i}"))
    topic = recorder._topics["/x"]
    graph.spin_until(lambda: topic._last == 100, what="100 messages")
    assert topic.lost_recorder == 90
    assert not graph.call(IsPaused, f"{NS}/bag_recorder/is_paused").paused
    disk.set()
    graph.spin_until(lambda: written(recorder, "/x") == 10, what="10 messages")
    finish(recorder)
    assert counts(tmp_path / "bag") == {"/x": 10}
    assert metadata(tmp_path / "bag")["custom_data"]["lost_recorder /x"] == "90"


def test_it_adapts_to_a_publisher_that_offers_less(graph, tmp_path):
    strong = graph.node.create_publisher(String, "/x", 1000)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=["/x"])
    meet(graph, recorder, ["/x"])
    strong.publish(String(data="strong"))
    graph.spin_until(lambda: written(recorder, "/x") == 1, what="the strong one")
    weak = graph.stranger("weak").create_publisher(String, "/x", BEST_EFFORT)
    meet(graph, recorder, ["/x"], publishers=2)
    graph.spin_until(weak.get_subscription_count, what="the recorder: nothing is sent again")
    weak.publish(String(data="weak"))
    graph.spin_until(lambda: written(recorder, "/x") == 2, what="the weak one")
    graph.call(SplitBagfile, f"{NS}/bag_recorder/split_bagfile")
    finish(recorder)
    content = metadata(tmp_path / "bag")
    (topic,) = content["topics_with_message_count"]
    offered = {p["reliability"] for p in topic["topic_metadata"]["offered_qos_profiles"]}
    assert offered == {"reliable", "best_effort"}


def test_readers_that_are_made_anew_have_no_events_that_could_be_queued(graph, tmp_path):
    """One that is queued while its reader is destroyed ends the process (ros2/rclpy#1644)."""
    graph.node.create_publisher(String, "/x", 10)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=["/x"])
    meet(graph, recorder, ["/x"])
    first = recorder._topics["/x"]._subscription
    graph.stranger("weak").create_publisher(String, "/x", BEST_EFFORT)
    graph.spin_until(lambda: recorder._topics["/x"]._subscription is not first, what="the second")
    assert not first.event_handlers
    assert not recorder._topics["/x"]._subscription.event_handlers


def test_who_offers_less_than_a_file_asks_for_is_named_once_for_each_publisher(
    graph, tmp_path, capfd
):
    path = tmp_path / "qos.yaml"
    path.write_text(yaml.safe_dump({"/x": {"reliability": "reliable"}}))
    given = {"topics": ["/x"], "qos_profile_overrides_path": str(path)}
    strong = graph.node.create_publisher(String, "/x", 10)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), **given)
    meet(graph, recorder, ["/x"])
    said = "/x: a publisher offers less than is asked for (RELIABILITY) and is not recorded"
    topic = recorder._topics["/x"]
    for i in range(2):
        graph.stranger(f"weak_{i}").create_publisher(String, "/x", BEST_EFFORT)
        graph.spin_until(lambda n=i + 2: topic.publishers == n and topic._told, what="the line")
        graph.spin(2.5)  # it is looked for every second
        assert capfd.readouterr().err.count(said) == 1
    strong.publish(String(data="strong"))
    graph.spin_until(lambda: written(recorder, "/x") == 1, what="the strong one")
    finish(recorder)


def test_what_is_offered_of_another_type_makes_no_reader_best_effort(graph, tmp_path):
    graph.node.create_publisher(String, "/x", 10)
    recorder = graph.host(BagRecorderNode, bag=str(tmp_path / "bag"), topics=["/x"])
    meet(graph, recorder, ["/x"])
    topic = recorder._topics["/x"]
    graph.stranger("plc").create_publisher(Float64Stamped, "/x", BEST_EFFORT)
    graph.spin_until(lambda: topic.publishers == 2, what="the other")
    graph.spin(1.5)  # it is looked for every second
    assert topic._profile.reliability == ReliabilityPolicy.RELIABLE
    finish(recorder)


def test_policies_of_a_file_win_over_what_is_offered(graph, tmp_path):
    path = tmp_path / "qos.yaml"
    path.write_text(yaml.safe_dump({"/x": {"reliability": "best_effort", "depth": 7}}))
    publisher = graph.node.create_publisher(String, "/x", 1000)
    recorder = graph.host(
        BagRecorderNode,
        bag=str(tmp_path / "bag"),
        topics=["/x"],
        qos_profile_overrides_path=str(path),
    )
    graph.spin_until(publisher.get_subscription_count, what="the recorder")
    (mine,) = (
        s.qos_profile
        for s in graph.node.get_subscriptions_info_by_topic("/x")
        if s.node_name == "bag_recorder"
    )
    assert mine.reliability == ReliabilityPolicy.BEST_EFFORT
    finish(recorder)
    (topic,) = bag_topics(tmp_path / "bag")
    assert topic.name == "/x"


# -- snapshots


def test_a_snapshot_is_refused_where_everything_is_written(graph, tmp_path):
    graph.host(BagRecorderNode, bag=str(tmp_path / "bag"))
    assert not graph.call(Snapshot, f"{NS}/bag_recorder/snapshot").success


def test_the_service_saves_what_is_buffered(graph, tmp_path, feeder):
    path = tmp_path / "bag"
    recorder = graph.host(BagRecorderNode, bag=str(path), topics=INPUTS, snapshot_mode=True)
    assert not graph.call(Snapshot, f"{NS}/bag_recorder/snapshot").success
    source = feeder(recorder)
    for k in range(2):
        source.feed(40)
        graph.spin_until(lambda: len(recorder._snapshots.ring) == 120, what="40 samples")
        assert written(recorder, POSITION) == 40 * k
        assert graph.call(Snapshot, f"{NS}/bag_recorder/snapshot").success
        assert counts(path)[POSITION] == 40 * (k + 1)
        assert notes(path / f"bag_{k}.mcap")["snapshot"]["trigger"] == "service"
    finish(recorder)
    assert metadata(path)["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]


def test_a_snapshot_holds_whole_cycles(graph, tmp_path, feeder):
    path = tmp_path / "bag"
    recorder = graph.host(
        BagRecorderNode, bag=str(path), topics=INPUTS, snapshot_mode=True, snapshot_cycles=2
    )
    announced = graph.node.create_publisher(CycleSummary, f"{NS}/twin/cycle", LATCHED)
    graph.spin_until(announced.get_subscription_count, what="the recorder")
    source = feeder(recorder)
    source.feed(450)
    graph.spin_until(lambda: len(recorder._snapshots.ring) == 1350, what="450 samples")
    for k in range(4):
        begin = START_NS + 100 * k * source.period_ns
        announced.publish(
            CycleSummary(
                valve=NS,
                cycle=k,
                start=to_time(begin),
                end=to_time(begin + 99 * source.period_ns),
            )
        )
    graph.spin_until(lambda: len(recorder._snapshots.ring) < 1000, what="the cycles")
    assert graph.call(Snapshot, f"{NS}/bag_recorder/snapshot").success
    wanted = [START_NS + i * source.period_ns for i in range(200, 400)]
    for topic in INPUTS:
        assert stamps(path / "bag_0.mcap", topic) == wanted
    assert notes(path / "bag_0.mcap")["snapshot"]["cycles"] == "2..3"
    assert len(recorder._snapshots.ring) == 150


def status_message(name, level, hardware_id=""):
    status = DiagnosticStatus(name=name, level=level, message="gone", hardware_id=hardware_id)
    return DiagnosticArray(status=[status])


def test_an_error_of_its_own_valve_takes_a_snapshot_once(graph, tmp_path, feeder):
    path = tmp_path / "bag"
    recorder = graph.host(
        BagRecorderNode, bag=str(path), topics=INPUTS, snapshot_mode=True, alarm_pause_s=0.0
    )
    publisher = graph.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    graph.spin_until(publisher.get_subscription_count, what="the recorder")
    source = feeder(recorder)
    source.feed(10)
    graph.spin_until(lambda: len(recorder._snapshots.ring) == 30, what="10 samples")
    publisher.publish(status_message("/press/v2/twin: x", DiagnosticStatus.ERROR))
    publisher.publish(status_message(f"{NS}/twin: x", DiagnosticStatus.WARN))
    publisher.publish(status_message(f"{NS}/twin: x", DiagnosticStatus.ERROR))
    publisher.publish(status_message(f"{NS}/twin: x", DiagnosticStatus.ERROR))
    graph.spin_until(lambda: recorder._recording.snapshots, what="a snapshot")
    found = notes(path / "bag_0.mcap")["snapshot"]
    assert (found["trigger"], found["source"]) == ("alarm", "/diagnostics")
    assert (found["name"], found["text"], found["alarms"]) == (f"{NS}/twin: x", "gone", "1")
    source.feed(10)
    graph.spin_until(lambda: len(recorder._snapshots.ring) == 30, what="10 samples")
    publisher.publish(status_message("shared: y", DiagnosticStatus.ERROR, NS))
    graph.spin_until(lambda: recorder._recording.snapshots == 2, what="a second snapshot")
    assert counts(path)[POSITION] == 20


def test_a_verdict_takes_a_snapshot_a_while_after_it(graph, tmp_path, feeder):
    path = tmp_path / "bag"
    recorder = graph.host(
        BagRecorderNode,
        bag=str(path),
        topics=INPUTS,
        snapshot_mode=True,
        snapshot_after_s=0.3,
        alarms=["verdict"],
    )
    publisher = graph.node.create_publisher(Verdict, f"{NS}/aging_monitor/verdict", LATCHED)
    graph.spin_until(publisher.get_subscription_count, what="the recorder")
    source = feeder(recorder)
    source.feed(10)
    graph.spin_until(lambda: len(recorder._snapshots.ring) == 30, what="10 samples")
    for verdict in (Verdict.NOT_ENOUGH_DATA, Verdict.OK, Verdict.VALVE, Verdict.VALVE):
        publisher.publish(Verdict(valve=NS, verdict=verdict, text="valve", evidence="K_in -12 %"))
    timer = graph.spin_until(lambda: recorder._snapshots._timer, what="the alarm")
    assert timer.timer_period_ns == 300_000_000
    timer.cancel()  # however long this process gets no core
    source.feed(5)
    graph.spin_until(lambda: len(recorder._snapshots.ring) == 45, what="5 more samples")
    timer.reset()
    graph.spin_until(lambda: recorder._recording.snapshots, what="a snapshot")
    assert counts(path)[POSITION] == 15
    assert notes(path / "bag_0.mcap")["snapshot"]["text"] == "valve: K_in -12 %"


def test_a_full_disk_ends_the_file_not_the_node(graph, tmp_path):
    place = tmp_path / "small"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "none", str(place)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a small file system")
    try:
        (place / "ballast").write_bytes(bytes(3 * 2**20))
        diagnostics = graph.record("/diagnostics", DiagnosticArray)
        status = graph.record(f"{NS}/bag_recorder/status", RecorderStatus)
        process = graph.start(
            "bag_recorder", bag=str(place / "bag"), topics=[POSITION], min_free_bytes=0
        )
        publisher = graph.node.create_publisher(String, POSITION, 1000)
        graph.spin_until(publisher.get_subscription_count, what="the recorder")

        def fill() -> bool:
            for _ in range(20):
                publisher.publish(String(data=os.urandom(1000).hex()))
            return bool(status and status[-1].state == "disk")

        graph.spin_until(fill, what="a full disk")
        assert "No space left on device" in status[-1].trouble
        graph.spin_until(
            lambda: any(
                s.level == DiagnosticStatus.ERROR and "No space left" in s.message
                for m in diagnostics
                for s in m.status
            ),
            what="the fault on /diagnostics",
        )
        graph.wait_log(process, "recording stops: ")
        assert process.log.count("recording stops: ") == 1
        (place / "ballast").unlink()
        graph.spin_until(lambda: status[-1].state == "recording", what="recording again")
        before = sum(status[-1].messages)
        publisher.publish(String(data=encode_stamped(0, 1.0).hex()))
        graph.spin_until(lambda: sum(status[-1].messages) > before, what="a message")
        assert process.end() == 0
        assert "recording goes on" in process.log
        assert len(metadata(place / "bag")["relative_file_paths"]) == 2
        assert bag_info(place / "bag").message_count == metadata(place / "bag")["message_count"]
    finally:
        for process in graph.processes:
            process.kill()
        subprocess.run(["umount", str(place)], check=True)


def test_cycles_that_the_twin_announces_cut_the_snapshot(graph, tmp_path, feeder):
    path = tmp_path / "bag"
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    twin = {"history_url": f"sqlite:///{tmp_path / 'history.sqlite'}", **REARM}
    graph.host(TwinNode, **twin)
    recorder = graph.host(
        BagRecorderNode,
        bag=str(path),
        snapshot_mode=True,
        snapshot_cycles=2,
        snapshot_s=0.0,
    )
    graph.spin_until(lambda: graph.connected(f"{NS}/twin/cycle"), what="the twin")
    meet(graph, recorder, [f"{NS}/twin/cycle", f"{NS}/twin/estimate"])
    source = feeder(recorder)
    while len(summaries) < 2 and source.sent < 5 * source.cycle_samples:
        source.feed(50)  # a burst is resent by the middleware, topics then come seconds apart
        graph.spin_until(
            lambda: all(recorder._topics[t]._last == source.sent for t in INPUTS),
            what="50 samples",
        )
    graph.spin_until(lambda: len(recorder._snapshots.ring._spans) == 2, what="their ends")
    assert graph.call(Snapshot, f"{NS}/bag_recorder/snapshot").success
    first, last = summaries[-2], summaries[-1]
    found = stamps(path / "bag_0.mcap")
    assert (found[0], found[-1]) == (from_time(first.start), from_time(last.end))
    assert len(found) == first.samples + last.samples
    cause = notes(path / "bag_0.mcap")["snapshot"]
    assert cause["cycles"] == f"{first.cycle}..{last.cycle}"
