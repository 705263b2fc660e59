# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from __future__ import annotations

import pytest

from valve_twin.io.bags.contents import bag_info
from valve_twin.io.bags.writer import BagWriter
from valve_twin.io.cdr.codec import decode_string, encode_string
from valve_twin.io.config.valve import load_config
from valve_twin.io.history.tables import CycleRecord
from valve_twin.io.offline.sources import cycle_files
from valve_twin.io.tables.csv_import import LATCHED, STRING_TYPE

TEXT = "/valve:\n  twin:\n    ros__parameters:\n      model: first_order\n      period_s: 0.01\n"


@pytest.fixture
def config(tmp_path):
    (tmp_path / "valve.yaml").write_text(TEXT, encoding="utf-8")
    return load_config(tmp_path / "valve.yaml")[0]


def cycle(number, start_ns, end_ns):
    return CycleRecord(number, start_ns, end_ns, samples=1)


def test_every_cycle_is_told_the_files_that_it_comes_from(tmp_path, config):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/valve/run", STRING_TYPE, qos=(LATCHED,))
        for k in range(6):
            bag.write("/valve/run", encode_string(f"run_{k}"), log_ns=100 * (k + 1))
    cycles = [cycle(1, 100, 150), cycle(2, 160, 199), cycle(3, 250, 350), cycle(4, 110, 690)]
    assert cycle_files(config, bag_info(tmp_path / "bag"), cycles) == {
        1: ("run_0",),
        2: ("run_0",),
        3: ("run_1", "run_2"),
        4: ("run_0", "run_1", "run_2", "run_3", "run_4", "run_5"),
    }


def test_a_bag_that_was_not_imported_names_no_file(tmp_path, config):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic("/other", STRING_TYPE, qos=(LATCHED,))
        bag.write("/other", encode_string("x"), log_ns=1)
    assert cycle_files(config, bag_info(tmp_path / "bag"), [cycle(1, 1, 2)]) == {}


@pytest.mark.parametrize(
    "data", [b"", b"\0\1\0\0", encode_string("abc")[:-2], b"\0\1\0\0\0\0\0\0"]
)
def test_a_text_that_is_cut_is_no_text(data):
    assert decode_string(encode_string("Öl 1")) == "Öl 1"
    with pytest.raises(ValueError, match="no valid String"):
        decode_string(data)
