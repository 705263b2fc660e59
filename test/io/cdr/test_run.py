# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Many serialized samples read at once are those read one by one."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.io.cdr.codec import decode_stamped, encode_stamped
from valve_twin.io.cdr.run import decode_stamped_run

STAMPS = [0, 1, 999_999_999, 1_000_000_000, 1_795_246_543_830_011_597]


@pytest.mark.parametrize("frame", ["", "a", "abc", "abcd", "press_valve_3"])
def test_a_run_gives_the_bits_of_single_messages(frame):
    values = np.random.default_rng(1).normal(size=len(STAMPS))
    values[2] = np.nan
    messages = [encode_stamped(s, float(v), frame) for s, v in zip(STAMPS, values, strict=True)]
    run = decode_stamped_run(messages)
    assert run is not None
    stamps, found = run
    single = [decode_stamped(m) for m in messages]
    assert stamps.tolist() == [s for s, _ in single] == STAMPS
    assert found.tobytes() == np.array([v for _, v in single]).tobytes()
    assert stamps.flags.writeable
    assert found.flags.c_contiguous


def test_messages_of_different_layout_are_left_to_single_reading():
    short, long = encode_stamped(1, 2.0), encode_stamped(1, 2.0, "a_longer_frame")
    assert decode_stamped_run([short, long]) is None
    same_size = encode_stamped(1, 2.0, "ab"), encode_stamped(1, 2.0, "abc")
    assert len(same_size[0]) == len(same_size[1])
    assert decode_stamped_run(list(same_size)) is None


def test_what_is_cut_or_big_endian_is_left_to_single_reading():
    message = encode_stamped(1, 2.0)
    assert decode_stamped_run([message[:20], message[:20]]) is None
    assert decode_stamped_run([b"\x00\x00" + message[2:]] * 2) is None
    assert decode_stamped_run([message, message[:-1], message + b"\0"]) is None
