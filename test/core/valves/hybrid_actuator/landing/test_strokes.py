# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Strokes under the open sequence and under the controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.hybrid_actuator.landing.numbers import LandingNumbers
from valve_twin.core.valves.hybrid_actuator.landing.strokes import (
    _told,
    open_stroke,
    samples_of,
    soft_stroke,
    varied,
)
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant

DATA_SHEET = HybridActuatorPlant()
VALVE = replace(DATA_SHEET, coulomb_friction=2.0, gas_force=20.0)


def noise(seed=7000):
    return np.random.default_rng(seed).normal(size=samples_of())


@pytest.mark.parametrize("opens", [True, False])
def test_the_controller_lands_ten_times_softer_than_the_open_sequence(opens):
    loose, _ = open_stroke(VALVE, opens)
    soft, course = soft_stroke(VALVE, DATA_SHEET, opens, noise())
    assert loose.speed > 0.6
    assert soft.speed < 0.1 * loose.speed
    assert soft.rest_s - loose.rest_s < 3e-3
    assert abs(course[-1, 0] - VALVE.half_travel) < 1e-9
    assert np.abs(course[-1, 2:]).max() < 0.5  # the magnet alone holds it


def test_the_open_sequence_is_that_of_the_simulated_valve():
    n = 400
    drive = Drive(np.ones(n), np.ones(n, dtype=np.bool_), None, np.zeros(n))
    position = DATA_SHEET.run(DATA_SHEET.initial_state(), drive, 1e-4).position
    _, course = open_stroke(DATA_SHEET, True)
    of_course = 0.5 * (course[::10] / DATA_SHEET.half_travel + 1.0)
    assert np.abs(of_course[:n] - position).max() < 1e-9


def test_a_stroke_repeats_to_the_last_bit():
    first, again = (soft_stroke(VALVE, DATA_SHEET, True, noise()) for _ in range(2))
    assert first[0] == again[0]
    assert np.array_equal(first[1], again[1])


def test_a_valve_that_is_not_let_go_never_lands():
    loose, _ = open_stroke(replace(VALVE, gas_force=500.0), True)
    soft, _ = soft_stroke(replace(VALVE, gas_force=500.0), DATA_SHEET, True, noise())
    assert np.isnan([loose.speed, loose.rest_s, soft.speed, soft.rest_s]).all()


def test_what_is_varied():
    other = varied(VALVE, 1.1, 0.9, 1.2)
    assert other.damping == pytest.approx(1.1 * VALVE.damping)
    assert other.coulomb_friction == pytest.approx(2.2)
    assert other.supply_voltage == pytest.approx(21.6)
    assert other.gas_force == pytest.approx(24.0)


def test_a_sampling_time_between_the_plants_steps_is_refused():
    with pytest.raises(ValueError, match=r"period = 5\.5e-05: must be a multiple of step = 1e-05"):
        soft_stroke(VALVE, DATA_SHEET, True, noise(), LandingNumbers(period=5.5e-5))


@pytest.mark.parametrize(
    ("contact", "end"), [((np.nan, np.nan), -1e-6), ((0.1, 2e-3), np.nan), ((0.1, 2e-3), -1e-3)]
)
def test_one_that_hovers_fails_or_leaves_its_seat_is_not_at_rest(contact, end):
    place = np.array([-1.0, 0.0, 1.0, 1.0]) * VALVE.half_travel
    place[2:] += end
    assert np.isnan(_told(VALVE, contact, place, 1e-3, VALVE.initial_state()).rest_s)


def test_it_rests_where_it_stays():
    place = np.array([-1.0, 1.0, 0.9, 1.0]) * VALVE.half_travel
    found = _told(VALVE, (0.1, 5e-4), place, 1e-3, VALVE.initial_state())
    assert found.rest_s == pytest.approx(3e-3)
