# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a stream goes on where a snapshot ends: the first samples of every signal tell."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.alignment import SignalRange
from valve_twin.core.rejoin import Rejoin
from valve_twin.core.twin import Twin, TwinConfig
from valve_twin.core.valves.registry import complete_options, get_model

MODEL = get_model("positioner")
STEP_NS = 50_000_000
LAST = 1000
"""The snapshot ends with this sample."""


def samples(name, first, end, every=1):
    at = np.arange(first, end, every)
    return name, at * STEP_NS, at.astype(float)


def rejoin(every=1, seen=("position", "command"), condition=False):
    """Return what judges a snapshot of a command that comes with every nth position."""
    conditions = (SignalRange("load"),) if condition else ()
    config = TwinConfig(
        period_s=0.05,
        signals=(SignalRange("position"), SignalRange("command")),
        conditions=conditions,
        options=complete_options(MODEL, {}),
    )
    twin = Twin(config, MODEL)
    for name in seen:
        step = every if name == "command" else 1
        twin.push(*samples(name, LAST % step, LAST + 1, step))
    if condition:
        twin.push(*samples("load", 0, LAST - 500))
    return Rejoin(twin.snapshot(), 0.05, 2.0, since_ns=500 * STEP_NS, closed_ns=900 * STEP_NS)


def is_open(found):
    return found.goes_on is None


def test_it_goes_on_with_the_next_sample_of_every_signal():
    found = rejoin()
    found.add([samples("position", LAST + 1, LAST + 3)])
    assert is_open(found)  # the command is still to come
    found.add([samples("command", LAST + 1, LAST + 2)])
    assert found.goes_on
    assert found.is_sure
    (position,), (command,) = found.rounds()
    assert position[1].tolist() == [(LAST + 1) * STEP_NS, (LAST + 2) * STEP_NS]
    assert command[1].tolist() == [(LAST + 1) * STEP_NS]


def test_a_command_from_before_the_last_cycle_still_holds_where_the_stream_begins_anew():
    found = rejoin()
    found.add([samples("command", 300, 301), samples("position", LAST + 500, LAST + 503)])
    assert found.goes_on is False
    ((command, _),) = found.rounds()
    assert command[1].tolist() == [300 * STEP_NS]  # latched: the next one may be far away


def test_what_is_given_again_is_left_out():
    found = rejoin()
    found.add([samples("position", LAST - 300, LAST + 1), samples("command", LAST - 400, LAST)])
    assert is_open(found)
    found.add([samples("command", LAST, LAST + 5), samples("position", LAST + 1, LAST + 5)])
    assert found.goes_on
    assert [[len(stamps) for _, stamps, _ in parts] for parts in found.rounds()] == [
        [0, 0],
        [4, 4],
    ]
    assert found.rounds()[1][0][2].tolist() == [LAST + k for k in range(1, 5)]


@pytest.mark.parametrize("name", ["position", "command"])
def test_a_gap_of_any_signal_ends_it(name):
    found = rejoin()
    other = {"position": "command", "command": "position"}[name]
    found.add([samples(other, LAST + 1, LAST + 4), samples(name, LAST + 3, LAST + 4)])
    assert found.goes_on is False
    assert [len(stamps) for _, stamps, _ in found.rounds()[0]] == [3, 1]


def test_of_data_given_again_before_a_gap_closed_cycles_are_left_out():
    found = rejoin()
    found.add([samples("position", 800, LAST - 50), samples("command", 800, LAST - 50)])
    found.add([samples("position", LAST + 10, LAST + 11)])
    assert found.goes_on is False
    assert found.rounds()[0][0][1][0] == 900 * STEP_NS


def test_older_data_is_another_stream():
    found = rejoin()
    found.add([samples("command", 100, 200), samples("position", 100, 200)])
    assert found.goes_on is False
    assert [len(stamps) for _, stamps, _ in found.rounds()[0]] == [100, 100]


def test_a_command_that_comes_seldom_may_have_been_lost():
    found = rejoin(every=50)
    found.add([samples("position", LAST + 1, LAST + 30)])
    assert is_open(found)
    found.add([samples("position", LAST + 30, LAST + 45)])
    assert found.goes_on  # silent for no longer than it is at most times
    assert not found.is_sure


def test_one_that_is_silent_for_too_long_was_lost():
    found = rejoin(every=20)
    found.add([samples("position", LAST + 1, LAST + 60)])
    assert found.goes_on is False


def test_a_position_that_does_not_come_is_not_waited_for():
    found = rejoin()
    found.add([samples("command", LAST + 1, LAST + 39)])
    assert is_open(found)
    found.add([samples("command", LAST + 39, LAST + 60)])
    assert found.goes_on is False


def test_a_condition_that_lacks_samples_ends_nothing():
    found = rejoin(condition=True)
    found.add(
        [samples(n, LAST + 1, LAST + 2) for n in ("position", "command")]
        + [samples("load", LAST + 30, LAST + 31)]
    )
    assert found.goes_on
    assert found.is_sure


def test_before_the_first_position_there_is_nothing_to_go_on_with():
    assert rejoin(seen=("command",)).goes_on is False


def test_who_gives_up_begins_anew():
    found = rejoin()
    found.add([samples("position", LAST - 5, LAST)])
    found.give_up()
    assert found.goes_on is False
    assert len(found.rounds()[0][0][1]) == 5
