# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled walk gives what the general decoder gives, to the last bit, for any bag."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from valve_twin.io.bags import signals as bag_signals
from valve_twin.io.bags.definitions import definition
from valve_twin.io.bags.read import BagWriter, read_columns
from valve_twin.io.cdr import columns_kernel
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.errors import BagError
from valve_twin.io.mcap import reader

START_NS = 1_577_836_800_000_000_000
TOPIC = "/a"
MIXED_TYPE = "test_msgs/msg/Mixed"
MIXED = """
bool flag
std_msgs/Header header
uint8 small
string[2] pair
int16 short
string[] names
float32[3] fixed
int64 large
uint8[] bytes
uint16 word
float64[] values
int32[] whole
float32 single
geometry_msgs/Point[2] corners
char tail
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
"""
FIELDS = [
    "flag", "small", "short", "fixed[0]", "fixed[2]", "large", "bytes[0]", "bytes[3]", "word",
    "values[0]", "values[2]", "whole[1]", "single", "corners[1].y", "corners[0].z", "tail",
]  # fmt: skip
JAZZY = get_typestore(Stores.ROS2_JAZZY)
JAZZY.register(get_types_from_msg(MIXED.strip(), MIXED_TYPE))
NAMES = st.lists(st.sampled_from(["", "a", "valve", "longer name", "äöü"]), max_size=4)
FLOAT32 = st.floats(width=32)


def both(monkeypatch, path, sources):
    """Return what the compiled walk reads and what the general decoder reads."""
    found = []
    for compiled in (True, False):
        monkeypatch.setattr(bag_signals, "pays", lambda _, answer=compiled: answer)
        found.append(read_columns(path, sources))
    return found


def require_same(found):
    for ours, general in zip(*found, strict=True):
        assert ours.log_ns.tobytes() == general.log_ns.tobytes()
        assert ours.stamp_ns.tobytes() == general.stamp_ns.tobytes()
        assert ours.values.tobytes() == general.values.tobytes()
        assert ours.stamped.tobytes() == general.stamped.tobytes()


def write(path, type_name, text, messages, chunk=300):
    """Write messages of one type, log times as given."""
    with BagWriter(path, chunk_size=chunk) as bag:
        bag.add_topic(TOPIC, type_name, message_definition=text, definition_hash="RIHS01_1")
        for log_ns, data in messages:
            bag.write(TOPIC, data, log_ns=log_ns)
    return path


@st.composite
def mixed_messages(draw):
    kinds = JAZZY.types
    stamp = kinds["builtin_interfaces/msg/Time"](
        draw(st.integers(-5, 2**31 - 1)), draw(st.integers(0, 10**9 - 1))
    )
    point = kinds["geometry_msgs/msg/Point"]
    message = kinds[MIXED_TYPE](
        draw(st.booleans()),
        kinds["std_msgs/msg/Header"](stamp, draw(st.text("abc", max_size=9))),
        draw(st.integers(0, 255)),
        [draw(st.text("xy", max_size=5)) for _ in range(2)],
        draw(st.integers(-(2**15), 2**15 - 1)),
        draw(NAMES),
        np.array([draw(FLOAT32) for _ in range(3)], dtype=np.float32),
        draw(st.integers(-(2**63), 2**63 - 1)),
        np.array(draw(st.lists(st.integers(0, 255), max_size=9)), dtype=np.uint8),
        draw(st.integers(0, 2**16 - 1)),
        np.array(draw(st.lists(st.floats(), max_size=4)), dtype=np.float64),
        np.array(draw(st.lists(st.integers(-9, 9), max_size=3)), dtype=np.int32),
        draw(FLOAT32),
        [point(draw(st.floats()), 1.5, draw(st.floats())) for _ in range(2)],
        draw(st.integers(0, 255)),
    )
    order = draw(st.sampled_from([True, True, True, False]))
    return bytes(JAZZY.serialize_cdr(message, MIXED_TYPE, little_endian=order))


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 2**62), mixed_messages()), min_size=1, max_size=12))
def test_any_field_of_any_message_is_read_as_by_the_general_decoder(tmp_path_factory, messages):
    path = write(tmp_path_factory.mktemp("bags") / "bag", MIXED_TYPE, MIXED.strip(), messages)
    sources = [SignalSource(f, TOPIC, MIXED_TYPE, f, scale=0.5, offset=2.0) for f in FIELDS]
    with pytest.MonkeyPatch.context() as patch:
        require_same(both(patch, path, sources))


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([0, START_NS, START_NS + 7]),
            st.sampled_from([0.03, 1e-9, 0.0, -1.0, float("nan"), float("inf"), 1e307]),
            st.lists(st.floats(), max_size=7),
            st.sampled_from(["", "a", "long name"]),
        ),
        min_size=1,
        max_size=15,
    )
)
def test_batches_are_read_as_by_the_general_decoder(tmp_path_factory, rows):
    messages = [
        (START_NS + i, encode_series(stamp, period, np.array(values), name))
        for i, (stamp, period, values, name) in enumerate(rows)
    ]
    path = tmp_path_factory.mktemp("bags") / "bag"
    write(path, SERIES_TYPE, definition(SERIES_TYPE), messages)
    source = SignalSource("a", TOPIC, SERIES_TYPE, "values[]", scale=2.0)
    with pytest.MonkeyPatch.context() as patch:
        require_same(both(patch, path, [source]))


