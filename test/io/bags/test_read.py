# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import logging
import re
import shutil
import sqlite3
from contextlib import contextmanager

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as PeerWriter
from rosbags.typesys import Stores, get_typestore

from test.bag_samples import write_sample
from valve_twin.io.bags.definitions import definition
from valve_twin.io.bags.read import BagWriter, bag_info, bag_types, read_columns, read_signals
from valve_twin.io.bags.report import bag_report
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.mcap.reader import McapFile
from valve_twin.io.salvage.read import forget

START_NS = 1_577_836_800_000_000_000
COMMAND = SignalSource("command", "/press/command")
POSITION = SignalSource("position", "/press/position")
JAZZY = get_typestore(Stores.ROS2_JAZZY)


def joined(blocks, signal):
    """Return stamps and values of one signal."""
    mine = [b for b in blocks if b.signal == signal]
    return np.concatenate([b.stamp_ns for b in mine]), np.concatenate([b.values for b in mine])


def test_a_folder_a_metadata_file_and_an_mcap_file_give_the_same(small_bag):
    found = [
        [(b.signal, b.stamp_ns.tobytes(), b.values.tobytes()) for b in read_signals(p, [POSITION])]
        for p in (small_bag, small_bag / "metadata.yaml", small_bag / "small_0.mcap")
    ]
    assert found[0] == found[1] == found[2]


def test_values_come_in_stamp_order_with_scale_and_offset(small_bag):
    source = SignalSource("position", "/press/position", scale=2.0, offset=1.0)
    stamps, values = joined(list(read_signals(small_bag, [source])), "position")
    np.testing.assert_array_equal(stamps, START_NS + 1_000_000 + np.arange(1000) * 10_000_000)
    np.testing.assert_array_equal(values, -0.25 * np.arange(1000) * 2.0 + 1.0)


def test_blocks_of_all_signals_advance_together(small_bag):
    newest = {"command": 0, "position": 0}
    for block in read_signals(small_bag, [COMMAND, POSITION], slice_s=0.5):
        newest[block.signal] = int(block.stamp_ns[-1])
        assert block.stamp_ns[-1] - block.stamp_ns[0] <= 5e8
        assert min(newest.values()) == 0 or abs(newest["command"] - newest["position"]) <= 5.1e8


@pytest.mark.parametrize("slice_s", [0.01, 0.3, 1.0, 1e6])
def test_the_slice_does_not_change_the_samples(small_bag, slice_s):
    blocks = list(read_signals(small_bag, [COMMAND, POSITION], slice_s=slice_s))
    whole = list(read_signals(small_bag, [COMMAND, POSITION]))
    for signal in ("command", "position"):
        for a, b in zip(joined(blocks, signal), joined(whole, signal), strict=True):
            assert a.tobytes() == b.tobytes()


def test_two_signals_may_share_a_topic(small_bag):
    other = SignalSource("reference", "/press/command", scale=10.0)
    blocks = list(read_signals(small_bag, [COMMAND, other]))
    np.testing.assert_array_equal(
        joined(blocks, "reference")[1], joined(blocks, "command")[1] * 10.0
    )


@given(
    st.lists(
        st.tuples(st.floats(), st.sampled_from(["", "a", "long name"])), min_size=1, max_size=40
    ),
    st.integers(1, 400),
)
def test_round_trip_of_any_values_and_frame_names(tmp_path_factory, rows, chunk):
    path = tmp_path_factory.mktemp("bags") / "bag"
    with BagWriter(path, chunk_size=chunk) as bag:
        bag.add_topic("/a", STAMPED_TYPE)
        for i, (value, name) in enumerate(rows):
            stamp = START_NS + i
            bag.write("/a", encode_stamped(stamp, value, name), log_ns=stamp)
    stamps, values = joined(list(read_signals(path, [SignalSource("a", "/a")])), "a")
    np.testing.assert_array_equal(stamps, START_NS + np.arange(len(rows)))
    assert values.tobytes() == np.array([v for v, _ in rows]).tobytes()


