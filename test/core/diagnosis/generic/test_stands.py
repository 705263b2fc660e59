# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a position loses by standing still and regains by jumps."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.faults import FAULTS, Sensed, slipping, source
from valve_twin.core.diagnosis.generic.features import Record
from valve_twin.core.diagnosis.generic.stands import LOST, REGAINED, stands, values

PERIOD_S = 0.5
T = np.arange(1200) * PERIOD_S
RAMPS = np.interp(T % 100.0, [0.0, 40.0, 50.0, 90.0, 100.0], [0.2, 0.8, 0.8, 0.2, 0.2])
SINES = 0.5 + 0.2 * np.sin(T / 7.0) + 0.1 * np.sin(T / 17.0)


def ways(model, position, *, noise=1e-3, scale=1.0):
    """Return what a position lost and regained."""
    y = position + noise * np.random.default_rng(3).standard_normal(len(position))
    found = stands(Record(scale * y, scale * model, PERIOD_S, np.zeros((len(model), 0))))
    return found[LOST], found[REGAINED]


@pytest.mark.parametrize("model", [RAMPS, SINES], ids=["ramps", "sines"])
@pytest.mark.parametrize("jump", [0.5, 1.0])
def test_what_sticks_regains_what_it_lost_by_jumps_and_play_does_not(model, jump):
    sticks, play = slipping(model, 0.08, jump), slipping(model, 0.08, 0.0)
    lost, regained = ways(model, sticks)
    assert lost > 0.1
    assert regained > 0.4 * lost
    lost, regained = ways(model, play)
    assert lost > 0.1
    assert regained < 0.05 * lost


def test_a_slip_of_no_jump_is_play():
    exact = np.empty_like(SINES)
    width = 0.08
    place = SINES[0]
    for n, x in enumerate(SINES):
        place = min(max(place, x - 0.5 * width), x + 0.5 * width)
        exact[n] = place
    found = slipping(SINES, width, 0.0)
    assert np.abs(found - exact).max() < 0.02 * width
    sensed = Sensed(SINES, np.zeros(len(SINES)), PERIOD_S, source(0, 0))
    assert FAULTS["lost_motion"](sensed, width) == pytest.approx(exact)


def test_what_slips_by_the_whole_band_ends_where_the_motion_is():
    found = slipping(RAMPS, 0.1, 1.0)
    moved = np.flatnonzero(np.abs(np.diff(found)) > 0.05) + 1
    assert len(moved)
    assert found[moved] == pytest.approx(RAMPS[moved])


def test_noise_alone_loses_and_regains_nothing_and_the_unit_says_nothing():
    assert max(ways(RAMPS, RAMPS, noise=0.01)) < 0.02  # noise is 0.017 of the span
    sticks = slipping(SINES, 0.08, 0.7)
    assert ways(SINES, sticks, scale=40.0) == pytest.approx(ways(SINES, sticks))


def test_a_cycle_that_shows_nothing_is_not_known():
    flat = np.ones(100)
    assert values(Record(flat, flat, PERIOD_S, np.zeros((100, 0)))) == []
    few = Record(SINES[:20], SINES[:20], PERIOD_S, np.zeros((20, 0)))
    assert values(few) == []
