# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A tag is a topic and a node id; what is not good is no number."""

from __future__ import annotations

import math
from datetime import datetime, timezone

import pytest

pytest.importorskip("asyncua", reason="needs the extra gateway")

from asyncua import ua

from valve_twin.io.errors import ConfigError
from valve_twin.nodes.opcua_source.tags import MOST_TAGS, read_tags, to_sample

WHEN = datetime(2026, 1, 2, 3, 4, 5, 678901, tzinfo=timezone.utc)


def test_a_line_is_a_topic_and_a_node_that_may_hold_spaces():
    lines = ['position ns=3;s="Press"."Valve 1"', "/plant/speed  i=7"]
    first, second = read_tags(lines, "/press/v1", "/plc", where="x")
    assert (first.topic, first.node) == ("/plc/press/v1/position", 'ns=3;s="Press"."Valve 1"')
    assert (second.topic, second.node) == ("/plc/plant/speed", "i=7")


@pytest.mark.parametrize(
    ("lines", "why"),
    [([], "there is none"), (["position"], "is no tag"), (["a i=1", "a i=2"], "two tags feed")],
)
def test_what_is_no_tag_is_named(lines, why):
    with pytest.raises(ConfigError, match=why):
        read_tags(lines, "/v", "", where="x")


def test_ten_thousand_tags_are_one_line_and_a_thousand_are_taken():
    lines = [f"tag{number} ns=3;i={number}" for number in range(10_000)]
    assert len(read_tags(lines[:MOST_TAGS], "/v", "", where="x")) == MOST_TAGS
    why = "^x: tags: 10000 are given, a node takes 1000 at most: leave out [^\\n]*$"
    with pytest.raises(ConfigError, match=why):
        read_tags(lines, "/v", "", where="x")


def data(value, status=0, **stamps):
    return ua.DataValue(ua.Variant(value), ua.StatusCode(status), **stamps)


def test_the_stamp_is_that_of_the_source_to_a_microsecond():
    sample = to_sample(4, data(1.5, SourceTimestamp=WHEN, ServerTimestamp=None))
    assert (sample.tag, sample.value) == (4, 1.5)
    assert sample.stamp_ns == 1_767_323_045_678_901_000
    assert to_sample(0, data(1.5, ServerTimestamp=WHEN)).stamp_ns == sample.stamp_ns
    assert to_sample(0, data(1.5)).stamp_ns == 0


@pytest.mark.parametrize("value", [True, 3, 2.5])
def test_numbers_are_taken(value):
    assert to_sample(0, data(value)).value == value


@pytest.mark.parametrize(
    ("value", "status"), [("text", 0), ([1.0, 2.0], 0), (1.0, 0x40000000), (1.0, 0x80000000)]
)
def test_anything_else_is_masked(value, status):
    assert math.isnan(to_sample(0, data(value, status)).value)


def test_a_queue_that_overflowed_is_seen():
    overflow = to_sample(0, data(1.0, 0x480))
    assert overflow.lost_before
    assert overflow.value == 1.0
    assert not to_sample(0, data(1.0, 0x400)).lost_before