def test_every_numeric_kind_takes_the_compiled_way(tmp_path, monkeypatch):
    kinds = JAZZY.types
    stamp = kinds["builtin_interfaces/msg/Time"](1, 2)
    corner = kinds["geometry_msgs/msg/Point"](1.0, 2.0, 3.0)
    message = kinds[MIXED_TYPE](
        flag=True,
        header=kinds["std_msgs/msg/Header"](stamp, "f"),
        small=1,
        pair=["", ""],
        short=-2,
        names=["n"] * 5,
        fixed=np.arange(3, dtype=np.float32),
        large=-3,
        bytes=np.arange(9, dtype=np.uint8),
        word=4,
        values=np.arange(3.0),
        whole=np.arange(3, dtype=np.int32),
        single=5.0,
        corners=[corner, corner],
        tail=6,
    )
    data = bytes(JAZZY.serialize_cdr(message, MIXED_TYPE))
    path = write(tmp_path / "bag", MIXED_TYPE, MIXED.strip(), [(1 + i, data) for i in range(20)])
    monkeypatch.setattr(bag_signals, "pays", lambda _: True)
    monkeypatch.setattr(bag_signals, "_decode", None)
    found = read_columns(path, [SignalSource(f, TOPIC, MIXED_TYPE, f) for f in FIELDS])
    expected = [1, 1, -2, 0, 2, -3, 0, 3, 4, 0, 2, 1, 5, 2, 3, 6]
    assert [set(c.values.tolist()) for c in found] == [{float(v)} for v in expected]
    assert {len(c) for c in found} == {20}


def test_messages_of_many_sizes_are_read_as_by_the_general_decoder(tmp_path, monkeypatch):
    rng = np.random.default_rng(1)
    messages = [
        (START_NS + i, encode_stamped(START_NS + i, float(v), "n" * int(n)))
        for i, (v, n) in enumerate(
            zip(rng.normal(size=3000), rng.integers(0, 90, 3000), strict=True)
        )
    ]
    path = write(tmp_path / "bag", STAMPED_TYPE, definition(STAMPED_TYPE), messages, chunk=65536)
    require_same(both(monkeypatch, path, [SignalSource("a", TOPIC)]))


def test_more_strings_than_are_remembered_are_laid_out_anew(tmp_path, monkeypatch):
    kinds = JAZZY.types
    messages = []
    for i in range(200):
        stamp = kinds["builtin_interfaces/msg/Time"](1, i)
        names = [f"joint{j}" for j in range(columns_kernel.MAX_WORDS + i % 3)]
        values = np.arange(len(names)) + 100.0 * i
        state = kinds["sensor_msgs/msg/JointState"](
            kinds["std_msgs/msg/Header"](stamp, ""), names, values, values, values[:0]
        )
        messages.append((i, bytes(JAZZY.serialize_cdr(state, "sensor_msgs/msg/JointState"))))
    text, _ = JAZZY.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
    path = write(tmp_path / "bag", "sensor_msgs/msg/JointState", text, messages, chunk=65536)
    sources = [
        SignalSource(f, TOPIC, "sensor_msgs/msg/JointState", f)
        for f in ("position[3]", "velocity[25]", "effort[0]")
    ]
    found = both(monkeypatch, path, sources)
    require_same(found)
    np.testing.assert_array_equal(found[0][0].values, 100.0 * np.arange(200) + 3.0)
    assert np.isnan(found[0][2].values).all()


