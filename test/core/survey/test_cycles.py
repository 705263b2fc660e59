# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where the cycles of a cylinder begin: its command rests in mid-range, its answer stays."""

import numpy as np
import pytest

from valve_twin.core.survey.cycles import plan_cycles, short_windows, strokes_from_rest
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.types import CycleRule

STEP_S, REST = 0.1, 0.5


def cylinder(programmes):
    """Return command and position: moves of (opening, seconds) with rests of 3 s behind each."""
    command = [np.full(20, REST)]
    for programme in programmes:
        for opening, seconds in programme:
            command += [np.full(round(seconds / STEP_S), REST + opening), np.full(30, REST)]
    u = np.concatenate(command)
    position = np.cumsum(np.append(0.0, 0.2 * STEP_S * (u - REST)))[:-1]
    stamps = np.rint(np.arange(len(u)) * STEP_S * 1e9).astype(np.int64)
    return Signal("command", stamps, u), Signal("answer", stamps, position)


MOVES = ((0.4, 4.0), (0.3, 4.0), (-0.3, 3.0), (0.2, 2.0), (-0.5, 4.6))


def test_a_cycle_begins_where_the_answer_leaves_its_end_and_not_with_each_move():
    plan = strokes_from_rest(*cylinder([MOVES] * 4))
    assert plan is not None
    assert plan.rule is CycleRule.REFERENCE
    assert plan.count == 4
    assert REST < float(plan.values["reference_level"]) < REST + 0.2
    rises_s = (0.0, 7.0, 20.0)  # of the moves up of a programme
    whole_s = sum(s + 3.0 for _, s in MOVES)
    assert rises_s[-1] < float(plan.values["min_cycle_s"]) < whole_s


@pytest.mark.parametrize(
    "programmes",
    [
        [MOVES],  # once only
        [[(0.4, 4.0), (-0.4, 4.0)], [*MOVES[:-1], *MOVES[:4], (-0.5, 9.2)]] * 2,  # short, long
    ],
)
def test_cycles_that_no_least_length_tells_apart_are_not_cut_so(programmes):
    assert strokes_from_rest(*cylinder(programmes)) is None


def test_a_command_that_never_drives_back_is_none_of_a_cylinder():
    command, answer = cylinder([[(0.4, 4.0), (0.3, 4.0)]] * 3)
    assert strokes_from_rest(command, answer) is None


def program(levels, cycles=40, wave=0.03):
    """Return a command of some levels, 1 s each, as large as load and product want it."""
    size = 1.0 + wave * np.sin(np.arange(cycles) / 3.0)
    u = np.concatenate([s * np.repeat(levels, 10) for s in size])
    u = (u - u.min()) / np.ptp(u)
    return Signal("command", np.rint(np.arange(len(u)) * STEP_S * 1e9).astype(np.int64), u)


def test_a_command_both_ways_leaves_its_rest_in_every_cycle():
    plan = plan_cycles([program((0.0, 0.6, 0.6, 0.0, -0.4, -0.4))], STEP_S, has_counter=False)
    assert (plan.rule, plan.count) == (CycleRule.REFERENCE, 40)
    assert float(plan.values["reference_level"]) == pytest.approx(0.42, abs=0.02)


def test_a_pause_hides_no_rest_in_mid_range():
    whole = program((0.0, 0.6, 0.6, 0.0, -0.4, -0.4)).values
    u = np.concatenate((whole[:1200], np.full(600, whole[0]), whole[1200:]))
    stamps = np.rint(np.arange(len(u)) * STEP_S * 1e9).astype(np.int64)
    plan = plan_cycles([Signal("command", stamps, u)], STEP_S, has_counter=False)
    assert (plan.rule, plan.count) == (CycleRule.REFERENCE, 40)


def test_a_hold_in_mid_range_is_no_rest_where_the_command_leaves_its_lowest_level_as_evenly():
    levels = (0.0, 0.5, 0.5, 0.5, 1.0, 1.0)
    plan = plan_cycles([program(levels, wave=0.0)], STEP_S, has_counter=False)
    assert (plan.rule, plan.count) == (CycleRule.REFERENCE, 40)
    assert float(plan.values["reference_level"]) == pytest.approx(0.02)


def wave(seconds, period_s, *, turns_s=2.0):
    """Return a command that turns every so many seconds."""
    t = np.arange(round(seconds / period_s)) * period_s
    stamps = np.rint(t * 1e9).astype(np.int64)
    return Signal("command", stamps, 0.5 + 0.4 * np.sin(np.pi * t / turns_s))


def test_a_short_record_that_moves_much_has_windows_enough_for_a_reference_and_a_verdict():
    command = wave(180.0, 0.01)
    count = short_windows(command, 180.0, 0.01)
    assert count == 15  # six turns each
    plan = plan_cycles([command], 0.01, has_counter=False)
    assert plan.rule is CycleRule.WINDOW
    assert plan.values["window_s"] == pytest.approx(180.0 / count, rel=1e-3)


def test_windows_of_a_short_record_keep_samples_and_moves_enough():
    assert short_windows(wave(180.0, 0.06), 180.0, 0.06) == 15  # 200 samples each
    assert short_windows(wave(180.0, 0.3), 180.0, 0.3) == 0  # 3 are none for a verdict
    assert short_windows(wave(180.0, 0.01, turns_s=60.0), 180.0, 0.01) == 0
    assert short_windows(wave(7200.0, 0.1), 7200.0, 0.1) == 40
    still = Signal("command", np.arange(500) * 10**9, np.full(500, 0.3))
    assert short_windows(still, 500.0, 1.0) == 0


def test_a_dither_makes_no_moves():
    command = wave(180.0, 0.01, turns_s=60.0)
    dither = 0.03 * np.sin(np.arange(len(command.values)))
    assert short_windows(Signal("u", command.stamp_ns, command.values + dither), 180.0, 0.01) == 0
