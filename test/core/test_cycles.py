# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cutting a stream into cycles, by every rule and for every split of the stream."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.cycles import Closing, Segmenter
from valve_twin.core.refusal import RefusalCode
from valve_twin.core.state import Part
from valve_twin.core.types import Cycle, CycleRule, Frames, join_frames

PERIOD_S = 0.03
INPUTS = ("v_in", "v_out")


def make_frames(n, *, v_in=None, v_out=None, counter=None, reference=None, start_ns=10**9):
    stamps = start_ns + np.arange(n, dtype=np.int64) * round(PERIOD_S * 1e9)
    zeros, nothing = np.zeros(n), np.full(n, np.nan)
    inputs = np.column_stack([zeros if v_in is None else v_in, zeros if v_out is None else v_out])
    return Frames(
        stamps,
        zeros.copy(),
        np.ascontiguousarray(inputs),
        nothing if counter is None else np.asarray(counter, dtype=float),
        nothing if reference is None else np.asarray(reference, dtype=float),
        np.ones(n, dtype=bool),
    )


def press_frames(cycles=3, n=300):
    """A press cycle: open, hold with two short corrections, close, rest."""
    v_in, v_out = np.zeros(cycles * n), np.zeros(cycles * n)
    for c in range(cycles):
        v_in[c * n + 20 : c * n + 60] = 0.5
        v_in[c * n + 100 : c * n + 104] = 0.1
        v_out[c * n + 120 : c * n + 123] = 0.1
        v_in[c * n + 140 : c * n + 144] = 0.1
        v_out[c * n + 200 : c * n + 220] = 0.6
    return make_frames(cycles * n, v_in=v_in, v_out=v_out)


def run(config, frames, cuts=(), **kwargs):
    segmenter = Segmenter(config, INPUTS, PERIOD_S, **kwargs)
    items = []
    edges = [0, *sorted(cuts), len(frames)]
    for a, b in itertools.pairwise(edges):
        if b > a:
            items += segmenter.push(frames[a:b])
    return segmenter, items


def cycles_of(items):
    return [i for i in items if isinstance(i, Cycle)]


PRESS = CycleConfig(rearm_signal="v_out", min_cycle_s=2.0, idle_close_s=30.0)


def test_hold_corrections_do_not_open_a_cycle():
    frames = press_frames(3)
    segmenter, items = run(PRESS, frames)
    cycles = cycles_of(items)
    assert [c.number for c in cycles] == [1, 2]
    assert cycles[0].start_ns == frames.stamp_ns[20]
    assert cycles[0].end_ns == frames.stamp_ns[319]
    assert segmenter.running == 3
    assert [c.number for c in segmenter.close(Closing.END)] == [3]


def test_a_command_without_the_return_stroke_would_open_one():
    plain = CycleConfig(min_cycle_s=1.0, idle_close_s=30.0)
    _, items = run(plain, press_frames(1))
    assert len([i for i in items if isinstance(i, Part) and i.opens]) == 3


def test_a_night_is_not_part_of_a_cycle():
    config = CycleConfig(rearm_signal="v_out", min_cycle_s=2.0, idle_close_s=5.0)
    frames = press_frames(1, n=1000)
    segmenter, items = run(config, frames)
    (cycle,) = cycles_of(items)
    assert cycle.end_ns < frames.stamp_ns[219] + 5.1e9
    assert segmenter.running == 0
    assert items[-1].number == 0


@given(st.lists(st.integers(0, 900), max_size=12))
@settings(max_examples=40)
def test_any_split_of_the_stream_gives_the_same_cycles(cuts):
    frames = press_frames(3)
    whole = cycles_of(run(PRESS, frames)[1])
    split = cycles_of(run(PRESS, frames, cuts)[1])
    assert [(c.number, c.start_ns, c.end_ns, c.reason) for c in split] == [
        (c.number, c.start_ns, c.end_ns, c.reason) for c in whole
    ]
    for a, b in zip(whole, split, strict=True):
        assert np.array_equal(a.frames.inputs, b.frames.inputs)


