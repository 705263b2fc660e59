# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples on a grid go together; what is missing, masked or repeated is counted."""

from __future__ import annotations

import math

from valve_twin.nodes.opcua_source.series import Grid
from valve_twin.nodes.opcua_source.tags import Sample

MS = 1_000_000


def samples(*at_ms: float, value: float = 1.0) -> list[Sample]:
    return [Sample(0, round(ms * MS), value) for ms in at_ms]


def test_without_a_period_each_goes_alone():
    runs = list(Grid(0.0).sorted(samples(10, 11, 12), 0))
    assert runs == [(10 * MS, [1.0]), (11 * MS, [1.0]), (12 * MS, [1.0])]


def test_what_keeps_the_period_goes_together_and_a_gap_is_counted():
    grid = Grid(0.001)
    runs = list(grid.sorted(samples(10, 11.05, 12, 15, 16), 0))
    assert [(start, len(values)) for start, values in runs] == [(10 * MS, 3), (15 * MS, 2)]
    assert (grid.samples, grid.missing) == (5, 2)


def test_a_jitter_that_adds_up_does_not_leave_the_grid():
    grid = Grid(0.001)
    runs = list(grid.sorted(samples(*(10 + 1.05 * i for i in range(10))), 0))
    assert len(runs) > 1
    for start, values in runs:
        first = round((start / MS - 10) / 1.05)
        for i in range(len(values)):
            assert abs(10 + 1.05 * (first + i) - (start / MS + i)) <= 0.1 + 1e-9


def test_the_last_value_told_again_is_not_taken_twice():
    grid = Grid(0.001)
    assert list(grid.sorted(samples(10, 11), 0))
    assert list(grid.sorted(samples(11), 0)) == []
    assert (grid.samples, grid.repeated) == (2, 1)


def test_a_clock_that_is_set_back_loses_nothing():
    grid = Grid(0.001)
    runs = list(grid.sorted(samples(3_600_000, 0, 1), 0))
    assert [len(values) for _, values in runs] == [1, 2]
    assert grid.missing == 0


def test_masked_samples_are_counted_and_kept():
    grid = Grid(0.001)
    ((_, values),) = grid.sorted(samples(1, 2, value=math.nan), 0)
    assert len(values) == grid.masked == 2


def test_without_a_stamp_it_is_now():
    assert list(Grid(0.0).sorted([Sample(0, 0, 2.0)], 7 * MS)) == [(7 * MS, [2.0])]


def test_what_came_between_two_connections_is_not_lost_by_the_server():
    grid = Grid(0.001)
    begins = [Sample(0, 3 * MS, 1.0, first=True)]  # as old as it likes
    assert list(grid.sorted([*begins, *samples(10, 11, 13)], 0))
    assert (grid.missing, grid.unheard) == (1, 0)
    again = [Sample(0, 13 * MS, 1.0, first=True)]
    assert list(grid.sorted([*again, *samples(20, 21)], 0))
    assert (grid.missing, grid.unheard, grid.repeated) == (1, 6, 1)
    assert list(grid.sorted([Sample(0, 25 * MS, 1.0, first=True), *samples(29, 31)], 0))
    assert (grid.missing, grid.unheard) == (2, 6 + 3 + 3)


def test_a_clock_that_is_set_forward_loses_nothing_either():
    """A stamp of 9999 counted 25e12 samples as missing; an hour of no word counts."""
    grid, now_ns, hour = Grid(0.01), 1_700_000_000_000_000_000, 3_600_000_000_000
    stamps = [now_ns, 253_370_764_800_000_000_000, now_ns + 10 * MS, now_ns + 30 * MS]
    assert list(grid.sorted([Sample(0, stamp, 1.0) for stamp in stamps], now_ns))
    assert (grid.samples, grid.missing) == (4, 1)
    assert list(grid.sorted([Sample(0, now_ns + hour, 1.0)], now_ns + hour))
    assert grid.missing == 1 + 360_000 - 4


def test_a_gap_of_minutes_inside_a_batch_is_missing_too():
    """Only the first sample of a batch was held to the time since the one before."""
    grid, now_ns, s = Grid(1.0), 1_700_000_000_000_000_000, 1_000_000_000
    assert list(grid.sorted([Sample(0, now_ns, 1.0)], now_ns))
    stamps = [now_ns + 1 * s, now_ns + 101 * s, now_ns + 102 * s]
    assert list(grid.sorted([Sample(0, stamp, 1.0) for stamp in stamps], now_ns + 102 * s))
    assert grid.missing == 99


def test_where_our_own_clock_is_set_back_gaps_count_as_well():
    grid, now_ns, s = Grid(1.0), 1_700_000_000_000_000_000, 1_000_000_000
    assert list(grid.sorted([Sample(0, now_ns, 1.0)], now_ns))
    assert list(grid.sorted([Sample(0, now_ns + 5 * s, 1.0)], now_ns - 3600 * s))
    assert grid.missing == 4


def test_stamps_that_go_back_are_counted_but_for_the_first_of_a_connection():
    grid = Grid(0.0)
    assert list(grid.sorted(samples(10, 20, 15, 16, 30, 1), 0))
    assert grid.late == 2
    assert list(grid.sorted([Sample(0, 0 * MS + 1, 1.0, first=True)], 0))
    assert grid.late == 2
