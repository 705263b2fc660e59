# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a second reader is made, when it stands in for the first, and when it goes."""

from typing import Any
from weakref import WeakSet

import numpy as np
import pytest

from valve_twin.nodes.runtime.second_reader import (
    CALM_S,
    LOOK_S,
    MOST_KEPT,
    PASSED_S,
    PATIENCE_S,
    QUIET_S,
    RESENT_S,
    START_S,
    Pace,
    SecondReader,
)


class Bench:
    """A second reader on a clock of its own."""

    def __init__(self):
        self.made: list[Any] = []
        self.gone: list[Any] = []
        self.taken: list[Any] = []
        self.now_s = 0.0
        self.reader = SecondReader(self.subscribe, self.gone.append, self.deliver)

    def subscribe(self, callback):
        self.made.append(callback)
        return callback

    def deliver(self, *arguments):
        self.taken.append(arguments)

    def run(self, seconds, *, first=0.0, second=0.0):
        """Let time pass; the readers hear something every so many seconds, 0 = never."""
        deaf, begin_s = 0, self.now_s
        due = {"first": first, "second": second}
        while self.now_s < begin_s + seconds:
            self.now_s += LOOK_S
            if first and self.now_s - begin_s >= due["first"] - 1e-9:
                self.reader.heard, due["first"] = True, due["first"] + first
            if second and self.made and self.now_s - begin_s >= due["second"] - 1e-9:
                self.made[-1](f"at {self.now_s:.1f}", {})
                due["second"] += second
            deaf += self.reader.look(self.now_s)
        return deaf


@pytest.fixture
def bench(monkeypatch):
    """Return a bench in a process of its own, as it were."""
    monkeypatch.setattr(SecondReader, "_doubted", WeakSet())
    return Bench()


def test_nothing_is_made_of_a_topic_that_was_never_heard(bench):
    assert bench.run(100.0) == 0
    assert not bench.made


def test_who_hears_nothing_from_the_start_on_though_somebody_speaks_is_deaf(bench):
    bench.reader.expect(0.0)
    assert bench.run(START_S - 2.0 * LOOK_S) == 0
    assert not bench.made
    assert bench.run(PATIENCE_S + 6.0 * LOOK_S, second=LOOK_S) == 1
    assert bench.taken, "it stands in"
    bench.run(LOOK_S, first=LOOK_S)
    assert bench.gone == bench.made
    assert not bench.reader.never_heard


def test_a_slow_topic_is_known_by_its_first_pause(bench):
    assert bench.run(12.0, first=1.0) == 0
    assert len(bench.made) <= 1
    assert bench.gone == bench.made


def test_who_waits_for_a_publisher_that_says_nothing_is_not_deaf(bench):
    bench.reader.expect(0.0)
    assert bench.run(60.0) == 0
    assert len(bench.made) == 1, "one for the whole silence"
    assert bench.run(1.0, first=LOOK_S, second=LOOK_S) == 0
    assert bench.gone == bench.made
    assert not bench.taken


def test_what_the_second_hears_and_the_first_does_not_tells_that_it_is_deaf(bench):
    bench.run(2.0, first=LOOK_S)
    assert not bench.made
    assert bench.run(QUIET_S + PATIENCE_S + 3.0 * LOOK_S, second=LOOK_S) == 1
    assert len(bench.made) == 1
    before = len(bench.taken)
    assert before > 0, "what it had kept is delivered"
    assert bench.run(1.0, second=LOOK_S) == 0, "told once"
    assert len(bench.taken) > before, "it stands in"
    bench.run(LOOK_S, first=LOOK_S)
    assert bench.gone == bench.made, "the first is heard again"
    assert not bench.reader.stands_in


@pytest.fixture
def told(bench):
    """Return what a first reader was told to pass over: where that is possible it is heard."""
    passed: list[Any] = []

    def pass_over(newest: Any) -> bool:
        passed.append(newest)
        return True

    bench.reader._pass_over = pass_over
    return passed


def test_who_passes_over_what_is_missing_is_not_made_anew_and_loses_nothing(bench, told):
    bench.run(2.0, first=LOOK_S)
    assert bench.run(QUIET_S + PATIENCE_S + 3.0 * LOOK_S, second=LOOK_S) == 0
    assert len(told) == 1, "told once"
    assert told[0][0].startswith("at "), "of the last that the second heard"
    assert bench.reader.passed
    assert bench.run(1.0, first=LOOK_S) == 0
    assert not bench.taken, "the first hands on what the second had, too"
    assert not bench.reader.passed
    assert bench.gone == bench.made


def test_who_is_told_and_hears_nothing_all_the_same_is_deaf(bench, told):
    bench.run(2.0, first=LOOK_S)
    assert bench.run(QUIET_S + PATIENCE_S + PASSED_S + 4.0 * LOOK_S, second=LOOK_S) == 1
    assert len(told) == 1
    assert bench.reader.stands_in
    bench.run(5.0, first=LOOK_S)
    told.clear()
    bench.run(QUIET_S + PATIENCE_S + 3.0 * LOOK_S, second=LOOK_S)
    assert len(told) == 1, "every time anew"


