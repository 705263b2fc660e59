# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Many samples at once make the bytes that one by one makes, and every reader takes them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter, bag_info, read_columns
from valve_twin.io.bags.rolling import SplitRule
from valve_twin.io.cdr.signals import STAMPED_TYPE, SignalSource
from valve_twin.io.errors import BagError

START_NS = 1_577_836_800_000_000_000
KEPT: dict[str, Any] = {"flush_s": 1e9, "sync": lambda _: None}
RULES = [SplitRule(), SplitRule(size=4000), SplitRule(duration_s=0.05)]


def write_both(folder, columns, **options: Any):
    """Write columns at once and one by one; return the files of both."""
    with BagWriter(folder / "one" / "bag", **KEPT, **options) as bag:
        for topic, _, _ in columns:
            bag.add_topic(topic, STAMPED_TYPE)
        rows = [
            (int(stamp), n, topic, float(value))
            for n, (topic, stamps, values) in enumerate(columns)
            for stamp, value in zip(stamps, values, strict=True)
        ]
        for stamp, _, topic, value in sorted(rows, key=lambda r: r[:2]):
            write_sample(bag, topic, stamp, value)
        singly = bag.counts
    with BagWriter(folder / "all" / "bag", **KEPT, **options) as bag:
        bag.write_samples(columns)
        assert bag.counts == singly
    return [
        {p.name: p.read_bytes() for p in sorted((folder / name / "bag").iterdir())}
        for name in ("one", "all")
    ]


@settings(max_examples=30)
@given(
    st.lists(st.lists(st.integers(0, 200), max_size=60), min_size=1, max_size=4),
    st.sampled_from([1, 59, 60, 500, 1500, 65536]),
    st.sampled_from(RULES),
    st.booleans(),
)
def test_many_at_once_make_the_same_bytes(tmp_path_factory, stamps, chunk, rule, compressed):
    columns = [
        (
            f"/topic{n}",
            START_NS + 10**6 * np.array(sorted(row), dtype=np.int64),
            np.array(row, float),
        )
        for n, row in enumerate(stamps)
    ]
    folder = tmp_path_factory.mktemp("bags")
    singly, at_once = write_both(
        folder, columns, chunk_size=chunk, split=rule, compressed=compressed
    )
    assert singly.keys() == at_once.keys()
    assert singly == at_once


def test_stamps_need_not_rise(tmp_path):
    stamps = START_NS + np.array([30, 10, 20, 10], dtype=np.int64)
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_samples([("/a", stamps, np.arange(4.0))])
    (found,) = read_columns(tmp_path / "bag", [SignalSource("a", "/a")])
    assert found.values.tolist() == [1.0, 3.0, 2.0, 0.0]


@pytest.fixture(params=[True, False], ids=["zstd", "none"])
def bag(request, tmp_path: Path) -> Path:
    """Return a bag of 6000 samples on three topics."""
    path = tmp_path / "bag"
    rng = np.random.default_rng(1)
    stamps = START_NS + np.arange(2000) * 10**6
    with BagWriter(path, compressed=request.param) as writer:
        writer.write_samples([(f"/topic{n}", stamps + n, rng.normal(size=2000)) for n in range(3)])
    return path


def test_rosbags_reads_what_was_written_at_once(bag):
    sources = [SignalSource(f"topic{n}", f"/topic{n}") for n in range(3)]
    ours = read_columns(bag, sources)
    found: dict[str, list[tuple[int, float]]] = {s.topic: [] for s in sources}
    with AnyReader([bag]) as reader:
        for connection, log_ns, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((log_ns, message.value))
    for source, column in zip(sources, ours, strict=True):
        assert (
            list(zip(column.log_ns.tolist(), column.values.tolist(), strict=True))
            == (found[source.topic])
        )
    assert bag_info(bag).message_count == 6000


def test_mcap_reads_what_was_written_at_once_with_its_check_sums(bag):
    with (bag / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = list(reader.iter_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(messages) == 6000
    assert [m.log_time for _, _, m in messages] == sorted(m.log_time for _, _, m in messages)
    for _, channel, message in messages[::97]:
        assert message.log_time == message.publish_time
        assert channel.topic == f"/topic{message.log_time % 10}"
    sequences = [m.sequence for _, c, m in messages if c.topic == "/topic1"]
    assert sequences == list(range(1, 2001))


def test_a_stamp_that_fits_no_header_is_named(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        with pytest.raises(BagError, match="topic '/a': stamp -1 ns does not fit into a message"):
            bag.write_samples([("/a", np.array([-1, 5]), np.zeros(2))])
        assert bag.counts == {"/a": 0}
