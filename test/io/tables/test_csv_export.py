# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tables of bags hold what the bag held there."""

import csv
import sys

import numpy as np
import pytest

from test.bag_samples import write_sample
from valve_twin.io.bags.read import BagWriter, read_signals
from valve_twin.io.cdr.signals import SERIES_TYPE
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError
from valve_twin.io.tables.csv_export import convert_signals, convert_topics

START_NS = 1_577_836_800_000_000_000


def test_csv_holds_every_field_in_full(tmp_path):
    numbers = np.random.default_rng(1).normal(size=50)
    with BagWriter(tmp_path / "bag") as bag:
        for i, number in enumerate(numbers.tolist()):
            write_sample(bag, "/a", START_NS + i, number, log_ns=START_NS + 10 * i)
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


def test_a_table_behind_a_link_is_replaced_there_and_keeps_its_rights(small_bag, tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "x.csv").write_text("before", encoding="utf-8")
    (kept / "x.csv").chmod(0o600)
    (tmp_path / "x.csv").symlink_to(kept / "x.csv")
    convert_topics(small_bag, tmp_path / "x.csv", ["/press/position"])
    assert (tmp_path / "x.csv").is_symlink()
    assert (kept / "x.csv").read_text(encoding="utf-8").startswith("log_time_ns")
    assert (kept / "x.csv").stat().st_mode & 0o777 == 0o600
    assert [path.name for path in kept.iterdir()] == ["x.csv"]


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
                    write_sample(bag, source.topic, START_NS + i * 1000, 0.01 * i)
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