def test_who_keeps_one_message_keeps_the_newest(bench):
    bench.reader._kept = type(bench.reader._kept)(maxlen=1)
    bench.run(2.0, first=LOOK_S)
    bench.run(QUIET_S + LOOK_S, second=LOOK_S)
    bench.made[-1]("newest")
    assert bench.reader.newest == ("newest",)
    bench.reader.hand_over()
    assert bench.taken == [("newest",)]


def test_a_silence_that_both_hear_is_none_of_the_first(bench):
    bench.run(2.0, first=LOOK_S)
    assert bench.run(60.0) == 0
    assert len(bench.made) == 1, "one for the whole silence"
    assert bench.run(1.0, first=LOOK_S, second=LOOK_S) == 0
    assert bench.gone == bench.made
    assert not bench.taken, "the first has delivered it"


def test_a_topic_that_speaks_seldom_is_silent_later(bench):
    bench.run(60.0, first=2.0)
    assert len(bench.made) < 10, "the usual pause is learnt"
    made = len(bench.made)
    bench.run(60.0, first=2.0)
    assert len(bench.made) == made
    assert bench.run(10.0, second=2.0) == 1


class Spared(SecondReader):
    """One that is looked after only where a look is due."""

    def look(self, now_s, patience_s=PATIENCE_S):
        return self.is_due(now_s) and super().look(now_s, patience_s)


@pytest.mark.parametrize("seed", range(20))
def test_a_look_that_is_not_due_would_change_nothing(monkeypatch, seed):
    monkeypatch.setattr(SecondReader, "_doubted", WeakSet())
    always, spared = Bench(), Bench()
    spared.reader = Spared(spared.subscribe, spared.gone.append, spared.deliver)
    random = np.random.default_rng(seed)
    for _ in range(30):
        seconds, paces = random.uniform(0.1, 3.0), random.choice([0.0, LOOK_S, 0.5, 1.0], 2)
        one, other = (b.run(seconds, first=paces[0], second=paces[1]) for b in (always, spared))
        assert one == other
        assert len(always.made) == len(spared.made)
        assert len(always.gone) == len(spared.gone)
        assert always.taken == spared.taken
    assert always.made


def test_a_silent_topic_whose_second_reader_hears_nothing_needs_no_look(bench):
    bench.run(1.0, first=LOOK_S)
    assert not bench.reader.is_due(bench.now_s + 0.5 * QUIET_S)
    bench.run(QUIET_S + LOOK_S)
    assert bench.made
    assert not bench.reader.is_due(bench.now_s + 100.0)
    bench.made[-1]("a message", {})
    assert bench.reader.is_due(bench.now_s)


def test_what_is_kept_is_bounded(bench):
    bench.run(1.0, first=LOOK_S)
    bench.run(QUIET_S + LOOK_S)
    for number in range(2 * MOST_KEPT):
        bench.made[-1](number, {})
    bench.run(1.0)
    assert len(bench.taken) == MOST_KEPT


@pytest.mark.parametrize(
    ("samples", "every_s", "patience_s"),
    [(1, 0.03, PATIENCE_S), (40, 1.2, PATIENCE_S), (100, 0.03, RESENT_S)],
)
def test_who_gets_data_faster_than_a_plant_gives_them_waits_for_what_is_sent_again(
    samples, every_s, patience_s
):
    """One batch of 1.2 s each 1.2 s is no rush."""
    pace, stamp_ns = Pace(), 0
    for k in range(20):
        pace.note(stamp_ns + (samples - 1) * 30_000_000, k * every_s)
        stamp_ns += samples * 30_000_000
    assert pace.patience_s(20 * every_s) == patience_s
    assert pace.patience_s(20 * every_s + 60.0) == PATIENCE_S


def test_who_is_behind_waits_longer_where_several_hear_nothing(bench):
    pace, now_s = Pace(), 0.0
    for late_s in (0.0, 0.5, 0.0):
        now_s += LOOK_S + late_s
        pace.look(now_s)
    assert pace.patience_s(now_s, alone=False) == PATIENCE_S
    pace.look(now_s + LOOK_S + 1.0)
    assert pace.patience_s(now_s + 1.2) == PATIENCE_S
    assert pace.patience_s(now_s + 1.2, alone=False) == CALM_S
    assert pace.patience_s(now_s + 60.0, alone=False) == PATIENCE_S
    other = Bench()
    for one in (bench, other):
        one.run(2.0, first=LOOK_S)
        assert one.reader.is_alone
    bench.run(QUIET_S + 2.0 * LOOK_S, second=LOOK_S)
    assert bench.reader.is_alone
    assert not other.reader.is_alone
    bench.run(LOOK_S, first=LOOK_S)
    assert other.reader.is_alone


@pytest.mark.parametrize(
    ("rate", "patience_s"), [(1.0, PATIENCE_S), (1.5, PATIENCE_S), (5.0, RESENT_S)]
)
def test_what_comes_at_once_after_a_stall_of_our_own_is_no_rush(rate, patience_s):
    """What waited is read in two parts; data that are always fast are a rush in parts, too."""
    pace, now_s, stamp_s = Pace(), 0.0, 0.0
    for stall_s in (0.03,) * 30 + (2.5,) + (0.03,) * 30:
        waiting_s, now_s = rate * stall_s, now_s + stall_s
        for part in (0.1, 0.9):
            stamp_s, now_s = stamp_s + part * waiting_s, now_s + 1e-3
            pace.note(round(1e9 * stamp_s), now_s)
    assert pace.patience_s(now_s) == patience_s
