# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Steps of commands are found, and what is no step is told."""

import numpy as np
import pytest

from valve_twin.core.operation.command_steps import Hold, find_transitions


def command(*parts):
    return np.concatenate([np.full(n, level) for n, level in parts])[:, None]


def test_each_step_stands_between_its_holds():
    up, down = find_transitions(command((30, 0.2), (50, 0.7), (40, 0.1)))
    assert (up.column, up.at, up.reason) == (0, 30, "")
    assert [up.size, down.size] == pytest.approx([0.5, -0.6])
    assert (up.before, up.after) == (Hold(0, 30), Hold(30, 80))
    assert (down.before, down.after) == (Hold(30, 80), Hold(80, 120))


@pytest.mark.parametrize("u", [np.full(50, 0.3), np.sin(np.linspace(0.0, 6.0, 2000))])
def test_a_constant_command_and_a_slow_wave_have_no_step(u):
    assert find_transitions(u[:, None]) == []


def test_noise_of_a_measured_command_is_no_step():
    u = command((300, 0.2), (300, 0.7)) + 1e-3 * np.random.default_rng(1).standard_normal((600, 1))
    (step,) = find_transitions(u)
    assert (step.at, step.reason) == (300, "")


def test_what_is_no_step_says_so():
    ramp = np.interp(np.arange(200), [50, 70], [0.0, 1.0])[:, None]
    (found,) = find_transitions(ramp)
    assert found.reason == "the command is not a step: it changes over 20 samples"
    assert (found.before.end, found.after.begin) == (51, 70)
    creeping = np.interp(np.arange(400), [0, 199, 200, 399], [0.0, 0.3, 0.8, 1.0])[:, None]
    (found,) = find_transitions(creeping)
    assert "it is not held before and after" in found.reason


def test_two_commands_are_told_apart_and_must_not_step_at_once():
    u = np.hstack([command((50, 0.0), (100, 1.0)), command((90, 0.0), (60, 1.0))])
    first, second = find_transitions(u)
    assert (first.column, first.after, first.reason) == (0, Hold(50, 90), "")
    assert (second.column, second.before, second.reason) == (1, Hold(50, 90), "")
    both = find_transitions(np.hstack([u[:, :1], 2.0 * u[:, :1]]))
    assert [t.reason for t in both] == [
        "the command is not a step: two commands change at once"
    ] * 2
