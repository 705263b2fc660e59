# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The one pass over a cycle's signals lets none through in which a check finds something."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle
from valve_twin.core.valves.press_cartridge.estimation.response import signals
from valve_twin.core.valves.registry import get_model, get_simulation

MODEL = get_model("press_cartridge")
OPTIONS = MODEL.options


@pytest.fixture(scope="module")
def cycle():
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=3)
    return Cycle(1, config.period_s, to_frames(block))


def changed(cycle, **columns):
    return replace(cycle, frames=replace(cycle.frames, **columns))


def with_value(values, at, value):
    found = values.copy()
    found[at] = value
    return found


WRONG = {
    "no number": lambda x, u: {"position": with_value(x, slice(0, 100), np.nan)},
    "one infinite": lambda x, u: {"position": with_value(x, 7, np.inf)},
    "a command missing": lambda x, u: {"inputs": with_value(u, 7, np.nan)},
    "not valid": lambda x, u: {"valid": np.arange(len(x)) % 3 > 0},
    "percent": lambda x, u: {"position": 100.0 * x},
    "command in percent": lambda x, u: {"inputs": 100.0 * u},
    "coarse": lambda x, u: {"position": np.round(x / 0.02) * 0.02},
    "one topic twice": lambda x, u: {"inputs": np.column_stack([u[:, 0], u[:, 0]])},
    "the command as position": lambda x, u: {"position": u[:, 0].copy()},
    "nothing commanded": lambda x, u: {"inputs": np.full_like(u, 0.3)},
    "always off": lambda x, u: {"inputs": np.zeros_like(u)},
    "exchanged": lambda x, u: {"inputs": np.ascontiguousarray(u[:, ::-1])},
    "inverted": lambda x, u: {"position": 1.0 - x},
    "late": lambda x, u: {"position": np.roll(x, 20)},
    "early": lambda x, u: {"position": np.roll(x, -20)},
    "little late": lambda x, u: {"position": np.roll(x, 2)},
    "an outlier": lambda x, u: {"position": with_value(x, 7, 5.0)},
}


@pytest.mark.parametrize("what", WRONG)
def test_one_pass_says_what_the_checks_one_by_one_say(cycle, what, monkeypatch):
    wrong = changed(cycle, **WRONG[what](cycle.frames.position, cycle.frames.inputs))
    said = MODEL.input_fault(wrong, OPTIONS)
    monkeypatch.setattr(signals, "_passes", lambda *_: False)
    assert said == MODEL.input_fault(wrong, OPTIONS)


@pytest.mark.parametrize("count", [0, 1, 5, 25, 60])
def test_a_short_cycle_is_no_other_in_one_pass(cycle, count, monkeypatch):
    short = replace(cycle, frames=cycle.frames[:count])
    said = MODEL.input_fault(short, OPTIONS)
    monkeypatch.setattr(signals, "_passes", lambda *_: False)
    assert said == MODEL.input_fault(short, OPTIONS)


def test_a_usual_cycle_needs_no_check_of_its_own(cycle, monkeypatch):
    def no_need(*_):
        raise AssertionError

    monkeypatch.setattr(signals, "known_rows", no_need)
    assert not MODEL.input_fault(cycle, OPTIONS)
