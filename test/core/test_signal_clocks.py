# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Clocks that run apart are found, lateness and a rush are not taken for that."""

import numpy as np
import pytest

from valve_twin.core.signal_clocks import FORGOTTEN, LOOKS, SignalClocks

HOUR_NS = 3600e9


def looked(ahead_ns, looks=LOOKS, headers=(True, True)):
    """Return what is found of a signal that is ahead of the position by so much at each look."""
    clocks = SignalClocks("position", 2.0)
    for k in range(looks):
        clocks.note("position", 0.0, has_header=headers[0])
        clocks.note("v_in", ahead_ns[k % len(ahead_ns)], has_header=headers[1])
        found = clocks.look()
    return found


@pytest.mark.parametrize(
    ("ahead_ns", "words"),
    [
        (HOUR_NS, "v_in is stamped 3600 s ahead of position"),
        (-HOUR_NS, "v_in is stamped 3600 s behind position"),
    ],
)
def test_an_offset_between_two_clocks_is_measured(ahead_ns, words):
    (found,) = looked([ahead_ns])
    assert found.offset_s == pytest.approx(ahead_ns / 1e9)
    assert words in str(found)
    assert "synchronise them" in str(found)


def test_it_takes_some_looks_and_goes_when_the_clocks_agree():
    assert not looked([HOUR_NS], LOOKS - 1)
    assert not looked([HOUR_NS, HOUR_NS, HOUR_NS, 0.0], 4)


@pytest.mark.parametrize("silent", ["v_in", "position"])
def test_the_offset_of_a_signal_that_falls_silent_is_forgotten(silent):
    clocks = SignalClocks("position", 2.0)
    found = []
    for k in range(LOOKS + FORGOTTEN + 1):
        for signal, ahead_ns in (("position", 0.0), ("v_in", HOUR_NS)):
            if k < LOOKS or signal != silent:
                clocks.note(signal, ahead_ns, has_header=True)
        found.append(bool(clocks.look()))
    assert found.index(True) == LOOKS - 1
    assert all(found[LOOKS - 1 : -1])
    assert not found[-1]


def test_the_offset_of_a_signal_that_speaks_seldom_stands():
    clocks = SignalClocks("position", 2.0)
    for k in range(10 * FORGOTTEN):
        clocks.note("position", 0.0, has_header=True)
        if k % FORGOTTEN == 0:
            clocks.note("v_in", HOUR_NS, has_header=True)
        found = clocks.look()
    assert found


@pytest.mark.parametrize(
    ("headers", "unstamped"),
    [((True, False), "v_in"), ((False, True), "position"), ((False, False), "")],
)
def test_who_carries_no_stamps_is_named(headers, unstamped):
    (found,) = looked([HOUR_NS], headers=headers)
    assert found.unstamped == unstamped
    assert (f"{unstamped} carries no stamps" in str(found)) == bool(unstamped)


def test_what_only_may_be_late_is_told_the_parameter():
    (found,) = looked([-5e9])
    assert "raise hold_back_s above 5 " in str(found)


def test_what_is_within_the_wait_or_never_twice_the_same_is_no_offset():
    assert not looked([1.9e9])
    jitter = np.random.default_rng(1).normal(0.0, 30e9, 50)
    assert not looked(list(jitter), 50)


def test_a_signal_that_was_not_heard_beside_the_position_is_not_judged():
    clocks = SignalClocks("position", 2.0)
    for k in range(10):
        clocks.note(("position", "v_in")[k % 2], HOUR_NS * (k % 2), has_header=True)
        assert not clocks.look()
