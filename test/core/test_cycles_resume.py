# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cutting after a restart: the same cycles under the same numbers, never a part for a whole."""

from __future__ import annotations

import pytest

from test.core.test_cycles import PRESS, cycles_of, make_frames, press_frames, run
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.state import Announced, Resume
from valve_twin.core.types import CycleRule

N = 300
FRAMES = press_frames(6)


def undisturbed():
    return cycles_of(run(PRESS, FRAMES)[1])


def resumed(last, frames, announced=Announced(), config=PRESS):  # noqa: B008 - a frozen value
    """Cut `frames` after a restart, when `last` was the last cycle that was stored."""
    resume = Resume(last.start_ns, last.end_ns, announced)
    items = run(config, frames, last_cycle=last.number, resumed=True, resume=resume)[1]
    return cycles_of(items)


def seen(cycles):
    return [(c.number, c.start_ns, c.end_ns, c.missed_cycles) for c in cycles]


@pytest.mark.parametrize("back", range(0, N, 25))
def test_data_given_again_from_the_last_stored_cycle_on_gives_the_same_cycles(back):
    whole = undisturbed()
    begin = 2 * N + 20 - back  # cycle 3 begins here
    again = resumed(whole[1], FRAMES[begin:])
    assert seen(again) == seen(whole[2:])


def test_a_number_that_was_told_is_not_given_to_a_later_cycle():
    whole = undisturbed()
    told = Announced(3, whole[2].start_ns)
    later = resumed(whole[1], FRAMES[3 * N + 15 :], told)
    assert [c.number for c in later] == [4]
    assert later[0].start_ns == whole[4].start_ns
    assert later[0].missed_cycles == -1


def test_the_same_cycle_gets_the_number_again_that_was_told():
    whole = undisturbed()
    told = Announced(4, whole[3].start_ns)
    again = resumed(whole[1], FRAMES[2 * N - 100 :], told)
    assert seen(again) == seen(whole[2:])


@pytest.mark.parametrize("at", range(30, N, 20))
def test_a_restart_inside_a_cycle_never_takes_its_rest_for_a_whole(at):
    whole = undisturbed()
    rest = resumed(whole[1], FRAMES[2 * N + at :])
    starts = {c.start_ns for c in whole}
    assert rest
    assert all(c.start_ns in starts for c in rest)
    assert rest[0].missed_cycles == -1


@pytest.mark.parametrize("rule", [CycleRule.COUNTER, CycleRule.WINDOW])
def test_nor_under_a_counter_or_in_a_window(rule):
    counter = [float(i // 100 + 5) for i in range(600)]
    frames = make_frames(600, counter=counter)
    config = CycleConfig(rule=rule, window_s=3.0)
    whole = cycles_of(run(config, frames)[1])
    assert len(whole) >= 4
    rest = resumed(whole[1], frames[330:], config=config)
    starts = {c.start_ns for c in whole}
    assert rest
    assert all(c.start_ns in starts for c in rest)


def test_a_valve_that_was_killed_before_its_first_store_keeps_the_number_it_told():
    whole = undisturbed()
    resume = Resume(announced=Announced(1, whole[0].start_ns))
    again = cycles_of(run(PRESS, FRAMES, resume=resume)[1])
    assert seen(again) == seen(whole)
    later = cycles_of(run(PRESS, FRAMES[N + 10 :], resume=resume)[1])
    assert later[0].number == 2
    assert later[0].start_ns == whole[2].start_ns
