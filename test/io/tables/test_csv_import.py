# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import gzip

import numpy as np
import pytest

from test.bag_samples import read_texts
from valve_twin.io.bags.read import bag_info, read_signals
from valve_twin.io.cdr.signals import SERIES_TYPE, STAMPED_TYPE
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.tables.csv_import import csv_files, import_csv

BASE_NS = 1_577_836_800_000_000_000
CONFIG = """model: positioner
period_s: 0.5
signals.command.column: u
signals.command.scale: 0.01
signals.position.column: "2"
csv.time_column: t
"""
ROWS = "t,u,x\n" + "".join(f"{0.5 * i},{10.0 * i},{i}\n" for i in range(10))


@pytest.fixture
def run(tmp_path, yaml_file):
    """Return a function that imports texts as files: run(configuration, *texts)."""

    def import_all(text, *contents):
        (config,) = load_config(yaml_file(text))
        files = []
        for i, content in enumerate(contents):
            path = tmp_path / f"run_{i}.csv"
            path.write_text(content, encoding="utf-8")
            files.append(path)
        summary = import_csv(files, config, tmp_path / "bag")
        return config, summary, tmp_path / "bag"

    return import_all


def signal(config, bag, name):
    blocks = list(read_signals(bag, [config.signals[name]]))
    return (
        np.concatenate([b.stamp_ns for b in blocks]),
        np.concatenate([b.values for b in blocks]),
        all(b.has_header for b in blocks),
    )


def test_columns_become_stamped_samples(run):
    config, summary, bag = run(CONFIG, ROWS)
    stamps, values, has_header = signal(config, bag, "command")
    np.testing.assert_array_equal(stamps, BASE_NS + np.arange(10) * 500_000_000)
    np.testing.assert_array_equal(values, np.arange(10) * 10.0 * 0.01)
    assert has_header
    assert str(summary) == "1 files, 10 rows, 21 messages"
    assert bag_info(bag).custom["valve"] == "/valve"


def test_the_bag_keeps_the_numbers_of_the_file(run):
    config, _, bag = run(CONFIG, ROWS)
    raw = config.signals["command"]
    unscaled = type(raw)(raw.signal, raw.topic)
    values = np.concatenate([b.values for b in read_signals(bag, [unscaled])])
    np.testing.assert_array_equal(values, np.arange(10) * 10.0)


def test_the_same_files_give_the_same_bag(run, tmp_path):
    config, _, bag = run(CONFIG, ROWS)
    import_csv([tmp_path / "run_0.csv"], config, tmp_path / "again" / "bag")
    first, second = ((p / "bag_0.mcap").read_bytes() for p in (bag, tmp_path / "again" / "bag"))
    assert first == second


def test_time_counts_from_the_first_row_and_in_its_own_unit(run):
    rows = "t,u,x\n7000,0,0\n7500,1,1\n8250,2,2\n"
    config, _, bag = run(CONFIG + "csv.time_scale: 0.001\n", rows)
    stamps, _, _ = signal(config, bag, "position")
    assert (stamps - BASE_NS).tolist() == [0, 500_000_000, 1_250_000_000]


def test_without_a_time_column_rows_are_a_period_apart(run):
    config, _, bag = run(CONFIG.replace("csv.time_column: t", ""), ROWS)
    stamps, _, _ = signal(config, bag, "position")
    assert set(np.diff(stamps).tolist()) == {500_000_000}


def test_windows_begin_at_the_first_row(run):
    more = "cycles.rule: window\ncycles.window_s: 7.0\ncycles.window_offset_s: 2.0\n"
    config, _, bag = run(CONFIG + more, ROWS)
    stamps, _, _ = signal(config, bag, "position")
    assert (stamps[0] - 2 * 10**9) % (7 * 10**9) == 0
    assert 0 <= stamps[0] - BASE_NS < 7 * 10**9


def test_dates_in_the_file_are_kept(run):
    rows = "t,u,x\n2024-10-21T08:00:00Z,1,1\n2024-10-21T08:00:00.500Z,2,2\n"
    config, _, bag = run(CONFIG, rows)
    stamps, _, _ = signal(config, bag, "position")
    assert stamps.tolist() == [1_729_497_600 * 10**9, 1_729_497_600 * 10**9 + 500_000_000]


def test_a_missing_value_stays_missing(run):
    config, _, bag = run(CONFIG, "t,u,x\n0,1,\n0.5,2,3\n")
    _, values, _ = signal(config, bag, "position")
    np.testing.assert_array_equal(values, [np.nan, 3.0])