def stuck_frames(level, rearmed_at=2600):
    """Four press cycles, then a command that stays at `level` and comes back late."""
    usual = press_frames(4)
    v_in, v_out = np.full(2100, level), np.zeros(2100)
    v_in[:20] = 0.0
    v_in[rearmed_at - 1200 : rearmed_at - 1180] = 0.0
    v_out[rearmed_at - 1200 : rearmed_at - 1180] = 0.6
    stuck = make_frames(
        2100, v_in=v_in, v_out=v_out, start_ns=int(usual.stamp_ns[-1]) + 30_000_000
    )
    return join_frames([usual, stuck])


@given(st.lists(st.integers(1, 3299), max_size=6))
@settings(max_examples=30, deadline=None)
def test_a_cycle_in_which_nothing_answers_is_overdue_for_every_split(cuts):
    frames = stuck_frames(0.7)
    segmenter, items = run(PRESS, frames, cuts)
    cycles = cycles_of(items)
    assert [c.number for c in cycles] == [1, 2, 3, 4, 5]
    # 3 usual lengths of 300 samples after it began; no cycle until the return stroke
    assert cycles[4].start_ns == frames.stamp_ns[1220]
    assert cycles[4].end_ns == frames.stamp_ns[1220 + 899]
    (begun,) = [i for i in items if isinstance(i, Part) and i.opens and i.number == 6]
    assert begun.frames.stamp_ns[0] == frames.stamp_ns[2620]
    assert segmenter.running == 6


def test_a_long_hold_is_not_overdue():
    _, items = run(PRESS, stuck_frames(0.1))
    assert [c.number for c in cycles_of(items)] == [1, 2, 3, 4, 5]
    assert len(cycles_of(items)[4].frames) == 1400


def test_counter_numbers_the_cycles_and_counts_the_missed():
    counter = np.repeat([7.0, 8.0, 11.0, 12.0], 50)
    _, items = run(CycleConfig(rule=CycleRule.COUNTER), make_frames(200, counter=counter))
    assert [(c.number, c.missed_cycles) for c in cycles_of(items)] == [(7, 0), (8, 0), (11, 2)]


def test_counter_after_a_restart_tells_what_was_missed():
    counter = np.repeat([20.0, 21.0], 50)
    config = CycleConfig(rule=CycleRule.COUNTER)
    _, items = run(config, make_frames(100, counter=counter), last_cycle=12, resumed=True)
    assert [(c.number, c.missed_cycles) for c in cycles_of(items)] == [(20, 7)]


def test_counter_that_starts_again_goes_on_counting_and_says_so():
    counter = np.repeat([40.0, 41.0, 1.0, 2.0, 4.0, 5.0], 50)
    _, items = run(CycleConfig(rule=CycleRule.COUNTER), make_frames(300, counter=counter))
    found = [(c.number, c.missed_cycles) for c in cycles_of(items)]
    assert found == [(40, 0), (41, 0), (42, -1), (43, 0), (45, 1)]


def test_commands_after_a_restart_leave_the_missed_cycles_unknown():
    _, items = run(PRESS, press_frames(3), last_cycle=41, resumed=True)
    assert [(c.number, c.missed_cycles) for c in cycles_of(items)] == [(42, -1), (43, 0)]


def test_reference_opens_a_cycle_at_each_rise():
    reference = np.tile(np.concatenate([np.zeros(50), np.ones(50)]), 3)
    config = CycleConfig(rule=CycleRule.REFERENCE, min_cycle_s=1.0)
    frames = make_frames(300, reference=reference)
    _, items = run(config, frames)
    assert [c.start_ns for c in cycles_of(items)] == [frames.stamp_ns[50], frames.stamp_ns[150]]


def test_windows_stand_on_the_stamps():
    config = CycleConfig(rule=CycleRule.WINDOW, window_s=3.0)
    frames = make_frames(350)  # the first stamp is 1 s: the first window is short
    _, items = run(config, frames)
    assert [len(c.frames) for c in cycles_of(items)] == [67, 100, 100]


def test_too_short_a_cycle_is_refused_with_its_length():
    config = CycleConfig(rule=CycleRule.COUNTER)
    _, items = run(config, make_frames(104, counter=np.repeat([1.0, 2.0], [4, 100])))
    (cycle,) = cycles_of(items)
    assert not cycle.accepted
    assert "4 samples, fewer than 8" in cycle.reason


