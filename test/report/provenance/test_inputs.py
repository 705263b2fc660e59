# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hashes of the input: blind to how a bag is packed, not to one bit of one sample."""

import dataclasses

import numpy as np
import pytest

from valve_twin.io.cdr.signals import SignalBlock, SignalSource
from valve_twin.io.config.valve import ValveConfig
from valve_twin.report.provenance import inputs
from valve_twin.report.provenance.inputs import bag_origin, history_origin, history_rows, rows_part

STAMPS = np.arange(100, dtype=np.int64) * 10_000_000


CONFIG = ValveConfig("/v", "positioner", 0.01, 0.0, {"position": SignalSource("position", "/p")})


@pytest.fixture
def part(tmp_path, monkeypatch):
    """Return a function that hashes samples given in blocks that begin at some places."""
    (tmp_path / "bag.mcap").write_bytes(b"12345")

    def run(values, stamps=STAMPS, cuts=(), *, header=True):
        pieces = zip(np.split(stamps, cuts), np.split(values, cuts), strict=True)
        blocks = [SignalBlock("position", s, v, header, s) for s, v in pieces]
        monkeypatch.setattr(inputs, "read_signals", lambda *_: iter(blocks))
        origin = bag_origin(CONFIG, tmp_path / "bag.mcap")
        assert origin.size == 5
        return origin.parts["position"]

    return run


def test_the_division_into_blocks_does_not_count(part):
    values = np.sin(np.arange(100.0))
    assert part(values) == part(values, cuts=(1, 40, 99))
    assert part(values).count == 100


def test_every_bit_counts(part):
    values = np.sin(np.arange(100.0))
    one = part(values)
    nudged = values.copy()
    nudged[50] = np.nextafter(nudged[50], 2.0)
    later = STAMPS.copy()
    later[99] += 1
    assert part(nudged) != one
    assert part(values, later) != one
    assert part(values, header=False) != one
    assert part(values[::-1].copy()) != one


def test_rows_of_a_history_count_by_kind(example):
    data = example.report_data()
    one = history_origin(data)
    assert one == history_origin(example.report_data())
    assert one.parts["estimates"].count == len(data.estimates)
    first = dataclasses.replace(data.estimates[0], mse_test=0.125)
    other = dataclasses.replace(data, estimates=(first, *data.estimates[1:]))
    parts = history_origin(other).parts
    assert [n for n in parts if parts[n] != one.parts[n]] == ["estimates"]
    rows = history_rows(data)["cycles"]
    assert rows_part(rows[:3]) != rows_part(rows[1:4])