@given(st.lists(st.lists(st.floats(), max_size=6), min_size=1, max_size=12))
def test_round_trip_of_batches_of_any_length(tmp_path_factory, batches):
    path = tmp_path_factory.mktemp("bags") / "bag"
    with BagWriter(path) as bag:
        for i, values in enumerate(batches):
            bag.write_series("/a", START_NS + i * 10**9, 0.1, np.array(values, dtype=float))
    source = SignalSource("a", "/a", SERIES_TYPE, "values[]")
    blocks = list(read_signals(path, [source]))
    expected = np.array([v for values in batches for v in values], dtype=float)
    found = joined(blocks, "a")[1] if blocks else np.empty(0)
    assert found.tobytes() == expected.tobytes()


def test_messages_without_a_stamp_take_the_log_time(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        write_sample(bag, "/a", 0, 1.0, log_ns=77)
    (block,) = read_signals(tmp_path / "bag", [SignalSource("a", "/a")])
    assert (block.stamp_ns.tolist(), block.has_header) == ([77], False)


def test_overlapping_files_are_merged_in_log_order(tmp_path):
    folder = tmp_path / "merged"
    folder.mkdir()
    for part in (0, 1):
        with BagWriter(tmp_path / f"part{part}") as bag:
            for i in range(part, 3000, 2):
                write_sample(bag, "/press/position", START_NS + i * 10**6, float(i))
        shutil.copy(tmp_path / f"part{part}" / f"part{part}_0.mcap", folder)
    _, values = joined(list(read_signals(folder, [POSITION])), "position")
    np.testing.assert_array_equal(values, np.arange(3000.0))
    assert bag_info(folder).message_count == 3000


def peer_bag(path, type_name, messages):
    """Write messages with rosbags."""
    with PeerWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/topic", type_name, typestore=JAZZY)
        for stamp, message in messages:
            writer.write(connection, stamp, JAZZY.serialize_cdr(message, type_name))
    return path


def joint_state(i):
    kinds = JAZZY.types
    stamp = kinds["builtin_interfaces/msg/Time"](1_600_000_000, i)
    header = kinds["std_msgs/msg/Header"](stamp, "")
    values = np.array([0.0, 1.0 * i])
    return kinds["sensor_msgs/msg/JointState"](header, ["a", "b"], values, values, values)


def test_decodes_types_that_are_not_ours_with_the_bags_definitions(tmp_path):
    path = peer_bag(
        tmp_path / "bag",
        "sensor_msgs/msg/JointState",
        [(10 + i, joint_state(i)) for i in range(50)],
    )
    source = SignalSource("a", "/topic", "sensor_msgs/msg/JointState", "position[1]")
    stamps, values = joined(list(read_signals(path, [source])), "a")
    np.testing.assert_array_equal(stamps, 1_600_000_000 * 10**9 + np.arange(50))
    np.testing.assert_array_equal(values, np.arange(50.0))


def test_a_type_is_read_as_the_bag_defines_it(tmp_path):
    changed = definition(STAMPED_TYPE).replace("float64 value", "float64 before\nfloat64 value")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", STAMPED_TYPE, message_definition=changed, definition_hash="RIHS01_1")
        data = encode_stamped(START_NS, 1.0) + np.float64(2.0).tobytes()
        bag.write("/a", data, log_ns=START_NS)
    (block,) = read_signals(tmp_path / "bag", [SignalSource("a", "/a")])
    assert block.values.tolist() == [2.0]


STORAGE = [
    {"compression": CompressionType.NONE},
    {"compression": CompressionType.LZ4},
    {"compression": CompressionType.ZSTD, "index_types": IndexType.NONE},
    {"use_chunking": False},
    {"use_chunking": False, "use_statistics": False, "repeat_channels": False},
    {"index_types": IndexType.CHUNK, "use_statistics": False},
    {"use_statistics": False, "index_types": IndexType.NONE, "repeat_schemas": False},
]


@pytest.mark.parametrize("storage", STORAGE, ids=str)
def test_reads_every_way_to_store(tmp_path, storage):
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=2000, **storage)
        writer.start("ros2", "test")
        schema = writer.register_schema(STAMPED_TYPE, "ros2msg", definition(STAMPED_TYPE).encode())
        channel = writer.register_channel("/press/position", "cdr", schema)
        for i in range(200):
            stamp = START_NS + i
            writer.add_message(channel, stamp, encode_stamped(stamp, float(i)), stamp)
        writer.finish()
    stamps, values = joined(list(read_signals(path, [POSITION])), "position")
    np.testing.assert_array_equal(values, np.arange(200.0))
    np.testing.assert_array_equal(stamps, START_NS + np.arange(200))


