# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Parts of bags and tables of bags hold what the bag held there."""

import csv
import sys

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from valve_twin.io.bags.read import BagWriter, QosProfile, bag_info, read_signals
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE, SignalSource
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.offline.cut import cut, read_time
from valve_twin.io.tables.csv_export import convert_signals, convert_topics

START_NS = 1_577_836_800_000_000_000
POSITION = SignalSource("position", "/press/position")
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
                bag.write_sample("/press/limit", START_NS + i * 10_000_000, 1.0 + i)
            bag.write_sample("/press/position", START_NS + i * 10_000_000, float(i))
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


def test_csv_holds_every_field_in_full(tmp_path):
    numbers = np.random.default_rng(1).normal(size=50)
    with BagWriter(tmp_path / "bag") as bag:
        for i, number in enumerate(numbers.tolist()):
            bag.write_sample("/a", START_NS + i, number, log_ns=START_NS + 10 * i)
    (written,) = convert_topics(tmp_path / "bag", tmp_path / "x.csv")
    assert (written.rows, written.topic) == (50, "/a")
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(r["value"]) for r in rows] == numbers.tolist()
    assert int(rows[3]["log_time_ns"]) == START_NS + 30
    assert int(rows[3]["header.stamp.nanosec"]) == 3


def test_arrays_of_different_length_leave_cells_empty(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/a", SERIES_TYPE)
        for i, count in enumerate((2, 3, 1)):
            bag.write_series("/a", START_NS + i, 0.01, np.arange(float(count)))
    convert_topics(tmp_path / "bag", tmp_path / "x.csv", ["a"])
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    cells = [[r[f"values[{i}]"] for i in range(3)] for r in rows]
    assert cells == [["0.0", "1.0", ""], ["0.0", "1.0", "2.0"], ["0.0", "", ""]]


def test_several_topics_give_a_file_each(small_bag, tmp_path):
    written = convert_topics(small_bag, tmp_path / "x.csv")
    names = ["x.press_command.csv", "x.press_position.csv"]
    assert [w.path.name for w in written] == names
    assert all((tmp_path / name).is_file() for name in names)


def test_parquet_agrees_with_the_bag(small_bag, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet' is not installed")
    convert_topics(small_bag, tmp_path / "x.parquet", ["/press/position"])
    table = parquet.read_table(tmp_path / "x.parquet")
    assert table["value"].to_pylist() == (-0.25 * np.arange(1000)).tolist()
    assert str(table.schema.field("log_time_ns").type) == "int64"


def test_parquet_without_its_package_is_told(small_bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(BagError, match=r"needs pyarrow; pip install 'valve_twin\[parquet\]'"):
        convert_topics(small_bag, tmp_path / "x.parquet")


def test_other_formats_are_refused(small_bag, tmp_path):
    with pytest.raises(BagError, match=r"end it in \.csv or \.parquet"):
        convert_topics(small_bag, tmp_path / "x.xlsx")


def test_a_missing_topic_is_named_with_the_nearest(small_bag, tmp_path):
    with pytest.raises(BagError, match="did you mean '/press/position'"):
        convert_topics(small_bag, tmp_path / "x.csv", ["/press/positio"])


def test_signals_of_a_valve_share_rows_by_stamp(root, tmp_path):
    (config, *_) = load_config(root / "config" / "press_cartridge.yaml")
    sources = list(config.signals.values())
    with BagWriter(tmp_path / "bag") as bag:
        for i in range(30):
            for number, source in enumerate(sources):
                if i % (number + 1) == 0:
                    bag.write_sample(source.topic, START_NS + i * 1000, 0.01 * i)
    written = convert_signals(tmp_path / "bag", tmp_path / "x.csv", config)
    assert written.rows == 30
    with (tmp_path / "x.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["stamp_ns", *(s.signal for s in sources)]
    blocks = {b.signal: b for b in read_signals(tmp_path / "bag", sources)}
    for source in sources:
        found = {int(r["stamp_ns"]): float(r[source.signal]) for r in rows if r[source.signal]}
        block = blocks[source.signal]
        assert found == dict(zip(block.stamp_ns.tolist(), block.values.tolist(), strict=True))
