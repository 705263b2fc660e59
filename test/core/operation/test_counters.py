# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters over many cycles against what was made, wherever the stream is cut."""

from functools import reduce
from itertools import pairwise

import numpy as np
import pytest

from test.core.estimation.cycle.test_movement import strokes
from valve_twin.core.operation.counters import SPAN_SHARES, Counters, cycle_duty
from valve_twin.core.types import Cycle, Frames

PERIOD_S = 0.01
STEP_NS = round(1e9 * PERIOD_S)


def frames(position, first=0, valid=None):
    n = len(position)
    none = np.full(n, np.nan)
    stamps = (first + np.arange(n)) * STEP_NS
    valid = np.ones(n, bool) if valid is None else valid
    return Frames(stamps, position, np.zeros((n, 1)), none, none, valid)


def cut(position, cuts):
    """Return the cycles of a record that is cut before these samples."""
    edges = [0, *cuts, len(position)]
    return [
        Cycle(k, PERIOD_S, frames(position[a:b], a)) for k, (a, b) in enumerate(pairwise(edges), 1)
    ]


def counted(cycles, *, normalised=True, begin=None):
    duties = [cycle_duty(c, normalised=normalised) for c in cycles]
    return reduce(Counters.after, [d for d in duties if d is not None], begin or Counters())


@pytest.mark.no_cover
@pytest.mark.parametrize(("noise", "parts"), [(0.0, 2), (1e-4, 10), (1e-3, 2)])
def test_a_million_reversals_count_to_one_and_travel_to_a_thousandth_however_cut(noise, parts):
    """Parts of 100 001 movements, each cut at random: 20 cycles, most of them in motion."""
    rng = np.random.default_rng(12)
    total, way, moves, edge = Counters(), 0.0, 0, 0.0
    for _ in range(parts):
        position, made = strokes(rng, 100_001, least=0.1, samples=40)
        # to and fro about the middle: the record goes on where the one before ended
        position = edge + position - position[0]
        edge, way, moves = float(position[-1]), way + made, moves + 100_001
        seen = position + noise * rng.standard_normal(len(position))
        cuts = np.sort(rng.choice(np.arange(20, len(seen) - 20), 20, replace=False))
        total = counted(cut(seen, cuts), begin=total)
    # two parts that meet in the same direction are one movement
    assert total.movements in {moves, *(moves - parts + n for n in (0, 1, 2))}
    assert abs(total.reversals - (total.movements - 1)) == 0
    assert sum(total.spans) == total.reversals
    assert total.travel == pytest.approx(way, rel=1e-3)
    assert total.strokes == total.travel


def square(strokes_, rest, ramp):
    """Return strokes between 0 and 1 with rests between them [samples]."""
    up = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, ramp))
    one = np.concatenate([np.zeros(rest), up, np.ones(rest), up[::-1]])
    return np.concatenate([*[one] * strokes_, np.zeros(rest)])


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("every", [997, 340, 10**6])
def test_starts_hours_and_spans_do_not_depend_on_where_cycles_end(noise, every):
    rng = np.random.default_rng(3)
    position = square(60, 300, 50)
    shut, near = (int(np.count_nonzero(position < share)) for share in (0.01, 0.1))
    position = position + noise * rng.standard_normal(len(position))
    found = counted(cut(position, range(every, len(position), every)))
    assert (found.movements, found.starts) == (120, 120)
    assert found.spans[-2:] == (0, 119) or sum(found.spans[-2:]) == 119
    seconds = 1e-9 * np.array([found.length_ns, found.open_ns, found.closed_ns])
    assert seconds[0] == pytest.approx(PERIOD_S * (len(position) - found.cycles))
    assert seconds[1] + seconds[2] == pytest.approx(seconds[0])
    assert seconds[2] == pytest.approx(PERIOD_S * shut, rel=0.01)
    assert 1e-9 * found.near_ns == pytest.approx(PERIOD_S * (near - shut), rel=0.05)


def test_a_slow_ramp_and_a_smooth_swing_start_once_at_most():
    noise = 1e-3 * np.random.default_rng(5).standard_normal(20_000)
    ramp = np.linspace(0.0, 1.0, 20_000) + noise
    swing = 0.5 + 0.5 * np.sin(np.linspace(0.0, 40 * np.pi, 20_000)) + noise
    assert counted(cut(ramp, ())).starts <= 1
    assert counted(cut(swing, ())).starts <= 1
    assert counted(cut(swing, ())).movements == 41


def test_what_moves_between_two_cycles_counts_with_its_net_way():
    up = np.concatenate([np.zeros(50), np.linspace(0.0, 1.0, 20), np.ones(50)])
    cycles = [Cycle(k, PERIOD_S, frames(up, 200 * k)) for k in (1, 2, 3)]
    found = counted(cycles)
    assert (found.movements, found.reversals) == (5, 4)
    assert found.travel == pytest.approx(5.0, rel=1e-6)


def test_a_refused_cycle_counts_where_its_position_is_good():
    position = square(2, 50, 20)
    good = Cycle(7, PERIOD_S, frames(position), accepted=False, reason="no command")
    assert counted([good]).movements == 4
    valid = np.arange(len(position)) % 2 == 0
    bad = Cycle(8, PERIOD_S, frames(position, valid=valid))
    assert cycle_duty(bad, normalised=True) is None


def test_a_gap_adds_no_time_open():
    position = np.ones(200)
    one = frames(position)
    later = np.where(np.arange(200) < 100, 0, 10**12)
    gap = Frames(one.stamp_ns + later, *(getattr(one, n) for n in one.__slots__[1:]))
    found = counted([Cycle(1, PERIOD_S, gap)])
    assert found.open_ns == 198 * STEP_NS
    assert found.length_ns == 199 * STEP_NS + 10**12


def test_the_stroke_of_a_position_in_its_own_unit_is_that_of_the_first_cycle_that_moves():
    position = 3.0 + 40.0 * square(3, 100, 50)
    found = counted(cut(position, ()), normalised=False)
    assert (found.closed, found.stroke) == (pytest.approx(3.0), pytest.approx(40.0))
    assert found.strokes == pytest.approx(6.0)
    assert len(found.edges) == len(SPAN_SHARES) + 1
    still = counted([Cycle(1, PERIOD_S, frames(np.full(100, 3.0)))], normalised=False)
    assert still.cycles == 1
    assert np.isnan(still.strokes)