def test_says_what_a_bag_holds(small_bag):
    info = bag_info(small_bag)
    assert (info.message_count, info.start_ns) == (2000, START_NS)
    assert info.duration_s == pytest.approx(9.991)
    assert [(t.name, t.type, t.count) for t in info.topics] == [
        ("/press/command", STAMPED_TYPE, 1000),
        ("/press/position", STAMPED_TYPE, 1000),
    ]
    assert info.custom == {"valve": "/press/valve_1", "serial": "4711"}
    assert info.size == (small_bag / "small_0.mcap").stat().st_size
    assert bag_info(small_bag / "small_0.mcap").custom == info.custom


def test_gives_the_types_of_a_topic(small_bag):
    fields = bag_types(small_bag, "/press/command").fields(STAMPED_TYPE)
    assert list(fields) == ["header", "value"]


# -- what cannot be read: one line with the file, the topic and what to do


def refused(path, sources=(POSITION,), kind=BagError):
    with pytest.raises(kind) as caught:
        list(read_signals(path, list(sources)))
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_a_missing_topic_is_named_with_those_that_are_there(small_bag):
    text = refused(small_bag, [SignalSource("position", "/press/positon")])
    assert "small: topic '/press/positon' of signal 'position' is not in the bag" in text
    assert "did you mean '/press/position'? there are /press/command, /press/position" in text


def test_a_topic_without_messages_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/press/position", STAMPED_TYPE)
    assert "topic '/press/position' of signal 'position' has no messages" in refused(
        tmp_path / "bag"
    )


def test_a_wrong_type_is_named_with_the_right_one(small_bag):
    source = SignalSource(
        "position", "/press/position", "sensor_msgs/msg/JointState", "position[0]"
    )
    text = refused(small_bag, [source])
    assert f"is of type {STAMPED_TYPE}, not sensor_msgs/msg/JointState" in text
    assert f"write signals.position.type: {STAMPED_TYPE}" in text


def test_a_wrong_field_is_named_with_the_nearest(small_bag):
    source = SignalSource("position", "/press/position", STAMPED_TYPE, "valeu")
    text = refused(small_bag, [source], ConfigError)
    assert "small_0.mcap: signal 'position', topic '/press/position'" in text
    assert "has no field 'valeu'; did you mean 'value'?" in text


