# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import math
from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from rosbags.typesys import Stores, get_typestore

from valve_twin.io.bags.definitions import definition
from valve_twin.io.cdr.bag_types import BagTypes
from valve_twin.io.cdr.codec import encode_series, encode_stamped
from valve_twin.io.cdr.message_types import RosTypes, full_type_name, message_class
from valve_twin.io.cdr.signals import (
    SERIES_TYPE,
    STAMPED_TYPE,
    Extractor,
    SignalSource,
    parse_path,
)
from valve_twin.io.errors import ConfigError

JAZZY = get_typestore(Stores.ROS2_JAZZY)


def types_of(name):
    return BagTypes(Schema(1, definition(name).encode(), "ros2msg", name), "a.mcap")


def extractor(type_name, field, **more):
    source = SignalSource("position", "/joint", full_type_name(type_name), field, **more)
    return Extractor(source, types_of(full_type_name(type_name)), "a.mcap")


def message(type_name, **fields):
    kinds = JAZZY.types
    if "stamp_ns" in fields:
        sec, nanosec = divmod(fields.pop("stamp_ns"), 10**9)
        time = kinds["builtin_interfaces/msg/Time"](sec, nanosec)
        fields["header"] = kinds["std_msgs/msg/Header"](time, "")
    return kinds[type_name](**fields)


def joint_state(position, stamp_ns=10**18):
    nothing = np.empty(0)
    return message(
        "sensor_msgs/msg/JointState",
        stamp_ns=stamp_ns,
        name=[],
        position=np.array(position),
        velocity=nothing,
        effort=nothing,
    )


def test_takes_an_array_element_with_scale_and_offset():
    get = extractor("sensor_msgs/msg/JointState", "position[2]", scale=0.001, offset=0.25)
    block = get(joint_state([1.0, 2.0, 30.0]), 7)
    assert (block.signal, block.stamp_ns.tolist(), block.has_header) == (
        "position",
        [10**18],
        True,
    )
    np.testing.assert_array_equal(block.values, [30.0 * 0.001 + 0.25])


def test_an_element_beyond_the_end_is_no_value():
    block = extractor("sensor_msgs/JointState", "position[2]")(joint_state([1.0]), 7)
    assert math.isnan(block.values[0])
    assert block.stamp_ns[0] == 10**18


def test_takes_a_nested_field():
    point = Message(x=1.0, y=2.0, z=3.0)
    sent = Message(header=Message(stamp=Message(sec=3, nanosec=4)), pose=Message(position=point))
    block = extractor("geometry_msgs/PoseStamped", "pose.position.y")(sent, 7)
    assert (block.values[0], block.stamp_ns[0]) == (2.0, 3_000_000_004)


def test_without_a_header_the_receive_time_stands():
    get = extractor("std_msgs/msg/Float64", "data")
    block = get(Message(data=1.5), 42)
    assert (block.stamp_ns.tolist(), block.has_header, get.has_header) == ([42], False, False)


def test_a_header_that_nobody_filled_counts_as_none():
    block = extractor("sensor_msgs/JointState", "position[0]")(joint_state([1.0], 0), 42)
    assert (block.stamp_ns[0], block.has_header) == (42, False)


def test_a_truth_value_is_a_number():
    assert extractor("std_msgs/msg/Bool", "data")(Message(data=True), 0).values[0] == 1.0


