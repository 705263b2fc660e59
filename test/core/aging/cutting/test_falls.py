# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A gain is followed at the command at which its cycles tell it best."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.aging.cutting.falls import MOST
from valve_twin.core.aging.cutting.memory import Memory
from valve_twin.core.types import Parameter

USUAL = -0.4  # of fall over gain


def pressed(history, scatter, n, *, drift=-0.08, apart=0.4, moved=0.0):
    """Return a gain known to 0.3 % at a command farther by `apart`, and its fall to 10 %."""
    age = 1.0 + drift * np.arange(n) / n
    share = USUAL + 0.1 * scatter(3, n)
    known = age * (1.0 + 0.003 * scatter(4, n)) * (1.0 + USUAL * apart)
    command = 0.5 + moved * np.arange(n) / n
    gain = known / (1.0 + share * apart) * (1.0 + USUAL * (command - 0.5))
    return history(gain=gain, fall=share * gain, command=command)


def trend_of(estimates, *fall, memory=None):
    gain = Parameter("gain", "1", "", trend=True, fall=fall)
    return assess(estimates, (), AgingConfig(), parameters=(gain,), memory=memory).trends[0]


def test_what_a_cycle_mistakes_for_the_fall_is_taken_out_of_the_gain(history, scatter):
    estimates = pressed(history, scatter, 40)
    bare, now = trend_of(estimates), trend_of(estimates, "fall")
    assert bare.unbounded
    assert not now.unbounded
    widths = [t.slope_upper_95 - t.slope_lower_95 for t in (bare, now)]
    assert widths[1] < 0.3 * widths[0]
    assert now.slope_lower_95 < -0.002 * now.reference < now.slope_upper_95


def test_a_gain_is_brought_to_the_command_of_its_reference(history, scatter):
    estimates = pressed(history, scatter, 60, drift=0.0, moved=0.1)
    moved, brought = trend_of(estimates, "fall"), trend_of(estimates, "fall", "command")
    assert moved.drift_reference == pytest.approx(-3.7, abs=0.5)
    assert brought.drift_reference == pytest.approx(0.0, abs=0.3)


def test_wear_that_scales_a_gain_and_its_fall_is_not_taken_out(history):
    gain = 1.0 - 0.004 * np.arange(40) + 0.01 * np.sin(np.arange(40.0))
    estimates = history(gain=gain, fall=USUAL * gain)
    assert trend_of(estimates, "fall").slope == pytest.approx(trend_of(estimates).slope, rel=1e-9)


def test_a_memory_changes_nothing_of_a_long_life(history, scatter):
    n = MOST + 40
    estimates, memory = pressed(history, scatter, n), Memory()
    for end in range(n - 3, n + 1):
        kept = trend_of(estimates[:end], "fall", memory=memory)
        assert repr(kept) == repr(trend_of(estimates[:end], "fall"))


def test_cycles_without_a_fall_are_followed_as_they_are(history, scatter):
    estimates = [replace(e, parameters=e.parameters[:1]) for e in pressed(history, scatter, 40)]
    assert repr(trend_of(estimates, "fall")) == repr(trend_of(estimates))