def test_nothing_there_is_named(tmp_path):
    assert "no such file; give a bag folder" in refused(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    assert "holds no .mcap file" in refused(tmp_path / "empty")


def test_an_empty_file_is_named(tmp_path):
    (tmp_path / "a.mcap").touch()
    assert "a.mcap: the file is empty; nothing was recorded" in refused(tmp_path / "a.mcap")


def test_foreign_files_are_named_with_the_way_to_convert_them(tmp_path):
    database = sqlite3.connect(tmp_path / "a.db3")
    database.execute("create table t (x)")
    database.close()
    assert "a SQLite bag; convert it" in refused(tmp_path / "a.db3")
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    assert "a ROS 1 bag; convert it" in refused(tmp_path / "a.bag")
    (tmp_path / "a.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    assert "is no MCAP file; give a bag" in refused(tmp_path / "a.csv")


def test_a_metadata_file_of_another_storage_is_named(small_bag):
    path = small_bag / "metadata.yaml"
    text = path.read_text(encoding="utf-8").replace("identifier: mcap", "identifier: sqlite3")
    path.write_text(text, encoding="utf-8")
    assert "storage 'sqlite3' is not read; convert it" in refused(small_bag)


def test_files_are_found_without_a_readable_metadata_file(small_bag, caplog):
    sound = joined(list(read_signals(small_bag, [POSITION])), "position")
    path = small_bag / "metadata.yaml"
    path.write_text("nothing: here\n", encoding="utf-8")
    found = joined(list(read_signals(small_bag, [POSITION])), "position")
    np.testing.assert_array_equal(found, sound)
    assert "is no metadata.yaml of a ROS 2 bag" in caplog.text
    (small_bag / "small_0.mcap").unlink()
    assert "is no metadata.yaml of a ROS 2 bag; give the .mcap file" in refused(small_bag)


def noted(path, caplog):
    """Return what report and reading say of a bag that holds all that the sound one does."""
    caplog.clear()
    columns = read_columns(path, [POSITION])
    report = bag_report(path, verify=True)
    assert report["damaged"]
    (note,) = report["notes"]
    assert caplog.text.count(note) == 1
    return note, len(columns[0].values), report["messages"]


def change_metadata(bag, before, after):
    path = bag / "metadata.yaml"
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")


def test_a_file_that_metadata_names_twice_is_read_once_and_told(small_bag, caplog):
    report, (column,) = bag_report(small_bag), read_columns(small_bag, [POSITION])
    change_metadata(small_bag, "- small_0.mcap\n", "- small_0.mcap\n  - ./small_0.mcap\n")
    note, count, messages = noted(small_bag, caplog)
    assert note.endswith("metadata.yaml: names small_0.mcap twice; it is read once")
    assert (count, messages) == (len(column.values), report["messages"])


def test_two_files_of_one_name_in_two_folders_are_two(small_bag, caplog):
    whole = read_columns(small_bag, [POSITION])[0]
    data = (small_bag / "small_0.mcap").read_bytes()
    (small_bag / "small_0.mcap").unlink()
    for place in ("x", "y"):
        (small_bag / place).mkdir()
        (small_bag / place / "a.mcap").write_bytes(data)
    path = small_bag / "metadata.yaml"
    text = path.read_text().replace("- small_0.mcap", "- x/a.mcap\n  - y/a.mcap")
    path.write_text(re.sub("(?<=message_count: )([0-9]+)", lambda m: str(2 * int(m[0])), text))
    report = bag_report(small_bag, verify=True)
    assert (report["damaged"], report["files"]) == (False, ["x/a.mcap", "y/a.mcap"])
    assert len(read_columns(small_bag, [POSITION])[0]) == 2 * len(whole)
    assert caplog.text == ""
    path.write_text(path.read_text().replace("- y/a.mcap", "- y/a.mcap\n  - x/a.mcap"))
    (note,) = bag_report(small_bag)["notes"]
    assert note.endswith("metadata.yaml: names x/a.mcap twice; it is read once")


def test_a_file_that_metadata_does_not_name_is_left_out_and_told(small_bag, caplog):
    report = bag_report(small_bag)
    shutil.copy(small_bag / "small_0.mcap", small_bag / "small_1.mcap")
    note, _, messages = noted(small_bag, caplog)
    assert note.endswith("metadata.yaml: does not name small_1.mcap, which is left out")
    assert messages == report["messages"]


@pytest.mark.parametrize("more", [-1, 3])
def test_metadata_that_counts_otherwise_than_its_files_is_told(small_bag, more, caplog):
    report = bag_report(small_bag)
    count = next(t["count"] for t in report["topics"] if t["name"] == POSITION.topic)
    path = small_bag / "metadata.yaml"
    found = yaml.safe_load(path.read_text(encoding="utf-8"))
    for entry in found["rosbag2_bagfile_information"]["topics_with_message_count"]:
        if entry["topic_metadata"]["name"] == POSITION.topic:
            entry["message_count"] += more
    path.write_text(yaml.safe_dump(found), encoding="utf-8")
    note, seen, messages = noted(small_bag, caplog)
    assert f"counts {count + more} messages of {POSITION.topic}, its files hold {count}" in note
    assert (seen, messages) == (count, report["messages"])


def test_statistics_that_count_no_channel_contradict_nobody(tmp_path, caplog):
    """A writer of MCAP may leave the counts of the channels out."""
    topic = {"name": "/a", "type": "std_msgs/msg/Float64", "serialization_format": "cdr"}
    with (tmp_path / "bag_0.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/a", "cdr", schema)
        for i in range(5):
            writer.add_message(channel, i * 1000, b"\0\1\0\0" + bytes(8), i * 1000)
        vars(writer)["_Writer__statistics"].channel_message_counts.clear()
        writer.finish()
    about = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": ["bag_0.mcap"],
        "message_count": 5,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 5}],
    }
    text = yaml.safe_dump({"rosbag2_bagfile_information": about})
    (tmp_path / "metadata.yaml").write_text(text, encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        (held,) = bag_info(tmp_path).topics
    assert held.count == -1
    assert "counts" not in caplog.text


@pytest.mark.parametrize("keep", [1, 8, 20])
def test_a_file_cut_before_its_first_message_is_named(small_bag, keep):
    path = small_bag / "small_0.mcap"
    path.write_bytes(path.read_bytes()[:keep])
    text = refused(small_bag)
    assert "small_0.mcap" in text
    assert "was cut after" in text or "is no MCAP file" in text


@pytest.mark.parametrize("keep", [0.3, 0.9, 0.999])
def test_a_cut_file_gives_what_is_intact_and_says_what_is_lost(small_bag, keep, caplog):
    _, sound = joined(list(read_signals(small_bag, [POSITION])), "position")
    path = small_bag / "small_0.mcap"
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    _, values = joined(list(read_signals(small_bag, [POSITION])), "position")
    np.testing.assert_array_equal(values, sound[: len(values)])
    assert 0 < len(values) <= len(sound)
    lost = f"/press/position ({len(sound) - len(values)})"
    assert (lost in caplog.text) == (len(values) < len(sound))
    assert "small_0.mcap: byte " in caplog.text


@pytest.fixture(scope="module")
def whole_file(tmp_path_factory):
    """Return the path of a sound file with 200 positions in four chunks, and its bytes."""
    path = tmp_path_factory.mktemp("bags") / "bag"
    with BagWriter(path) as bag:
        for i in range(200):
            write_sample(bag, "/press/position", START_NS + i, float(i))
            if i % 50 == 49:
                bag.flush()
    file = path / "bag_0.mcap"
    return file, file.read_bytes()


@settings(max_examples=300)
@given(st.integers(0, 2**31), st.integers(1, 255))
def test_a_flipped_byte_is_told_or_changes_nothing(whole_file, place, flip):
    path, sound = whole_file
    data = bytearray(sound)
    data[place % len(data)] ^= flip
    path.write_bytes(data)
    forget()
    with told() as lines:
        _, values = joined(list(read_signals(path, [POSITION])), "position")
    assert not set(values.tolist()) - set(np.arange(200.0).tolist())
    assert len(values) >= 150
    assert len(values) == 200 or any(f"lost: {200 - len(values)} messages" in x for x in lines)


@contextmanager
def told():
    """Collect what is said on the log."""
    lines: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: lines.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("valve_twin")
    logger.addHandler(handler)
    try:
        yield lines
    finally:
        logger.removeHandler(handler)


def test_messages_that_do_not_fit_their_type_are_named(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/press/position", STAMPED_TYPE)
        bag.write("/press/position", b"\0\1\0\0\1\2", log_ns=99)
    text = refused(tmp_path / "bag")
    assert "topic '/press/position': the message at log time 99 ns is no valid" in text


def test_a_file_that_lacks_messages_of_its_summary_is_named(tmp_path, caplog):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "test")
        schema = writer.register_schema(STAMPED_TYPE, "ros2msg", definition(STAMPED_TYPE).encode())
        channel = writer.register_channel("/press/position", "cdr", schema)
        for i in range(3):
            writer.add_message(channel, 1 + i, encode_stamped(START_NS + i, 0.0), 1)
        counts = vars(writer)["_Writer__statistics"]
        counts.channel_message_counts[channel] = counts.message_count = 5
        writer.finish()
    stamps, _ = joined(read_signals(path, [POSITION]), "position")
    assert len(stamps) == 3
    assert str(path) in caplog.text
    assert "once held 2 more" in caplog.text


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("repeated", [True, False])
@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE], ids=["indexed", "bare"])
def test_what_a_writer_leaves_out_of_the_summary_is_no_damage(
    tmp_path, caplog, chunked, repeated, index
):
    path = tmp_path / "sparse.mcap"
    for count in (0, 300):
        with path.open("wb") as file:
            writer = Writer(file, index_types=index, use_chunking=chunked, repeat_schemas=repeated)
            writer.start("ros2", "test")
            schema = writer.register_schema(
                STAMPED_TYPE, "ros2msg", definition(STAMPED_TYPE).encode()
            )
            channel = writer.register_channel("/press/position", "cdr", schema)
            for n in range(count):
                stamp = START_NS + n * 10_000_000
                writer.add_message(channel, stamp, encode_stamped(stamp, 0.5), stamp)
            writer.finish()
        forget()
        info = bag_info(path)
        assert info.message_count == count
        if count:
            (found,) = read_columns(path, [POSITION])
            assert len(found) == count
            assert not bag_report(path, verify=True)["damaged"]
            assert McapFile(path).is_sound
    assert caplog.text == ""
