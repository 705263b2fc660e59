# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from valve_twin.io.bags.definitions import definition
from valve_twin.io.cdr.codec import (
    decode_series,
    decode_stamped,
    encode_series,
    encode_stamped,
    encode_string,
)
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE

STAMPS = st.integers(0, 2**31 * 10**9 - 1)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
NAMES = st.text(max_size=20).filter(lambda s: "\0" not in s)


def peer(type_name):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition(type_name), type_name))
    return store


STAMPED, SERIES = peer(STAMPED_TYPE), peer(SERIES_TYPE)


@given(STAMPS, NUMBERS, NAMES)
def test_reads_what_it_wrote(stamp_ns, value, frame_id):
    stamp, read = decode_stamped(encode_stamped(stamp_ns, value, frame_id))
    assert stamp == stamp_ns
    np.testing.assert_array_equal(read, value)


@given(STAMPS, NUMBERS, NAMES)
def test_stamped_bytes_are_those_of_rosbags(stamp_ns, value, frame_id):
    data = encode_stamped(stamp_ns, value, frame_id)
    message = STAMPED.deserialize_cdr(data, STAMPED_TYPE)
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns
    assert message.header.frame_id == frame_id
    np.testing.assert_array_equal(message.value, value)
    assert bytes(STAMPED.serialize_cdr(message, STAMPED_TYPE)) == data


@given(STAMPS, st.floats(1e-9, 1e3), st.lists(NUMBERS, max_size=9), NAMES)
def test_series_bytes_are_those_of_rosbags(stamp_ns, period_s, values, frame_id):
    data = encode_series(stamp_ns, period_s, np.array(values, dtype=float), frame_id)
    message = SERIES.deserialize_cdr(data, SERIES_TYPE)
    assert message.period == period_s
    np.testing.assert_array_equal(message.values, values)
    assert bytes(SERIES.serialize_cdr(message, SERIES_TYPE)) == data
    stamp, period, read = decode_series(data)
    assert (stamp, period) == (stamp_ns, period_s)
    np.testing.assert_array_equal(read, values)


@given(STAMPS, NUMBERS, NAMES)
def test_reads_big_endian_bytes(stamp_ns, value, frame_id):
    message = STAMPED.deserialize_cdr(encode_stamped(stamp_ns, value, frame_id), STAMPED_TYPE)
    data = bytes(STAMPED.serialize_cdr(message, STAMPED_TYPE, little_endian=False))
    stamp, read = decode_stamped(data)
    assert stamp == stamp_ns
    np.testing.assert_array_equal(read, value)


def test_string_bytes_are_those_of_rosbags():
    store = get_typestore(Stores.ROS2_JAZZY)
    data = encode_string("exp_data_1_1")
    text: Any = store.deserialize_cdr(data, "std_msgs/msg/String")
    assert text.data == "exp_data_1_1"


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_refuses_a_stamp_that_a_header_cannot_hold(stamp_ns):
    with pytest.raises(ValueError, match="1970 to 2038"):
        encode_stamped(stamp_ns, 0.0)


@given(st.integers(0, 27))
def test_names_bytes_that_are_too_short(size):
    data = encode_stamped(10**18, 1.0)[:size]
    with pytest.raises(ValueError, match=f"{size} bytes are no valid Float64Stamped"):
        decode_stamped(data)


def test_names_a_series_that_lacks_values():
    data = encode_series(10**18, 0.1, np.arange(4.0))[:-1]
    with pytest.raises(ValueError, match="no valid Float64Series"):
        decode_series(data)
