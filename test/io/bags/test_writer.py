# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import os
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.records import Header, Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from test.bag_samples import write_sample
from valve_twin.io.bags.definitions import definition, type_hash
from valve_twin.io.bags.qos import QosProfile
from valve_twin.io.bags.rolling import SplitRule
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.errors import BagError

START_NS = 1_577_836_800_000_000_000
ROOT_KEY = "rosbag2_bagfile_information"


def value_of(message: Any) -> float:
    return float(message.value)


def test_rosbags_reads_every_message(small_bag):
    with AnyReader([small_bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        values = [
            (stamp, value_of(reader.deserialize(raw, c.msgtype)))
            for c, stamp, raw in reader.messages()
            if c.topic == "/press/position"
        ]
    assert counts == {"/press/command": 1000, "/press/position": 1000}
    assert values == [(START_NS + 1_000_000 + i * 10_000_000, -0.25 * i) for i in range(1000)]


def test_mcap_reads_summary_index_and_checksums(small_bag):
    with (small_bag / "small_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages(topics=["/press/command"]))
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 2000
    assert {c.compression for c in summary.chunk_indexes} == {"zstd"}
    assert max(c.uncompressed_size for c in summary.chunk_indexes) < 64 * 1024 + 1024
    assert [m.sequence for _, _, m in messages] == list(range(1, 1001))


def test_metadata_is_what_the_jazzy_recorder_writes(small_bag):
    content = yaml.safe_load((small_bag / "metadata.yaml").read_text(encoding="utf-8"))[ROOT_KEY]
    assert (content["version"], content["storage_identifier"]) == (9, "mcap")
    assert content["message_count"] == 2000
    assert content["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert content["duration"]["nanoseconds"] == 999 * 10_000_000 + 1_000_000
    assert content["relative_file_paths"] == ["small_0.mcap"]
    assert content["custom_data"] == {"valve": "/press/valve_1", "serial": "4711"}
    topic = content["topics_with_message_count"][0]["topic_metadata"]
    assert topic["type_description_hash"] == type_hash(STAMPED_TYPE)
    assert topic["offered_qos_profiles"][0]["reliability"] == "reliable"


def test_channels_carry_definition_and_offered_qos(tmp_path):
    latched = QosProfile(durability="transient_local", depth=1)
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", STAMPED_TYPE, qos=(latched,))
        write_sample(bag, "/a", START_NS, 1.0)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    (schema,), (channel,) = summary.schemas.values(), summary.channels.values()
    assert (schema.name, schema.encoding) == (STAMPED_TYPE, "ros2msg")
    assert schema.data.decode() == definition(STAMPED_TYPE)
    (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert (profile["durability"], profile["depth"]) == ("transient_local", 1)
    assert channel.metadata["topic_type_hash"] == type_hash(STAMPED_TYPE)


def test_raw_bytes_of_other_types_are_kept(tmp_path):
    data = b"\0\1\0\0" + (5).to_bytes(4, "little") + b"text\0"
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/chatter", "std_msgs/msg/String")
        bag.write("/chatter", data, log_ns=20, publish_ns=10)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        ((_, _, message),) = make_reader(stream).iter_messages()
    assert (message.data, message.log_time, message.publish_time) == (data, 20, 10)


def test_a_foreign_definition_is_embedded_as_given(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/x", "my_msgs/msg/X", message_definition="float64 x\n")
        bag.write("/x", b"\0\1\0\0" + bytes(8), log_ns=1)
    with AnyReader([tmp_path / "bag"]) as reader:
        ((connection, _, raw),) = reader.messages()
        message: Any = reader.deserialize(raw, connection.msgtype)
        assert message.x == 0.0


def test_flushes_and_syncs_at_least_once_a_second(tmp_path):
    now, synced = [0.0], []
    bag = BagWriter(
        tmp_path / "bag",
        clock=lambda: now[0],
        sync=lambda number: synced.append(os.fstat(number).st_size),
    )
    sizes = []
    for i in range(50):
        now[0] = 0.1 * i
        write_sample(bag, "/a", START_NS + i, float(i))
        sizes.append(len(synced))
    assert sizes[10] >= 1
    assert np.diff(sizes[:50:10]).min() >= 1
    assert synced == sorted(synced)
    bag.close()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        assert isinstance(next(iter(StreamReader(stream).records)), Header)


def test_what_was_flushed_is_readable_without_close(tmp_path):
    bag = BagWriter(tmp_path / "bag", flush_s=0.0)
    for i in range(20):
        write_sample(bag, "/a", START_NS + i, float(i))
    found: list[int] = []
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        records = iter(StreamReader(stream).records)
        while len(found) < 20:
            record = next(records)
            if isinstance(record, Message):
                found.append(record.log_time)
    bag.close()
    assert found == [START_NS + i for i in range(20)]


def test_an_empty_bag_is_a_bag(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", STAMPED_TYPE)
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 0


def test_closing_twice_does_nothing(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.close()
    before = (tmp_path / "bag" / "metadata.yaml").stat().st_mtime_ns
    bag.close()
    assert (tmp_path / "bag" / "metadata.yaml").stat().st_mtime_ns == before


def test_what_was_written_survives_an_error_of_the_caller(tmp_path):
    def fail():
        with BagWriter(tmp_path / "bag") as bag:
            write_sample(bag, "/a", START_NS, 1.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 1


def test_an_existing_folder_is_refused(small_bag):
    with pytest.raises(BagError, match=r"small: exists already; give a new folder or remove it"):
        BagWriter(small_bag)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("x", encoding="utf-8")
    with pytest.raises(BagError, match=r"file/bag: cannot be written: Not a directory: check"):
        BagWriter(tmp_path / "file" / "bag")


def test_a_full_disk_is_named_and_keeps_what_is_written(tmp_path):
    def full(_number):
        raise OSError(28, "No space left on device")

    bag = BagWriter(tmp_path / "bag", flush_s=0.0, sync=full)
    with pytest.raises(BagError, match=r"bag_0.mcap: cannot be written: No space left on device"):
        write_sample(bag, "/a", START_NS, 1.0)
    with pytest.raises(BagError, match="free some space"):
        bag.close()


def test_a_topic_that_was_not_added_is_named(tmp_path):
    with (
        BagWriter(tmp_path / "bag") as bag,
        pytest.raises(BagError, match="topic '/a' was not added"),
    ):
        bag.write("/a", b"", log_ns=1)


def test_a_second_type_on_a_topic_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_sample(bag, "/a", START_NS, 1.0)
        with pytest.raises(BagError, match=r"topic '/a' is of type .*Stamped, not .*Series"):
            bag.write_series("/a", START_NS, 0.1, np.zeros(2))


def test_an_undefined_type_is_named(tmp_path):
    with (
        BagWriter(tmp_path / "bag") as bag,
        pytest.raises(
            BagError, match="nowhere_msgs/msg/X is defined nowhere; install its package"
        ),
    ):
        bag.add_topic("/a", "nowhere_msgs/msg/X")


def split_bag(path, rule, count=100, **options):
    """Write a bag of two topics, a message each every 10 ms."""
    with BagWriter(path, split=rule, chunk_size=512, **options) as bag:
        for i in range(count):
            write_sample(bag, "/a", START_NS + i * 10_000_000, float(i))
            write_sample(bag, "/b", START_NS + i * 10_000_000, float(-i))
    return yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))[ROOT_KEY]


@pytest.mark.parametrize(
    ("rule", "files"),
    [(SplitRule(duration_s=0.3), 4), (SplitRule(size=3000), None), (SplitRule(duration_s=5.0), 1)],
)
def test_a_split_bag_is_read_as_one_by_rosbags_and_file_by_file_by_mcap(tmp_path, rule, files):
    content = split_bag(tmp_path / "bag", rule)
    names = content["relative_file_paths"]
    assert names == [f"bag_{i}.mcap" for i in range(len(names))]
    assert len(names) == files if files else len(names) > 2
    with AnyReader([tmp_path / "bag"]) as reader:
        found = [(c.topic, t) for c, t, _ in reader.messages()]
    assert [t for c, t in found if c == "/a"] == [START_NS + i * 10_000_000 for i in range(100)]
    assert len(found) == content["message_count"] == 200
    for name, entry in zip(names, content["files"], strict=True):
        with (tmp_path / "bag" / name).open("rb") as stream:
            alone_reader = make_reader(stream, validate_crcs=True)
            times = [m.log_time for _, _, m in alone_reader.iter_messages()]
            (own,) = (m for m in alone_reader.iter_metadata() if m.name == "rosbag2")
        assert entry["path"] == name
        assert entry["message_count"] == len(times)
        assert entry["starting_time"]["nanoseconds_since_epoch"] == times[0]
        assert entry["duration"]["nanoseconds"] == times[-1] - times[0]
        alone = yaml.safe_load(own.metadata["serialized_metadata"])[ROOT_KEY]
        assert (alone["relative_file_paths"], alone["message_count"]) == ([name], len(times))
        if rule.size:
            # beside the messages a chunk, and the summary with definitions and metadata
            assert (tmp_path / "bag" / name).stat().st_size < rule.size + 6000


def test_the_last_files_are_kept_and_the_metadata_stay_true(tmp_path):
    content = split_bag(tmp_path / "bag", SplitRule(duration_s=0.1, keep=3))
    left = ["bag_7.mcap", "bag_8.mcap", "bag_9.mcap"]
    assert sorted(p.name for p in (tmp_path / "bag").glob("*.mcap")) == left
    assert content["relative_file_paths"] == left
    assert content["message_count"] == 60
    assert [t["message_count"] for t in content["topics_with_message_count"]] == [30, 30]
    assert content["starting_time"]["nanoseconds_since_epoch"] == START_NS + 70 * 10_000_000
    with AnyReader([tmp_path / "bag"]) as reader:
        assert sum(1 for _ in reader.messages()) == 60


def test_metadata_list_the_running_file_while_it_is_written(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    write_sample(bag, "/a", START_NS, 1.0)
    assert bag.split() == ("bag_0.mcap", "bag_1.mcap")
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text(encoding="utf-8"))
    assert content[ROOT_KEY]["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    bag.close()
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text(encoding="utf-8"))
    assert content[ROOT_KEY]["relative_file_paths"] == ["bag_0.mcap"]
    assert not (tmp_path / "bag" / "bag_1.mcap").exists()


def test_a_file_without_a_message_is_not_split(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        assert bag.split() == ("bag_0.mcap", "bag_0.mcap")


def test_every_policy_that_is_offered_is_stored(tmp_path):
    offered = QosProfile("keep_all", 3, "best_effort", "volatile", deadline=1_500_000_000)
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", STAMPED_TYPE, qos=(offered,))
        write_sample(bag, "/a", START_NS, 1.0)
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text(encoding="utf-8"))
    (topic,) = content[ROOT_KEY]["topics_with_message_count"]
    (profile,) = topic["topic_metadata"]["offered_qos_profiles"]
    assert profile["deadline"] == {"sec": 1, "nsec": 500_000_000}
    assert profile["lifespan"] == {"sec": 9223372036, "nsec": 854775807}
    assert (profile["reliability"], profile["history"]) == ("best_effort", "keep_all")