def test_a_cycle_cut_off_by_the_end_of_the_record_is_refused():
    frames = press_frames(3)
    for samples, accepted in ((895, True), (760, False)):
        segmenter, _ = run(PRESS, frames[:samples])
        (last,) = segmenter.close(Closing.END)
        assert last.number == 3
        assert last.accepted is accepted
    assert "cut off: 140 samples of the usual 300" in last.reason


@pytest.mark.parametrize(
    ("end", "accepted"), [(1.0, True), (1.04, True), (1.1, False), (float("nan"), False)]
)
def test_a_short_last_stroke_that_came_back_is_whole(end, accepted):
    """200 samples beside cycles of 300: at rest where it began, within 5 % of the stroke."""
    frames = press_frames(3)
    stroke = np.sin(np.pi * np.arange(180) / 180.0)
    position = np.concatenate([np.zeros(620), stroke, np.full(100, end - 1.0)])
    segmenter, _ = run(PRESS, replace(frames, position=position)[:860])
    (last,) = segmenter.close(Closing.END)
    assert len(last.frames) == 240
    assert last.accepted is accepted


def test_a_wrong_sampling_time_is_named_not_estimated():
    segmenter = Segmenter(PRESS, INPUTS, 1.0)
    cycles = cycles_of(segmenter.push(press_frames(3)))
    assert [c.accepted for c in cycles] == [False, False]
    assert "0.03 s apart (median) but period_s is 1 s: correct period_s" in cycles[0].reason


def accepted_with_late(signal, at, config=None):
    """Return which of four cycles are accepted where a signal is told of as late at one frame."""
    segmenter, frames = Segmenter(config or PRESS, INPUTS, PERIOD_S), press_frames(4)
    items = segmenter.push(frames[:at])
    segmenter.mark_late({signal})
    items += [i for a in range(at, 1200, 5) for i in segmenter.push(frames[a : a + 5])]
    cycles = [*cycles_of(items), *segmenter.close(Closing.ASKED)]
    assert [c.reason.code for c in cycles if not c.accepted] == [
        RefusalCode.LATE for c in cycles if not c.accepted
    ]
    assert sum(not c.reproducible for c in cycles) == 1
    return [c.accepted for c in cycles]


def test_a_cycle_is_refused_where_the_signal_that_cuts_it_came_too_late():
    assert accepted_with_late("v_in", 400) == [True, False, True, True]
    assert accepted_with_late("v_out", 400) == [True, False, True, True]  # it re-arms the rule
    assert accepted_with_late("load", 400) == [True] * 4


def test_so_is_a_cycle_that_opens_with_the_samples_that_came_too_late():
    assert accepted_with_late("v_in", 320) == [False, False, True, True]
    assert accepted_with_late("v_in", 10) == [True] * 4  # before the first one


def test_windows_on_the_stamps_are_cut_right_whatever_comes_late():
    window = CycleConfig(rule=CycleRule.WINDOW, window_s=9.0)
    assert all(accepted_with_late("v_in", 400, window))


def test_gaps_are_counted_as_lost_samples():
    frames = press_frames(2)
    keep = np.ones(600, dtype=bool)
    keep[[100, 101, 150]] = False
    thinned = frames[keep]
    (cycle,) = cycles_of(run(PRESS, thinned)[1])
    assert cycle.lost == 3
    assert not cycle.reproducible


def test_reset_drops_the_running_cycle_and_goes_on_counting():
    segmenter, _ = run(PRESS, press_frames(1))
    segmenter.reset()
    assert segmenter.running == 0
    items = segmenter.push(press_frames(2))
    assert [(c.number, c.missed_cycles) for c in cycles_of(items)] == [(2, -1)]


def test_an_unknown_command_is_named():
    with pytest.raises(
        ValueError, match=r"cycles\.rearm_signal: 'vout' is no command .* v_in, v_out"
    ):
        Segmenter(CycleConfig(rearm_signal="vout"), INPUTS, PERIOD_S)
