# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signals are handed on in step, whatever the network does to their order."""

import time

import numpy as np
import pytest

from valve_twin.io.cdr.signals import SignalBlock
from valve_twin.nodes.twin.collector import MOST_WAIT_S, REJOIN_S, SHARE, SLICE_SHARE, Collector

HOLD_BACK_NS = 1_000_000_000
SLICE_NS = round(SLICE_SHARE * HOLD_BACK_NS)
PERIOD_NS = 30_000_000


def block(signal, first, count=1):
    stamps = (first + np.arange(count)) * PERIOD_NS + 1
    return SignalBlock(signal, stamps.astype(np.int64), np.arange(count, dtype=float), True)


@pytest.fixture
def collector():
    return Collector(("position", "v_in"), HOLD_BACK_NS)


def taken(collector, now_s):
    return [(b.signal, len(b.stamp_ns)) for blocks in collector.take(now_s) for b in blocks]


def test_a_sample_leaves_as_soon_as_all_signals_have_reached_it(collector):
    collector.add(block("v_in", 0), 0, 0.0)
    collector.add(block("position", 0), 0, 0.0)
    assert taken(collector, 0.0) == [("v_in", 1), ("position", 1)]
    assert not collector


def test_at_the_pace_of_a_plant_a_silent_signal_holds_nothing_up(collector):
    for n in range(100):
        now = n * 0.03
        collector.add(block("position", n), 0, now)
        if n == 0:
            collector.add(block("v_in", 0), 0, now)
        taken(collector, now + 0.02)
        assert not collector


def test_data_that_runs_ahead_waits_for_a_signal_that_is_on_its_way(collector):
    collector.add(block("position", 0), 0, 0.0)
    collector.add(block("v_in", 0), 0, 0.0)
    taken(collector, 0.0)
    collector.add(block("position", 1, 3000), 0, 0.1)
    assert taken(collector, 1.0) == []
    collector.add(block("v_in", 1, 3000), 0, 3.0)
    assert sum(n for _, n in taken(collector, 3.0)) == 6000


def test_the_end_of_a_rush_waits_until_the_middleware_has_asked_for_what_it_lost(collector):
    """Lagging by 5.1 s of data, a signal was taken for silent after 2.6 s; it came after 3 s."""
    collector.add(block("position", 0), 0, 0.0)
    collector.add(block("v_in", 0), 0, 0.0)
    taken(collector, 0.0)
    collector.add(block("position", 1, 170), 0, 0.1)
    assert 170 * PERIOD_NS * 1e-9 * SHARE < 2.9
    for now_s in (2.6, 2.9):
        assert taken(collector, now_s) == []
    collector.add(block("v_in", 1, 170), 0, 3.0)
    assert sum(n for _, n in taken(collector, 3.0)) == 340


def test_within_the_patience_of_the_core_the_end_of_a_rush_is_handed_on_soon(collector):
    """The core waits by itself then."""
    collector.add(block("position", 0), 0, 0.0)
    collector.add(block("v_in", 0), 0, 0.0)
    taken(collector, 0.0)
    collector.add(block("position", 1, 33), 0, 0.1)
    assert 33 * PERIOD_NS <= HOLD_BACK_NS
    assert taken(collector, 0.4) == []
    assert taken(collector, 0.6) == [("position", 17), ("position", 16)]


def test_a_signal_that_fell_silent_at_the_pace_of_a_plant_holds_nothing_up_when_all_stops(
    collector,
):
    for n in range(100):
        now = n * 0.03
        collector.add(block("position", n), 0, now)
        if n < 50:
            collector.add(block("v_in", n), 0, now)
        taken(collector, now + 0.02)
    assert not collector


@pytest.mark.parametrize(
    ("first", "count"),
    [(400, 1), (400, 850), (1, 850)],
    ids=["of a plant", "of a plant, sent at once", "of a player alone"],
)
def test_after_a_pause_of_all_a_signal_is_waited_for_before_its_samples_are_guessed(
    collector, first, count
):
    """It had been quiet for as long as it lagged, or longer: taken for silent at once."""
    for signal in ("position", "v_in"):
        collector.add(block(signal, 0), 0, 0.0)
    taken(collector, 0.0)
    collector.add(block("position", first, count), 0, 12.0)
    assert taken(collector, 12.0) == []
    assert taken(collector, 12.4) == []
    collector.add(block("v_in", first, count), 0, 12.4)
    assert sum(n for _, n in taken(collector, 12.4)) == 2 * count


def test_a_signal_that_died_in_a_pause_of_all_holds_the_others_up_once(collector):
    for signal in ("position", "v_in"):
        collector.add(block(signal, 0), 0, 0.0)
    taken(collector, 0.0)
    for n in range(100):
        now = 12.0 + n * 0.03
        collector.add(block("position", 400 + n), 0, now)
        taken(collector, now + 0.02)
        assert bool(collector) is (now + 0.02 < 12.0 + REJOIN_S)


def test_a_dead_signal_is_waited_for_only_so_long(collector):
    collector.add(block("v_in", 0), 0, 0.0)
    collector.add(block("position", 0, 3000), 0, 0.0)
    assert sum(n for s, n in taken(collector, MOST_WAIT_S - 0.1) if s == "position") == 1
    assert sum(n for s, n in taken(collector, MOST_WAIT_S + 0.1) if s == "position") == 2999


def test_no_signal_runs_ahead_of_the_others_by_more_than_a_slice(collector):
    collector.add(block("position", 0, 500), 0, 0.0)
    collector.add(block("v_in", 0, 500), 0, 0.0)
    reached = {"position": 0, "v_in": 0}
    for part in (b for blocks in collector.take(0.0) for b in blocks):
        reached[part.signal] = int(part.stamp_ns[-1])
        assert abs(reached["position"] - reached["v_in"]) <= SLICE_NS + PERIOD_NS
    assert reached["position"] == reached["v_in"]


def test_a_clock_that_is_set_back_does_not_hold_the_new_samples(collector):
    for signal in ("position", "v_in"):
        collector.add(block(signal, 1000), 0, 0.0)
    taken(collector, 0.0)
    for signal in ("position", "v_in"):
        collector.add(block(signal, 10), 0, 0.1)
    assert taken(collector, 0.1) == [("position", 1), ("v_in", 1)]


def test_everything_leaves_on_demand(collector):
    collector.add(block("position", 0, 10), 0, 0.0)
    assert [len(b.stamp_ns) for blocks in collector.take_all() for b in blocks] == [10]


def test_a_clock_that_is_set_on_by_years_costs_no_time(collector):
    """Slices between the samples were counted through: hours without an end."""
    years = 1_700_000_000 * 10**9 // PERIOD_NS
    for first in (0, years):
        for signal in ("position", "v_in"):
            collector.add(block(signal, first), 0, 0.0)
    begin = time.process_time()
    rounds = [[(b.signal, int(b.stamp_ns[0])) for b in r] for r in collector.take_all()]
    assert time.process_time() - begin < 1.0
    late = years * PERIOD_NS + 1
    assert rounds == [[("position", 1), ("v_in", 1)], [("position", late), ("v_in", late)]]


def test_what_is_stamped_back_within_a_block_is_handed_on_too(collector):
    """Behind a stamp that no later one reached, samples were lost."""
    collector.add(block("position", 0, 100), 0, 0.0)
    collector.add(block("position", 3, 2), 0, 0.0)
    sizes = [sum(len(b.stamp_ns) for b in r) for r in collector.take_all()]
    assert sum(sizes) == 102
