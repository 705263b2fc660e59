# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The strangers move by their equations where these have a closed form."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.validation.any_strangers.draw import draw
from valve_twin.validation.any_strangers.kernel import (
    CYLINDER,
    KINDS,
    PNEUMATIC,
    SPOOL,
    STEP_S,
    run,
)
from valve_twin.validation.any_strangers.troubles import Trouble, troubled

STEPS = 5000


def valve_of(kind, **changed):
    plain = {"dead": 0.0, "breakaway": 0.0, "coulomb": 0.0, "delay_s": 0.0, "load": 0.0}
    return draw(kind).valve._replace(**{**plain, **changed})


def moved(valve, wanted):
    rest = 0.5 if valve.kind == CYLINDER else 0.0
    state = np.array([0.0, 0.0, 0.0, rest])
    none = np.zeros(len(wanted))
    return run(state, valve, wanted, none, np.full(2500, rest), 1)


def test_a_spool_follows_a_step_with_its_lag():
    valve = valve_of(SPOOL, lag_s=0.4, up=10.0, down=10.0)
    place, _ = moved(valve, np.full(STEPS, 0.6))
    t = STEP_S * np.arange(1, STEPS + 1)
    # Euler: an error of half a step in time
    assert np.abs(place - 0.6 * (1.0 - np.exp(-t / 0.4))).max() < 0.6 * STEP_S / 0.4


def test_friction_and_dead_band_stop_a_spool_short():
    valve = valve_of(SPOOL, lag_s=0.2, up=10.0, down=10.0, dead=0.01, coulomb=0.02)
    place, _ = moved(valve, np.full(STEPS, 0.5))
    assert place[-1] == pytest.approx(0.47, abs=1e-3)


def test_a_cylinder_runs_as_fast_as_its_valve_is_open_beyond_the_dead_band():
    valve = valve_of(CYLINDER, lag_s=0.01, up=0.3, dead=0.1, gain=100.0)
    place, command = moved(valve, np.full(1000, 1.0))
    assert np.all(command[:900] == 1.0)
    assert (place[900] - place[400]) / (500 * STEP_S) == pytest.approx(0.3 * 0.9, rel=1e-3)


def test_a_pneumatic_stem_comes_to_rest_within_its_dead_band():
    valve = valve_of(PNEUMATIC, dead=0.01)
    place, _ = moved(valve, np.full(4 * STEPS, 0.5))
    assert np.ptp(place[-500:]) < 1e-3
    assert abs(place[-1] - 0.5) < 0.02


@pytest.mark.parametrize("kind", range(len(KINDS)))
def test_end_stops_and_delay_are_kept(kind):
    late = replace(draw(kind)).valve._replace(delay_s=0.5)
    place, _ = moved(late, np.full(STEPS, 1.0))
    assert np.all(place[: round(0.5 / STEP_S)] == 0.0)
    shorter = troubled(late, Trouble("end_stop_upper", "large", 0.06, 1))
    assert moved(shorter, np.full(2 * STEPS, 1.0))[0].max() == pytest.approx(0.94)