def test_a_sequence_of_messages_is_left_to_the_general_decoder(tmp_path, monkeypatch):
    text = "geometry_msgs/Point[] points\n" + "=" * 80 + "\nMSG: geometry_msgs/Point\n"
    text += "float64 x\nfloat64 y\nfloat64 z"
    name = "test_msgs/msg/Path"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, name))
    point = store.types["geometry_msgs/msg/Point"]
    data = bytes(store.serialize_cdr(store.types[name]([point(1.0, 2.0, 3.0)]), name))
    path = write(tmp_path / "bag", name, text, [(5, data)])
    source = SignalSource("a", TOPIC, name, "points[0].y")
    found = both(monkeypatch, path, [source])
    require_same(found)
    assert found[0][0].values.tolist() == [2.0]


@pytest.mark.parametrize("size", range(0, 28, 3))
def test_a_message_that_ends_too_early_is_named(tmp_path, monkeypatch, size):
    data = encode_stamped(START_NS, 1.0)
    messages = [(START_NS, data), (START_NS + 1, data[:size]), (START_NS + 2, data)]
    path = write(tmp_path / "bag", STAMPED_TYPE, definition(STAMPED_TYPE), messages, chunk=65536)
    for compiled in (True, False):
        monkeypatch.setattr(bag_signals, "pays", lambda _, answer=compiled: answer)
        with pytest.raises(BagError, match=f"log time {START_NS + 1} ns is no valid"):
            read_columns(path, [SignalSource("a", TOPIC)])


@settings(max_examples=150)
@given(st.integers(0, 2**31), st.integers(1, 255), st.booleans())
def test_a_flipped_byte_without_a_check_sum_is_read_alike_or_refused_alike(
    tmp_path_factory, place, flip, single
):
    folder = tmp_path_factory.mktemp("bags")
    name = STAMPED_TYPE if single else SERIES_TYPE
    path = folder / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "test")
        schema = writer.register_schema(name, "ros2msg", definition(name).encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for i in range(30):
            stamp = START_NS + i
            message = (
                encode_stamped(stamp, float(i), "name")
                if single
                else encode_series(stamp, 0.01, np.arange(5.0), "name")
            )
            writer.add_message(channel, stamp, message, stamp)
        writer.finish()
    data = bytearray(path.read_bytes())
    begin = data.index(b"name\0")
    data[begin + place % (30 * (59 if single else 99))] ^= flip
    path.write_bytes(data)
    source = SignalSource("a", TOPIC, name, "value" if single else "values[]")
    outcome: list[list[bytes]] = []
    with pytest.MonkeyPatch.context() as patch:
        for compiled in (True, False):
            patch.setattr(bag_signals, "pays", lambda _, answer=compiled: answer)
            try:
                (found,) = read_columns(path, [source])
                columns = found.log_ns, found.stamp_ns, found.values
                outcome.append([column.tobytes() for column in columns])
            except BagError:
                outcome.append([])
    # the name need not be a text for the compiled walk
    assert outcome[0] == outcome[1] or not outcome[1]


@pytest.mark.parametrize("compiled", [True, False])
def test_batches_without_a_period_that_can_be_are_named(tmp_path, monkeypatch, caplog, compiled):
    periods = [0.1, 0.0, float("nan"), 1e300, 2e8, 0.1]
    messages = [(i, encode_series(START_NS, p, np.arange(5.0))) for i, p in enumerate(periods)]
    path = write(tmp_path / "bag", SERIES_TYPE, definition(SERIES_TYPE), messages)
    monkeypatch.setattr(bag_signals, "pays", lambda _: compiled)
    (found,) = read_columns(path, [SignalSource("a", TOPIC, SERIES_TYPE, "values[]")])
    assert found.log_ns.tolist() == [0] * 5 + [5] * 5
    assert "topic '/a': 4 of 6 batches have no period that can be" in caplog.text


@pytest.mark.parametrize("size", [1, 500, 4000])
def test_messages_outside_chunks_are_read_piece_by_piece(tmp_path, monkeypatch, size):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start("ros2", "test")
        schema = writer.register_schema(STAMPED_TYPE, "ros2msg", definition(STAMPED_TYPE).encode())
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for i in range(100):
            stamp = START_NS + i
            writer.add_message(channel, stamp, encode_stamped(stamp, float(i)), stamp)
        writer.finish()
    monkeypatch.setattr(reader, "_PIECE", size)
    for found in both(monkeypatch, path, [SignalSource("a", TOPIC)]):
        assert found[0].values.tolist() == list(range(100))


def test_a_short_bag_is_read_without_numba(small_bag):
    code = (
        "import sys\n"
        "from valve_twin.io.bags.read import read_columns\n"
        "from valve_twin.io.cdr.signals import SignalSource\n"
        f"(found,) = read_columns({str(small_bag)!r}, [SignalSource('a', '/press/command')])\n"
        "print(len(found), 'numba' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1000", "False"]
