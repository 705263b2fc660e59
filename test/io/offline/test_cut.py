# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parts of bags hold what the bag held there."""

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter, QosProfile, bag_info
from valve_twin.io.cdr.signals import STAMPED_TYPE
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.offline.cut import cut, read_time

START_NS = 1_577_836_800_000_000_000
LATCHED = QosProfile(durability="transient_local", depth=1)


@pytest.fixture
def latched_bag(small_bag, tmp_path):
    """Return 1000 positions, 10 ms apart, and a latched limit at the begin and at 4 s."""
    path = tmp_path / "latched"
    with BagWriter(path) as bag:
        bag.note({"valve": "/press/valve_1"})
        bag.add_topic("/press/limit", STAMPED_TYPE, qos=(LATCHED,))
        for i in range(1000):
            if i in {0, 400}:
                write_sample(bag, "/press/limit", START_NS + i * 10_000_000, 1.0 + i)
            write_sample(bag, "/press/position", START_NS + i * 10_000_000, float(i))
    return path


def values(path, topic):
    with AnyReader([path]) as reader:
        return [
            (at, reader.deserialize(raw, c.msgtype).value)  # type: ignore[attr-defined]
            for c, at, raw in reader.messages()
            if c.topic == topic
        ]


def test_a_cut_holds_both_ends_and_the_last_latched_value(latched_bag, tmp_path):
    begin, end = START_NS + 2_000_000_000, START_NS + 3_000_000_000
    found = cut(latched_bag, tmp_path / "part", from_ns=begin, until_ns=end)
    assert found.latched == 1
    positions = values(tmp_path / "part", "/press/position")
    assert [v for _, v in positions] == np.arange(200.0, 301.0).tolist()
    assert values(tmp_path / "part", "/press/limit") == [(begin, 1.0)]
    assert bag_info(tmp_path / "part").custom["valve"] == "/press/valve_1"


def test_a_cut_of_some_topics_leaves_the_others(latched_bag, tmp_path):
    cut(latched_bag, tmp_path / "part", topics=["/press/limit"])
    assert [t.name for t in bag_info(tmp_path / "part").topics] == ["/press/limit"]


def test_nothing_in_the_stretch_is_told_and_leaves_no_bag(latched_bag, tmp_path):
    with pytest.raises(BagError, match="no message lies in the stretch"):
        cut(latched_bag, tmp_path / "part", from_ns=START_NS + 10**12)
    assert not (tmp_path / "part").exists()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.5", START_NS + 1_500_000_000),
        ("2020-01-01T00:00:02Z", START_NS + 2_000_000_000),
        ("2020-01-01T00:00:02.25", START_NS + 2_250_000_000),
        ("2020-01-01T01:00:00+01:00", START_NS),
    ],
)
def test_times_are_seconds_or_dates(text, expected):
    assert read_time(text, START_NS, "--from") == expected


@pytest.mark.parametrize("text", ["", "soon", "nan", "1e999"])
def test_other_times_are_refused(text):
    with pytest.raises(ConfigError, match="--from cannot be"):
        read_time(text, START_NS, "--from")


def test_a_damaged_bag_is_cut_where_it_is_intact(latched_bag, tmp_path):
    file = latched_bag / "latched_0.mcap"
    file.write_bytes(file.read_bytes()[:-200])
    cut(latched_bag, tmp_path / "part", until_ns=START_NS + 1_000_000_000)
    assert len(values(tmp_path / "part", "/press/position")) == 101
