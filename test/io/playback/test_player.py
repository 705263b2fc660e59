# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A bag read back message by message: order, parts, the state before a time, the right types."""

import random

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from test.bag_samples import write_sample
from test.io.salvage.damage_truth import written
from test.io.salvage.test_agreement import wrong_times
from valve_twin.io.bags.qos import FOREVER_NS, QosProfile, override, read_offer, read_overrides
from valve_twin.io.bags.read import bag_info
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.errors import BagError, ConfigError, IndexLiesError
from valve_twin.io.playback.choice import Choice, read_remaps, stretch
from valve_twin.io.playback.player import (
    BagMessage,
    bag_topics,
    compare_small,
    latched_before,
    read_messages,
)
from valve_twin.io.playback.reel import Reel
from valve_twin.io.salvage.read import forget

LATCHED = (QosProfile(durability="transient_local", depth=2),)
STRING = "std_msgs/msg/String"
S = 10**9


def text(value: str) -> bytes:
    body = value.encode() + b"\0"
    return b"\0\1\0\0" + len(body).to_bytes(4, "little") + body


def string(topic: str, **kwargs):
    """Arguments of a topic of texts."""
    return {"topic": topic, "type_name": STRING, "message_definition": "string data\n", **kwargs}


@pytest.fixture
def bag(tmp_path):
    """A fast and a slow topic, and a latched one that changes at 1, 4 and 6 s."""
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        writer.add_topic(**string("/state", qos=LATCHED))
        for i in range(100):
            write_sample(writer, "/fast", (10 + i) * S // 10, float(i))
            if i % 10 == 0:
                write_sample(writer, "/slow", (10 + i) * S // 10, float(i))
            if i in (0, 30, 50):
                writer.write("/state", text(str(i)), log_ns=(10 + i) * S // 10)
    return path


def test_messages_come_by_log_time_though_the_files_overlap(tmp_path):
    rng = random.Random(7)
    times = [rng.randrange(10**9) for _ in range(3000)]
    for number in range(3):
        with BagWriter(tmp_path / f"part_{number}") as writer:
            for n, t in enumerate(times[number::3]):
                write_sample(writer, f"/t{n % 2}", t, float(number), log_ns=t)
                if n % 50 == 0:
                    writer.flush()  # which closes a chunk
    whole = tmp_path / "whole"
    whole.mkdir()
    for number in range(3):
        (mcap,) = (tmp_path / f"part_{number}").glob("*.mcap")
        mcap.rename(whole / f"whole_{number}.mcap")
    assert [m.log_ns for m in read_messages(whole, ["/t0", "/t1"])] == sorted(times)


def test_messages_of_one_time_keep_the_order_of_the_file(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(**string("/a"))
        writer.add_topic(**string("/b"))
        for n in range(200):
            writer.write(("/a", "/b")[n % 2], text(str(n)), log_ns=5)
            if n % 7 == 0:
                writer.flush()
    found = [m.data for m in read_messages(tmp_path / "bag", ["/a", "/b"])]
    assert found == [text(str(n)) for n in range(200)]


def test_a_part_has_both_its_ends(bag):
    found = [m.log_ns for m in read_messages(bag, ["/fast"], from_ns=2 * S, until_ns=3 * S)]
    assert found == [n * S // 10 for n in range(20, 31)]


@pytest.mark.parametrize("name", ["multiple_files", "wbag", "rewriter_b", "cdr_test"])
def test_every_message_of_a_recorder_comes_once(measured, name):
    path = measured / "rosbag2_bags" / name
    found = list(read_messages(path, [t.name for t in bag_topics(path)]))
    assert len(found) == bag_info(path).message_count
    assert [m.log_ns for m in found] == sorted(m.log_ns for m in found)
    if (path / "metadata.yaml").is_file():
        with Reader(path) as reader:
            assert sorted(bytes(data) for _, _, data in reader.messages()) == sorted(
                m.data for m in found
            )


def test_the_state_before_a_time_is_the_last_of_each_topic(bag):
    def state(at_ns: int, depth: int) -> list[bytes]:
        return [m.data for m in latched_before(bag, {"/state": depth}, at_ns)]

    assert state(1 * S, 2) == []
    assert state(4 * S, 1) == [text("0")]
    assert state(4 * S + 1, 1) == [text("30")]
    assert state(9 * S, 2) == [text("30"), text("50")]


def test_a_reel_goes_anywhere_and_takes_a_message_back(bag):
    reel = Reel(bag, bag_topics(bag, ["/fast", "/state"]), stretch(bag), stretch(bag))
    first, second = reel.take(), reel.take()
    reel.put_back()
    assert reel.take() == second != first
    reel.go(stretch(bag, offset_ns=5 * S))
    assert reel.next is not None
    assert reel.next.log_ns == 6 * S
    assert [m.data for m in reel.state_before(6 * S)] == [text("0"), text("30")]
    while reel.take() is not None:
        pass
    assert reel.next is None


@pytest.fixture
def lying(tmp_path):
    """A bag one of whose chunks states times too late, and the same without the lie."""
    truth = written("zstd-crc-2000", np.random.default_rng(0), tmp_path, 300)
    (tmp_path / "sound.mcap").write_bytes(truth.data)
    path = tmp_path / "lying.mcap"
    path.write_bytes(wrong_times(truth.data, np.random.default_rng(1), late_ns=100_000_000))
    forget()
    return path, tmp_path / "sound.mcap"


def play(path, told) -> list[BagMessage]:
    """Return what a reel gives, begun anew where it says so."""
    topics = bag_topics(path)
    try:
        reel = Reel(path, topics, stretch(path), stretch(path), told.append)
    except IndexLiesError:
        reel = Reel(path, topics, stretch(path), stretch(path), told.append)
    return list(iter(reel.take, None))


def test_a_bag_that_states_wrong_times_is_played_on_and_what_came_too_late_is_counted(lying):
    told: list[str] = []
    path, sound = lying
    played, all_of = play(path, told), play(sound, told)
    left_out = len(all_of) - len(played)
    assert left_out > 0
    assert [m for m in all_of if m in played] == played
    assert [f"{path}: {left_out} messages are not played: it states" in t for t in told] == [True]


def test_a_small_bag_that_states_wrong_times_is_played_whole(lying):
    told: list[str] = []
    path, sound = lying
    compare_small(path)
    assert play(path, told) == play(sound, told)
    assert not told


@pytest.mark.parametrize(
    ("choice", "left"),
    [
        (Choice(), ["/fast", "/slow", "/state"]),
        (Choice(topics=("fast",)), ["/fast"]),
        (Choice(regex="s"), ["/fast", "/slow", "/state"]),
        (Choice(regex="^/s"), ["/slow", "/state"]),
        (Choice(topics=("/fast",), regex="low"), ["/fast", "/slow"]),
        (Choice(exclude_topics=("/fast",)), ["/slow", "/state"]),
        (Choice(regex="^/s", exclude_regex="te$"), ["/slow"]),
    ],
)
def test_topics_are_chosen_by_name_and_expression(bag, choice, left):
    assert [t.name for t in bag_topics(bag, choice)] == left


def test_a_choice_that_cannot_be_is_told(bag):
    with pytest.raises(BagError, match=r"no topic '/fats'; did you mean '?/fast"):
        bag_topics(bag, ["/fats"])
    with pytest.raises(BagError, match="no topic is left to play; there are /fast, /slow, /state"):
        bag_topics(bag, Choice(exclude_regex="/"))
    with pytest.raises(ConfigError, match=r"'regex'.*no regular expression"):
        bag_topics(bag, Choice(regex="("))


def test_a_part_outside_the_bag_is_refused(bag):
    assert stretch(bag, offset_ns=S, duration_ns=2 * S).end_ns == 4 * S
    assert stretch(bag, duration_ns=5 * S, until_ns=3 * S).end_ns == 3 * S
    with pytest.raises(BagError, match=r"start offset 11 s is beyond its end; it lasts 9\.9 s"):
        stretch(bag, offset_ns=11 * S)
    with pytest.raises(BagError, match="nothing is left to play"):
        stretch(bag, until_ns=S // 2)


def test_new_names_are_read(bag):
    assert read_remaps(["/a:=/b", "c/d:=e"]) == {"/a": "/b", "/c/d": "/e"}
    for rule in ("/a", "/a:=", "/a:=/b c", "/a:=//b", "/a:=/1b"):
        with pytest.raises(ConfigError, match="write /old:=/new"):
            read_remaps([rule])


# -- what was offered


def test_numbers_and_words_of_any_recorder_are_read():
    assert read_offer("") == QosProfile()
    assert read_offer("no: list") == QosProfile()
    assert read_offer("[{") == QosProfile()
    numbers = "- {history: 3, depth: 0, reliability: 2, durability: 1, deadline: {nsec: 5}}"
    assert read_offer(numbers) == QosProfile(
        reliability="best_effort", durability="transient_local", deadline=5
    )
    words = "- {reliability: reliable, deadline: {sec: 9223372036, nsec: 854775807}}"
    assert read_offer(words).deadline == FOREVER_NS


def test_of_several_publishers_the_strongest_offer_serves_all():
    both = read_offer(
        "- {reliability: best_effort, durability: transient_local, depth: 1}\n"
        "- {reliability: reliable, durability: volatile, depth: 7}\n"
    )
    assert (both.reliability, both.durability, both.depth) == ("reliable", "transient_local", 7)


def test_policies_of_a_file_replace_what_was_recorded(tmp_path):
    path = tmp_path / "qos.yaml"
    path.write_text("/a:\n  reliability: best_effort\n  depth: 3\n  lifespan: {sec: 2}\n")
    found = override(QosProfile(durability="transient_local"), read_overrides(path)["/a"], "here")
    assert found == QosProfile("keep_last", 3, "best_effort", "transient_local", lifespan=2 * S)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("/a: {reliabilty: reliable}", "no policy 'reliabilty'; did you mean '?reliability"),
        ("/a: {durability: forever}", "durability cannot be 'forever'; write one of transient"),
        ("/a: {depth: -1}", "depth cannot be '-1'"),
        ("/a: {deadline: 3}", "write it as {sec: 1, nsec: 0}"),
        ("- /a", "is no map of topics"),
        ("{", "is no YAML"),
    ],
)
def test_a_wrong_file_of_policies_is_told(tmp_path, content, told):
    path = tmp_path / "qos.yaml"
    path.write_text(content)
    with pytest.raises(ConfigError, match=told):
        read_overrides(path)


# -- the types


def problem(path, **kwargs) -> str:
    with BagWriter(path) as writer:
        writer.add_topic("/x", **{"type_name": STRING, **kwargs})
        writer.write("/x", text("a"), log_ns=1)
    (topic,) = bag_topics(path)
    return topic.problem


def test_a_type_that_is_the_installed_one_is_played(tmp_path):
    assert problem(tmp_path / "full") == ""
    assert problem(tmp_path / "bare", definition_hash="") == ""
    assert problem(tmp_path / "own", type_name="valve_twin_msgs/msg/Estimate") == ""


@pytest.mark.parametrize(
    "definition", ["string[] data\n", "string text\n", "string data\nbool b\n"]
)
def test_bytes_of_another_definition_are_refused(tmp_path, definition):
    told = problem(tmp_path / "bag", message_definition=definition, definition_hash="")
    assert f"the bag's {STRING} (RIHS01_" in told
    assert "is not the installed one" in told


def test_a_hash_that_differs_is_refused_whatever_the_text_says(tmp_path):
    assert "is not the installed one" in problem(
        tmp_path / "bag", definition_hash="RIHS01_" + "0" * 64
    )


def test_a_type_that_nobody_defines_is_refused(tmp_path):
    for n, definition in enumerate(("?", "", "wstring data\n")):
        told = problem(tmp_path / str(n), message_definition=definition, definition_hash="")
        assert told == f"the bag holds no readable definition of {STRING}; record the topic anew"
    told = problem(tmp_path / "gone", type_name="no_msgs/msg/No", message_definition="int8 a\n")
    assert told == "message type no_msgs/msg/No is not installed; build its package and source it"


def test_files_that_give_a_topic_two_definitions_are_not_mixed_up(tmp_path):
    whole = tmp_path / "whole"
    whole.mkdir()
    for n, definition in enumerate(("string data\n", "string[] data\n")):
        with BagWriter(tmp_path / str(n)) as writer:
            writer.add_topic("/x", STRING, message_definition=definition, definition_hash="")
            writer.write("/x", text("a"), log_ns=n)
        (mcap,) = (tmp_path / str(n)).glob("*.mcap")
        mcap.rename(whole / f"whole_{n}.mcap")
    (topic,) = bag_topics(whole)
    assert "is not the installed one" in topic.problem