def series(values, period=0.1, stamp_ns=10**18):
    stamp = Message(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return Message(header=Message(stamp=stamp), period=period, values=np.array(values))


def test_a_batch_has_a_stamp_a_sample():
    block = extractor(SERIES_TYPE, "values[]")(series([1.0, 2.0, 3.0], 0.001), 7)
    assert block.stamp_ns.tolist() == [10**18, 10**18 + 10**6, 10**18 + 2 * 10**6]
    assert block.values.tolist() == [1.0, 2.0, 3.0]


def test_rounding_does_not_add_up_in_a_batch():
    block = extractor(SERIES_TYPE, "values[]")(series(np.zeros(100_001), 1 / 3e4), 7)
    assert block.stamp_ns[-1] - block.stamp_ns[0] == round(1e5 / 3e4 * 1e9)


@pytest.mark.parametrize("period", [0.0, -1.0, math.nan, math.inf])
def test_a_batch_without_a_period_is_rejected_and_counted(period):
    get = extractor(SERIES_TYPE, "values[]")
    assert len(get(series([1.0, 2.0], period), 7).values) == 0
    assert get.rejected == 1


@given(
    st.integers(1, 2**31 * 10**9 - 1),
    st.floats(),
    st.floats(-1e3, 1e3).filter(bool),
    st.floats(-1e3, 1e3),
)
def test_raw_bytes_give_the_same_as_the_message(stamp_ns, value, scale, offset):
    get = extractor(STAMPED_TYPE, "value", scale=scale, offset=offset)
    data = encode_stamped(stamp_ns, value)
    decoded = get(types_of(STAMPED_TYPE).decode(data, 0), 7)
    raw = get.from_raw(data, 7)
    assert raw.stamp_ns.tobytes() == decoded.stamp_ns.tobytes()
    assert raw.values.tobytes() == decoded.values.tobytes()


@given(st.lists(st.floats(), max_size=5), st.floats(1e-6, 10.0))
def test_raw_batches_give_the_same_as_the_message(values, period):
    get = extractor(SERIES_TYPE, "values[]", scale=0.01)
    data = encode_series(10**18, period, np.array(values, dtype=float))
    decoded = get(types_of(SERIES_TYPE).decode(data, 0), 7)
    raw = get.from_raw(data, 7)
    assert raw.stamp_ns.tobytes() == decoded.stamp_ns.tobytes()
    assert raw.values.tobytes() == decoded.values.tobytes()


BAD_FIELDS = [
    ("sensor_msgs/JointState", "positon[2]", r"has no field 'positon'; did you mean 'position'\?"),
    ("sensor_msgs/JointState", "position", r"is an array; write position\[0\]"),
    ("sensor_msgs/JointState", "header[1]", r"is no array; write header without brackets"),
    ("sensor_msgs/JointState", "header.frame_id", r"type string, not a number; name a numeric"),
    ("sensor_msgs/JointState", "name.x", r"is an array; write name\[0\]"),
    ("sensor_msgs/JointState", "name[0].x", r"plain string; end the path there"),
    ("geometry_msgs/PoseStamped", "pose.position", r"there are pose.position.x, pose.position.y"),
    ("geometry_msgs/PoseStamped", "pose.postion.x", r"Pose has no field 'postion'; did you mean"),
    (
        "sensor_msgs/Imu",
        "orientation_covariance[9]",
        r"has 9 elements; write an index from 0 to 8",
    ),
    ("sensor_msgs/JointState", "position[]", r"no field 'period' beside 'position'"),
    (STAMPED_TYPE, "value[x]", r"no field path; write for example value, position\[2\]"),
    (STAMPED_TYPE, "", r"no field path"),
    (SERIES_TYPE, "values[].x", r"write \[\] only after the last field"),
]


@pytest.mark.parametrize(("type_name", "field", "says"), BAD_FIELDS)
def test_a_field_that_does_not_fit_is_named_with_topic_and_remedy(type_name, field, says):
    with pytest.raises(ConfigError, match=says) as caught:
        extractor(type_name, field)
    text = str(caught.value)
    assert "a.mcap: signal 'position', topic '/joint'" in text
    assert "\n" not in text


def test_an_unknown_type_is_named():
    source = SignalSource("position", "/joint", "nowhere_msgs/msg/Nothing", "x")
    with pytest.raises(ConfigError, match="nowhere_msgs/msg/Nothing is unknown; install"):
        Extractor(source, RosTypes(), "/twin")


@pytest.mark.parametrize("name", ["", "JointState", "a/b/c/d", "1a/B", "a b/C"])
def test_what_is_no_type_name_is_refused(name):
    with pytest.raises(ValueError, match="is no message type; write it as package/msg/Name"):
        full_type_name(name)


def test_paths_are_split():
    steps = [(s.name, s.index) for s in parse_path("a.b[3].c[]")]
    assert steps == [("a", None), ("b", 3), ("c", -1)]


def test_installed_classes_and_bag_definitions_agree():
    pytest.importorskip("sensor_msgs.msg", reason="ROS 2 messages are not installed")
    for name in ("sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu", "geometry_msgs/msg/Pose"):
        installed, defined = RosTypes().fields(name), types_of(name).fields(name)
        assert list(installed) == list(defined)
        for field, kind in installed.items():
            assert (kind.is_array, kind.size) == (defined[field].is_array, defined[field].size)


def test_installed_classes_are_read_like_bag_messages():
    pytest.importorskip("sensor_msgs.msg", reason="ROS 2 messages are not installed")
    sent = message_class("sensor_msgs/msg/JointState")()
    sent.header.stamp.sec = 10**9
    sent.position = [1.0, 2.0]
    source = SignalSource("position", "/joint", "sensor_msgs/msg/JointState", "position[1]")
    block = Extractor(source, RosTypes(), "/twin")(sent, 7)
    assert (block.values.tolist(), block.stamp_ns.tolist()) == ([2.0], [10**18])
