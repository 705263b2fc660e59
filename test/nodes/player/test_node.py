# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The player on real DDS: what, when and in which order, and everything its services promise."""

import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from valve_twin_msgs import srv
from valve_twin_msgs.msg import Float64Stamped

from test.bag_samples import write_sample
from test.nodes.conftest import NS
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.errors import BagError
from valve_twin.io.mcap.reader import McapFile
from valve_twin.io.playback.reel import Reel
from valve_twin.nodes.player.node import BagPlayerNode
from valve_twin.nodes.runtime.stamps import from_time
from valve_twin.nodes.twin.inputs import seconds_now

S = 10**9
BEGIN_NS = 1_700_000_000 * S
STEP_NS = 10_000_000
TOPICS = [f"/press/v1/{name}" for name in ("command/v_in", "command/v_out", "spool_position")]
STATE = "/press/v1/state"
PLAYER = f"{NS}/bag_player"
STRING = "std_msgs/msg/String"
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Deeper than what is offered: of states that leave at once a queue of one would keep the last."""


def time_of(ns: int) -> Time:
    return Time(sec=ns // S, nanosec=ns % S)


def at(step: int) -> int:
    """Log time of the first message of a step [ns]."""
    return BEGIN_NS + step * STEP_NS


def write(path, steps: int, states=(), topics=TOPICS):
    """Values count the messages; a latched text says at which step it was written."""
    with BagWriter(path) as writer:
        offer = (QosProfile(durability="transient_local", depth=1),)
        writer.add_topic(STATE, STRING, qos=offer)
        for i in range(steps):
            for k, topic in enumerate(topics):
                write_sample(writer, topic, at(i) + k, float(len(topics) * i + k))
            if i in states:
                data = serialize_message(String(data=str(i)))
                writer.write(STATE, data, log_ns=at(i) + len(topics))
    return str(path)


@pytest.fixture
def bag(tmp_path):
    """One second of three topics, and a state that changes at 0, 30 and 60 steps."""
    return write(tmp_path / "bag", 100, (0, 30, 60))


class Heard(NamedTuple):
    """A message with the time at which it was sent, by which the topics can be put in order."""

    value: Any
    sent_ns: int


class Listener:
    """What comes on the topics of a bag."""

    def __init__(self, graph, prefix="/replay", topics=TOPICS) -> None:
        self.heard: list[Heard] = []
        self.states = graph.record(f"{prefix}{STATE}", String, LATCHED)
        self.clock = graph.record("/clock", Clock)
        for topic in topics:
            graph.node.create_subscription(Float64Stamped, f"{prefix}{topic}", self._take, 100000)
        self.graph = graph

    def _take(self, message, info) -> None:
        self.heard.append(Heard(message.value, info["source_timestamp"]))

    @property
    def values(self) -> list[float]:
        """Values in the order in which they were sent."""
        return [h.value for h in sorted(self.heard, key=lambda h: h.sent_ns)]

    @property
    def times(self) -> list[int]:
        return [from_time(c.clock) for c in self.clock]

    def until(self, count: int, timeout: float = 120.0) -> None:
        self.graph.spin_until(lambda: len(self.heard) >= count, timeout, f"{count} messages")

    def nothing_more(self, seconds: float = 0.3) -> None:
        before = len(self.heard)
        self.graph.spin(seconds)
        assert len(self.heard) == before

    def rests(self, seconds: float = 0.5) -> None:
        """Wait until what was sent before a stop has come, and nothing for a while."""
        seen, since_s = -1, 0.0
        while seen != len(self.heard) or time.monotonic() - since_s < seconds:
            if seen != len(self.heard):
                seen, since_s = len(self.heard), time.monotonic()
            self.graph.spin(0.05)
        self.nothing_more()

    def forget(self) -> None:
        for one in (self.heard, self.states, self.clock):
            one.clear()


# -- order and time


@pytest.mark.parametrize("rate", [1.0, 20.0, 0.0])
def test_all_topics_come_in_one_order_at_any_rate(graph, tmp_path, rate):
    bag = write(tmp_path / "bag", 150)
    listener = Listener(graph)
    graph.start("bag_player", bag=bag, rate=rate, topics=TOPICS, wait_for_subscribers=1)
    listener.until(450)
    assert listener.values == [float(i) for i in range(450)]


def clock_by_the_hertz(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, clock_hz=50.0, wait_for_subscribers=1)
    listener.until(300)
    return listener.times


def test_the_clock_by_the_hertz_never_goes_before_a_message_that_is_to_come(graph, bag):
    listener, begun_s = Listener(graph), time.monotonic()
    given = {"clock_hz": 50.0, "wait_for_subscribers": 1}
    player = graph.host(BagPlayerNode, bag=bag, start_paused=True, **given)
    graph.spin_until(lambda: listener.clock, what="the time at which it waits")
    player.playback.resume()
    listener.until(300)
    graph.spin_until(lambda: listener.times[-1] >= at(99) + 2, what="the time of the end")
    times, took_s = listener.times, time.monotonic() - begun_s
    assert times == sorted(times)
    assert len(times) < 50.0 * took_s + 2
    assert (times[0], times[-1]) == (at(0), at(99) + 2)


@pytest.mark.alone
def test_the_clock_by_the_hertz_comes_so_often(graph, bag):
    steps = np.diff(clock_by_the_hertz(graph, bag))
    assert 10_000_000 < np.median(steps) < 33_000_000  # it may be held up now and then


def test_the_clock_goes_with_the_chosen_topics_only(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, clock_topics=TOPICS[:1], wait_for_subscribers=1)
    listener.until(300)
    graph.spin_until(lambda: len(listener.clock) == 100, what="100 clocks")
    assert listener.times == [at(i) for i in range(100)]


def test_a_recorded_clock_gives_way_to_the_published_one(graph, tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.add_topic("/clock", "rosgraph_msgs/msg/Clock")
        for i in range(20):
            write_sample(writer, TOPICS[0], at(i), float(i))
            data = serialize_message(Clock(clock=time_of(7 * S + i)))
            writer.write("/clock", data, log_ns=at(i) + 1)
    listener = Listener(graph, topics=TOPICS[:1])
    player = graph.host(BagPlayerNode, bag=str(path), wait_for_subscribers=1)
    listener.until(20)
    graph.spin_until(lambda: len(listener.clock) >= 20, what="20 clocks")
    assert listener.times == [at(i) for i in range(20)]
    player.trigger_shutdown()
    recorded = graph.record("/replay/clock", Clock)
    graph.host(BagPlayerNode, bag=str(path), clock=False, rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: len(recorded) == 20, what="the recorded clock")
    assert [from_time(c.clock) for c in recorded] == [7 * S + i for i in range(20)]


# -- parts


def test_a_part_begins_and_ends_where_it_should(graph, bag):
    listener = Listener(graph)
    graph.host(
        BagPlayerNode,
        bag=bag,
        start_offset_s=0.4,
        duration_s=0.2,
        rate=0.0,
        wait_for_subscribers=1,
    )
    listener.until(61)
    graph.spin_until(lambda: listener.states and listener.clock, what="state and time")
    listener.nothing_more()
    assert listener.values == [float(i) for i in range(120, 181)]
    assert [m.data for m in listener.states] == ["30"]
    assert listener.times[0] == at(40)


def test_playing_stops_at_a_log_time(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, until_ns=at(9) + 1, rate=0.0, wait_for_subscribers=1)
    listener.until(29)
    listener.nothing_more()
    assert listener.values == [float(i) for i in range(29)]


def test_a_loop_begins_again_with_the_state_and_an_earlier_clock(graph, bag):
    listener = Listener(graph)
    graph.host(
        BagPlayerNode,
        bag=bag,
        start_offset_s=0.5,
        duration_s=0.05,
        loop=True,
        delay_s=0.1,
        wait_for_subscribers=1,
    )
    listener.until(48)
    once = [float(i) for i in range(150, 166)]
    assert listener.values[:48] == once * 3
    graph.spin_until(lambda: len(listener.states) >= 3, what="the state of three rounds")
    assert [m.data for m in listener.states][:3] == ["30"] * 3
    clocks = 3 * (len(once) + 1)  # one at the begin of a round and one before each message
    graph.spin_until(lambda: len(listener.clock) >= clocks, what="the clock of three rounds")
    backward = [i for i, (a, b) in enumerate(pairwise(listener.times[:clocks])) if b < a]
    assert len(backward) == 2
    heard = sorted(listener.heard, key=lambda h: h.sent_ns)[:48]
    pauses = [b.sent_ns - a.sent_ns for a, b in pairwise(heard) if b.value < a.value]
    assert min(pauses) > 0.1 * S


def test_a_delay_goes_before_the_first_message(graph, bag):
    listener = Listener(graph)
    began_ns = time.time_ns()
    graph.host(BagPlayerNode, bag=bag, delay_s=1.5, rate=0.0, wait_for_subscribers=1)
    listener.until(300)
    assert min(h.sent_ns for h in listener.heard) - began_ns >= 1.5 * S


# -- topics


def test_topics_are_filtered_and_renamed(graph, bag):
    renamed = graph.record("/replay/other/position", Float64Stamped)
    listener = Listener(graph)
    graph.host(
        BagPlayerNode,
        bag=bag,
        regex="^/press/v1/(command|spool)",
        exclude_topics=[TOPICS[1]],
        remap=[f"{TOPICS[2]}:=/other/position"],
        rate=0.0,
        wait_for_subscribers=1,
    )
    graph.spin_until(lambda: len(renamed) == 100, what="the renamed topic")
    listener.until(100)
    assert listener.values == [float(3 * i) for i in range(100)]
    assert not listener.states


@pytest.mark.parametrize(
    ("recorded", "given", "played"),
    [
        (["/sim/v/x", "/v/y"], {}, ["/replay/v/x", "/replay/v/y"]),
        (["/replay/v/x"], {}, ["/replay/v/x"]),
        (["/simon/x"], {}, ["/replay/simon/x"]),
        (["/sim/v/x"], {"publish_prefix": "/replay_2"}, ["/replay_2/v/x"]),
        (["/line2_sim/v/x"], {"replaced_prefixes": ["line2_sim"]}, ["/replay/v/x"]),
        (["/sim/v/x"], {"replaced_prefixes": [""]}, ["/replay/sim/v/x"]),
        (["/sim/v/x"], {"remap": ["/sim/v/x:=/sim/z"]}, ["/replay/sim/z"]),
        (["/sim/v/x", "/v/x"], {}, ["/replay/sim/v/x", "/replay/v/x"]),
        (["/replay/v/x", "/sim/v/x"], {}, ["/replay/replay/v/x", "/replay/v/x"]),
        (["/sim/v/x"], {"publish_prefix": ""}, ["/sim/v/x"]),
        (["/sim/v/x"], {"publish_prefix": "/plant"}, ["/plant/sim/v/x"]),
    ],
)
def test_the_prefix_of_a_simulated_or_replayed_valve_is_replaced(
    graph, tmp_path, recorded, given, played
):
    with BagWriter(tmp_path / "bag") as writer:
        for i, topic in enumerate(recorded):
            write_sample(writer, topic, at(i), 0.0)
    node = graph.host(BagPlayerNode, bag=str(tmp_path / "bag"), **given)
    assert node._settings is not None
    assert sorted(t.name for t in node._settings.topics) == played


def test_a_replaced_prefix_is_told(graph, tmp_path, capfd):
    with BagWriter(tmp_path / "bag") as writer:
        for i, topic in enumerate(["/sim/v/x", "/sim/v/y", "/v/y"]):
            write_sample(writer, topic, at(i), 0.0)
    graph.host(BagPlayerNode, bag=str(tmp_path / "bag"))
    told = capfd.readouterr().err
    assert "1 topics recorded below /sim are played below /replay instead" in told
    assert "topic '/sim/v/y' is played as '/replay/sim/v/y': '/replay/v/y' is another's" in told


def test_bytes_and_stamps_pass_untouched(graph, tmp_path):
    """Also a NaN with a payload, a negative zero and a stamp that no clock gives."""
    path = tmp_path / "bag"
    doubles = [bytes.fromhex(h) for h in ("010000000000f87f", "0000000000000080", "ff" * 8)]
    sent = [encode_stamped(3 * S - i, 0.0)[:-8] + d for i, d in enumerate(doubles * 3)]
    with BagWriter(path) as writer:
        writer.add_topic(TOPICS[0], "valve_twin_msgs/msg/Float64Stamped")
        for i, data in enumerate(sent):
            writer.write(TOPICS[0], data, log_ns=at(i))
    found: list[bytes] = []
    graph.node.create_subscription(
        Float64Stamped, f"/replay{TOPICS[0]}", found.append, 100, raw=True
    )
    graph.host(BagPlayerNode, bag=str(path), rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: len(found) == 9, what="9 messages")
    assert found == sent


def test_a_type_that_subscribers_would_misread_is_not_played(graph, tmp_path, capfd):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.add_topic("/text", STRING, message_definition="float64 x\n", definition_hash="")
        for i in range(5):
            writer.write("/text", bytes(12), log_ns=at(i))
            write_sample(writer, TOPICS[0], at(i), float(i))
    listener = Listener(graph, topics=TOPICS[:1])
    misread = graph.record("/replay/text", String)
    graph.host(BagPlayerNode, bag=str(path), rate=0.0, start_delay_s=1.0)
    listener.until(5)
    assert not misread
    said = capfd.readouterr().err
    assert f"topic '/text' is not played: the bag's {STRING} (RIHS01_" in said


def test_policies_are_those_of_the_bag_and_of_the_file(graph, tmp_path):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        offer = QosProfile(reliability="best_effort")
        for topic in TOPICS[:2]:
            writer.add_topic(topic, "valve_twin_msgs/msg/Float64Stamped", qos=(offer,))
            write_sample(writer, topic, at(0), 1.0)
    file = tmp_path / "qos.yaml"
    file.write_text(f"{TOPICS[1]}:\n  reliability: reliable\n  durability: transient_local\n")
    graph.host(
        BagPlayerNode,
        bag=str(path),
        lossless=False,
        start_paused=True,
        qos_overrides_path=str(file),
        **{f"qos_overrides./replay{TOPICS[0]}.publisher.depth": 7},
    )

    def offered(topic: str):
        return graph.node.get_publishers_info_by_topic(f"/replay{topic}")

    graph.spin_until(lambda: all(map(offered, TOPICS[:2])), what="the publishers")
    first, second = (offered(t)[0].qos_profile for t in TOPICS[:2])
    assert first.reliability == ReliabilityPolicy.BEST_EFFORT
    assert second.reliability == ReliabilityPolicy.RELIABLE
    assert second.durability == DurabilityPolicy.TRANSIENT_LOCAL


# -- services


@pytest.fixture
def paused(graph, bag):
    """A player that waits, and its listener."""
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, start_paused=True, wait_for_subscribers=1)
    return listener


def test_one_message_and_a_number_of_messages(graph, paused):
    assert graph.call(srv.PlayNext, f"{PLAYER}/play_next").success
    paused.until(1)
    paused.nothing_more()
    assert graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=50).actually_burst == 50
    graph.spin_until(lambda: len(paused.heard) + len(paused.states) == 51, what="51 messages")
    paused.nothing_more()
    burst = graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=0)
    assert burst.actually_burst == 303 - 51
    paused.until(300)
    assert paused.values == [float(i) for i in range(300)]
    assert [m.data for m in paused.states] == ["0", "30", "60"]
    assert not graph.call(srv.PlayNext, f"{PLAYER}/play_next").success


def test_steps_are_refused_while_it_plays(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, rate=0.05, wait_for_subscribers=1)
    listener.until(1)
    assert not graph.call(srv.PlayNext, f"{PLAYER}/play_next").success
    assert graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=3).actually_burst == 0


def test_a_seek_while_paused_shows_time_and_state_and_waits(graph, paused):
    graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=250)
    graph.spin_until(lambda: len(paused.heard) + len(paused.states) == 250, what="250 messages")
    graph.spin_until(lambda: len(paused.clock) == 251, what="the time before each and at first")
    assert [m.data for m in paused.states] == ["0", "30", "60"]
    paused.forget()
    assert graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(at(40))).success
    graph.spin_until(lambda: paused.states and paused.clock, what="state and time")
    paused.nothing_more()
    assert [m.data for m in paused.states] == ["30"]
    assert paused.times == [at(40)]
    assert not paused.heard
    assert graph.call(srv.PlayNext, f"{PLAYER}/play_next").success
    paused.until(1)
    assert paused.values == [120.0]
    for outside in (at(0) - 1, at(100)):
        assert not graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(outside)).success


def test_a_seek_back_while_playing_goes_on_in_order(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, rate=0.05, start_paused=True, wait_for_subscribers=1)
    graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=46)
    graph.call(srv.Resume, f"{PLAYER}/resume")
    listener.until(46)  # it plays, for 17 s
    assert graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(at(10))).success
    assert graph.call(srv.SetRate, f"{PLAYER}/set_rate", rate=4.0).success
    graph.spin_until(lambda: listener.values[-1] == 299.0, what="the end")
    listener.until(300)
    values = listener.values
    (back,) = [i for i, (a, b) in enumerate(pairwise(values)) if b < a]
    assert values[: back + 1] == [float(i) for i in range(back + 1)]
    assert values[back + 1 :] == [float(i) for i in range(30, 300)]
    graph.spin_until(lambda: listener.times[-1] == at(99) + 2, what="the last time")
    times = listener.times
    assert sum(b < a for a, b in pairwise(times)) == 1


def test_the_rate_changes_without_a_step(graph, tmp_path):
    listener = Listener(graph)
    bag = write(tmp_path / "bag", 300)
    player = graph.host(BagPlayerNode, bag=bag, rate=0.1, wait_for_subscribers=1)
    listener.until(40)  # what is left takes 28 s
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        assert not graph.call(srv.SetRate, f"{PLAYER}/set_rate", rate=wrong).success
    assert graph.call(srv.SetRate, f"{PLAYER}/set_rate", rate=4.0).success
    assert graph.call(srv.GetRate, f"{PLAYER}/get_rate").rate == 4.0
    left_s = 1e-9 * (at(299) + 2 - player.playback._time.now_ns(seconds_now()))
    fast_ns = time.time_ns()
    listener.until(900)
    heard = sorted(listener.heard, key=lambda h: h.sent_ns)
    assert [h.value for h in heard] == [float(i) for i in range(900)]
    # what is left of the bag when the rate changes is neither sent at once nor skipped
    assert left_s > 0.0
    assert 1e-9 * (heard[-1].sent_ns - fast_ns) > 0.98 * left_s / 4


def test_it_stops_and_plays_another_part(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, rate=0.05, wait_for_subscribers=1)
    listener.until(20)  # it plays, for 19 s more
    assert not graph.call(srv.Play, f"{PLAYER}/play").success
    graph.call(srv.Stop, f"{PLAYER}/stop")
    listener.rests()
    assert not graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(at(40))).success
    listener.forget()
    played = graph.call(
        srv.Play,
        f"{PLAYER}/play",
        start_offset=time_of(STEP_NS * 50),
        playback_duration=Duration(nanosec=STEP_NS),
    )
    assert played.success
    listener.until(4)
    graph.spin_until(lambda: listener.states, what="the state")
    listener.nothing_more()
    assert listener.values == [150.0, 151.0, 152.0, 153.0]
    assert [m.data for m in listener.states] == ["30"]
    beyond = graph.call(srv.Play, f"{PLAYER}/play", start_offset=time_of(5 * S))
    assert not beyond.success


def test_an_inactive_player_goes_on_where_it_was(graph, bag):
    listener = Listener(graph)
    player = graph.host(BagPlayerNode, bag=bag, wait_for_subscribers=1)
    listener.until(100)
    player.trigger_deactivate()
    listener.rests()
    assert graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=5).actually_burst == 0
    assert not graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(at(3))).success
    player.trigger_activate()
    listener.until(300)
    assert listener.values == [float(i) for i in range(300)]


def test_a_bag_that_is_deleted_plays_on_and_one_that_cannot_be_read_on_is_let_go(
    graph, tmp_path, monkeypatch, capfd
):
    bag = write(tmp_path / "bag", 100)
    listener = Listener(graph)
    player = graph.host(BagPlayerNode, bag=bag, wait_for_subscribers=1, start_paused=True)

    def asked() -> bool:
        return bool(graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=5).actually_burst == 5)

    graph.spin_until(asked, what="a burst")  # it begins when it has met its subscribers
    (Path(bag) / "metadata.yaml").unlink()
    (file,) = Path(bag).glob("*.mcap")
    file.unlink()
    assert not graph.call(srv.Seek, f"{PLAYER}/seek", time=time_of(at(3))).success
    assert "not sought: " in capfd.readouterr().err
    graph.call(srv.Burst, f"{PLAYER}/burst", num_messages=10)
    listener.until(15)
    assert listener.values == [float(i) for i in range(15)]

    def refuse(_: Reel) -> None:
        msg = "cut while it was read"
        raise BagError(msg)

    monkeypatch.setattr(Reel, "_following", refuse)
    graph.call(srv.Resume, f"{PLAYER}/resume")
    graph.spin_until(lambda: player.state == "unconfigured", what="the end")
    assert "stopped: cut while it was read" in capfd.readouterr().err


def test_a_late_subscriber_gets_the_state(graph, bag):
    listener = Listener(graph)
    graph.host(BagPlayerNode, bag=bag, rate=0.0, wait_for_subscribers=1)
    listener.until(300)
    late = graph.record(f"/replay{STATE}", String, LATCHED)
    graph.spin_until(lambda: late, what="the state")
    assert [m.data for m in late] == ["60"]


# -- faults


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"topics": ["/press/v1/spool"]}, "there is no topic '/press/v1/spool'; did you mean"),
        ({"start_offset_s": 3}, "start offset 3 s is beyond its end"),
        ({"regex": "("}, "key 'regex': '(' is no regular expression"),
        ({"remap": ["/a"]}, "key 'remap' cannot be '/a'; write /old:=/new"),
        ({"remap": [f"{TOPICS[0]}:=/x", f"{STATE}:=/x"]}, "'/replay/x' would carry"),
        ({"publish_prefix": "/1 b"}, "is no topic name"),
        ({"qos_overrides_path": "/none.yaml"}, "/none.yaml: cannot be read"),
        ({"rate": -1.0}, "parameter 'rate'"),
    ],
)
def test_what_cannot_be_played_is_told_in_one_line(graph, bag, capfd, parameters, told):
    player = graph.host(BagPlayerNode, **{"bag": bag, **parameters})
    assert player.state == "unconfigured"
    said = capfd.readouterr().err
    assert told in said
    assert said.count("\n") == 1


def test_a_relative_bag_is_named_from_the_root(graph, bag, capfd, monkeypatch):
    path = Path(bag)
    monkeypatch.chdir(path.parent)
    player = graph.host(BagPlayerNode, bag=path.name, topics=["/press/v1/spool"])
    assert player.state == "unconfigured"
    assert f"{path}: there is no topic" in capfd.readouterr().err


def test_a_damaged_bag_is_played_as_far_as_it_is_intact(graph, tmp_path, capfd):
    """One byte in the middle of three chunks is wrong, and the end of the file is missing."""
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for i in range(300):
            write_sample(writer, TOPICS[0], at(i), float(i))
            if i % 100 == 99:
                writer.flush()
    (mcap,) = path.glob("*.mcap")
    data = bytearray(mcap.read_bytes())
    with closing(McapFile(mcap)) as file:
        chunks = file.summary.chunks
    assert len(chunks) == 3
    data[chunks[1].offset + chunks[1].length // 2] ^= 255
    mcap.write_bytes(data[: chunks[2].offset + chunks[2].length])
    listener = Listener(graph, topics=TOPICS[:1])
    graph.host(BagPlayerNode, bag=str(path), rate=0.0, wait_for_subscribers=1)
    graph.spin_until(lambda: listener.heard and listener.values[-1] == 299.0, what="the end")
    listener.nothing_more()
    intact = [float(i) for i in (*range(100), *range(200, 300))]
    rescued = set(listener.values) - set(intact)
    assert [v for v in listener.values if v not in rescued] == intact
    assert rescued < {float(i) for i in range(100, 200)}
    assert "[press.v1.bag_player]: " in (said := capfd.readouterr().err)
    assert "bag_0.mcap" in said


def test_a_player_is_light(graph, bag):
    """It needs no compiled kernel and no solver."""
    player = graph.start("bag_player", fresh=True, bag=bag, start_paused=True)
    assert graph.call(srv.IsPaused, f"{PLAYER}/is_paused").paused
    status = Path(f"/proc/{player.pid}/status").read_text()
    (resident,) = [line.split()[1] for line in status.splitlines() if line.startswith("VmRSS")]
    assert int(resident) < 150_000
    libraries = Path(f"/proc/{player.pid}/maps").read_text()
    assert not [name for name in ("llvmlite", "/scipy/", "cvxpy") if name in libraries]
