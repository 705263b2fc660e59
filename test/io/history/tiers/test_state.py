# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is known of aging goes through a text of the database to the last bit."""

import base64
import zlib

import pytest

from valve_twin.bench.data.years import life
from valve_twin.core.past.state import AgingState
from valve_twin.core.past.stored import freeze
from valve_twin.io.history.tiers.state import state_text, text_state


def known():
    state = AgingState(recent=32)
    for estimate in life(150):
        state.add(estimate)
    return state


def test_it_comes_back_and_goes_on_as_if_nothing_had_been():
    one = known()
    other = text_state(state_text(one))
    assert other is not None
    for estimate in life(100, 151):
        one.add(estimate)
        other.add(estimate)
    assert state_text(one) == state_text(other)
    assert freeze(one)[0] == freeze(other)[0]


def packed(content):
    return base64.b64encode(zlib.compress(content)).decode()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: "",
        lambda: "?",
        lambda: packed(b"{}\n"),
        lambda: packed(b"[" * 100_000),
        lambda: packed(b'{"arrays": []}\n' + bytes(1 << 27)),
    ],
    ids=["empty", "no text", "no state", "nested", "bomb"],
)
def test_what_cannot_be_read_is_nothing(wrong):
    assert text_state(wrong()) is None


def test_half_a_text_is_nothing():
    text = state_text(known())
    assert text_state(text[: len(text) // 2]) is None