def test_files_follow_one_another_with_a_pause_and_their_names(run):
    config, summary, bag = run(CONFIG + "csv.gap_s: 3.0\n", ROWS, ROWS)
    stamps, _, _ = signal(config, bag, "position")
    assert stamps[10] - stamps[9] == 3 * 10**9
    assert read_texts(bag, "/valve/run") == [(int(stamps[0]), "run_0"), (int(stamps[10]), "run_1")]
    assert [f.rows for f in summary.files] == [10, 10]


BATCHES = CONFIG + f"signals.command.type: {SERIES_TYPE}\nsignals.position.type: {SERIES_TYPE}\n"


@pytest.mark.parametrize(("batch", "messages"), [(1, 10), (3, 4), (10, 1), (100, 1)])
def test_batches_hold_the_same_samples(run, batch, messages):
    config, _, bag = run(BATCHES + f"csv.batch: {batch}\n", ROWS)
    stamps, values, _ = signal(config, bag, "command")
    np.testing.assert_array_equal(stamps, BASE_NS + np.arange(10) * 500_000_000)
    np.testing.assert_array_equal(values, np.arange(10) * 10.0 * 0.01)
    counts = {t.name: (t.type, t.count) for t in bag_info(bag).topics}
    assert counts["/valve/command"] == (SERIES_TYPE, messages)


def test_a_gap_ends_a_batch(run):
    rows = "t,u,x\n0,0,0\n0.5,1,1\n5.0,2,2\n5.5,3,3\n"
    config, _, bag = run(BATCHES, rows)
    stamps, _, _ = signal(config, bag, "command")
    assert ((stamps - BASE_NS) / 1e9).tolist() == [0.0, 0.5, 5.0, 5.5]
    assert {t.count for t in bag_info(bag).topics if t.type == SERIES_TYPE} == {2}


def test_a_column_that_two_signals_share_is_written_once(run):
    more = "signals.reference.topic: command\nsignals.reference.column: u\n"
    config, _, bag = run(CONFIG + more, ROWS)
    np.testing.assert_array_equal(
        signal(config, bag, "reference")[1], signal(config, bag, "command")[1] * 100.0
    )
    assert len(bag_info(bag).topics) == 3


def test_folders_and_patterns_name_files_in_order(tmp_path):
    for name in ("b.csv", "a.csv.gz", "c.txt"):
        content = gzip.compress(ROWS.encode(), mtime=0) if name.endswith("gz") else ROWS.encode()
        (tmp_path / name).write_bytes(content)
    assert [p.name for p in csv_files(tmp_path)] == ["a.csv.gz", "b.csv"]
    assert [p.name for p in csv_files(f"{tmp_path}/*.csv*")] == ["a.csv.gz", "b.csv"]
    assert [p.name for p in csv_files(tmp_path / "b.csv")] == ["b.csv"]


BAD_ROWS = [
    ("0,0,0\n0.5,1,1\n0.5,2,2\n", r"run_0.csv:4: column 't' repeats the time, 0.5 after 0.5"),
    (
        "0,0,0\n1.5,1,1\n1.0,2,2\n",
        r"run_0.csv:4: column 't' goes back in time, 1 after 1.5; remove",
    ),
    ("0,0,0\n,1,1\n1.0,2,2\n", r"run_0.csv:3: column 't' has no time; remove the row"),
    ("0,0,0\nnow,1,1\n", r"run_0.csv:3: column 't': 'now' is no number"),
]


@pytest.mark.parametrize(("rows", "says"), BAD_ROWS)
def test_bad_times_are_named_with_their_line(run, rows, says):
    with pytest.raises(BagError, match=says):
        run(CONFIG, "t,u,x\n" + rows)


def test_no_bag_is_left_when_the_first_file_is_bad(run, tmp_path):
    with pytest.raises(BagError, match="there is no column 'u'"):
        run(CONFIG, "t,v,x\n0,0,0\n")
    assert not (tmp_path / "bag").exists()


BAD_CONFIGS = [
    ("model: positioner\n",
     r"no signal names its column of the CSV file; write signals.command.column"),
    (CONFIG + "signals.reference.topic: command\nsignals.reference.column: x\n",
     r"topic '/valve/command' takes column 'u' and 'x'; give signals.reference.topic a name"),
    (CONFIG + "signals.command.type: std_msgs/msg/Float64\n",
     rf"which an import does not write; write signals.command.type: {STAMPED_TYPE}"),
    (CONFIG + "csv.base_stamp: yesterday\n", r"'csv.base_stamp': value 'yesterday' is no date"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "says"), BAD_CONFIGS)
def test_mappings_that_cannot_be_written_are_named(run, text, says):
    with pytest.raises(ConfigError, match=says):
        run(text, ROWS)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(
        BagError, match=r"\*.csv: there is no such CSV file; give a file, a folder"
    ):
        csv_files(tmp_path / "*.csv")
