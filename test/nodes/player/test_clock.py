# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bag time runs at its rate and never steps but on a jump."""

from valve_twin.nodes.player.clock import PlaybackClock

S = 10**9


def running(rate: float, at_ns: int = 100 * S) -> PlaybackClock:
    clock = PlaybackClock(rate)
    clock.jump(at_ns, 0.0)
    clock.run(0.0)
    return clock


def test_time_stands_until_it_runs():
    clock = PlaybackClock(2.0)
    clock.jump(5 * S, 0.0)
    assert clock.now_ns(10.0) == 5 * S
    clock.run(10.0)
    assert clock.now_ns(11.5) == 8 * S


def test_a_pause_leaves_no_step():
    clock = running(2.0)
    clock.hold(3.0)
    assert clock.now_ns(50.0) == 106 * S
    clock.run(50.0)
    assert clock.now_ns(51.0) == 108 * S


def test_a_new_rate_goes_on_from_where_it_is():
    clock = running(2.0)
    clock.set_rate(10.0, 3.0)
    assert clock.now_ns(3.0) == 106 * S
    assert clock.now_ns(4.0) == 116 * S


def test_a_new_rate_while_paused_waits():
    clock = running(1.0)
    clock.hold(1.0)
    clock.set_rate(5.0, 2.0)
    assert clock.now_ns(9.0) == 101 * S


def test_a_jump_goes_either_way():
    clock = running(1.0)
    clock.jump(10 * S, 5.0)
    assert clock.now_ns(6.0) == 11 * S
    assert not clock.is_due(12 * S, 6.0)
    assert clock.is_due(12 * S, 7.0)


def test_at_rate_zero_all_is_due_and_time_is_that_of_the_messages():
    clock = running(0.0)
    assert clock.is_due(10**15, 0.0)
    clock.jump(200 * S, 1.0)
    assert clock.now_ns(99.0) == 200 * S
    clock.set_rate(1.0, 100.0)
    assert clock.now_ns(101.0) == 201 * S
