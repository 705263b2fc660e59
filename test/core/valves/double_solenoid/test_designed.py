# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A designed solenoid in the valve: its numbers, steps, what the largest current leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.test_designed import FOUND
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid.designed import plant_of

NUMBERS = MODEL.of_design(FOUND)


def test_the_numbers_are_those_of_the_design():
    plant = plant_of(NUMBERS)
    assert plant.resistance_a == 2.0
    assert plant.end_stop == 1e-3
    assert plant.valve().largest == FOUND.largest_current
    assert plant.trajectory_set.overshoot == FOUND.around.overshoot
    assert np.reshape(plant.map_coenergy, FOUND.curves.coefficients.shape) == pytest.approx(
        FOUND.curves.coefficients
    )


def test_a_step_shows_every_signal_and_judges_the_position():
    of = MODEL.loop(NUMBERS, 0.5, {})
    rows = dict(of.rows)
    assert of.time_s[-1] == pytest.approx(0.08)
    x = rows["position [mm]"]["x"]
    assert x[-1] == pytest.approx(0.5 * 0.8 / 0.9, rel=0.05)
    assert of.error == pytest.approx(abs(x[-1] / rows["position [mm]"]["wanted"][-1] - 1.0))
    assert np.abs(rows["voltage [V]"]["A"]).max() <= 24.0
    assert 0.0 < of.rise_s < of.settling_s
    heat = 2.0 * sum(float(np.mean(i**2)) for i in rows["current [A]"].values())
    assert of.loss == pytest.approx(heat)


def test_more_friction_or_copper_changes_the_step_as_it_should():
    usual = MODEL.loop(NUMBERS, 0.5, {})
    hot = MODEL.loop(NUMBERS, 0.5, {"copper": 1.1})
    assert hot.loss == pytest.approx(1.1 * usual.loss, rel=0.03)
    stuck = MODEL.loop(NUMBERS, 0.1, {"rubbing": 20.0})
    assert stuck.error > MODEL.loop(NUMBERS, 0.1, {}).error


def test_a_step_from_another_start_is_judged_over_its_own_way():
    back, across = (
        MODEL.loop(NUMBERS, end, {}, start) for start, end in ((1.0, 0.0), (0.5, -0.5))
    )
    for of, start, end in ((back, 1.0, 0.0), (across, 0.5, -0.5)):
        x = dict(of.rows)["position [mm]"]["x"] / (0.8 / 0.9)
        assert x[0] == pytest.approx(start, abs=0.02)
        assert x[-1] == pytest.approx(end, abs=0.02)
        assert of.error == pytest.approx(abs((x[-1] - start) / (end - start) - 1.0))
        assert 0.0 < of.rise_s < of.settling_s < 0.02


def test_stiffer_springs_leave_less_force():
    stiff = replace(FOUND, around=replace(FOUND.around, spring_rate=2e4))
    way = FOUND.around.opened * FOUND.stroke
    less = MODEL.force_margin(NUMBERS) - MODEL.force_margin(MODEL.of_design(stiff))
    assert less == pytest.approx(2.0 * 1e4 * way)  # of both springs, at the open port


def test_a_controller_that_looks_less_far_ahead_is_faster_and_goes_further_beyond():
    near = replace(FOUND, around=replace(FOUND.around, horizon=16))
    usual, found = (MODEL.loop(n, 0.5, {}) for n in (NUMBERS, MODEL.of_design(near)))
    assert found.rise_s < 0.8 * usual.rise_s
    assert found.overshoot > usual.overshoot


def test_what_is_left_of_a_small_step_is_the_smallest_change_of_the_set():
    coarse = replace(FOUND, around=replace(FOUND.around, small=0.02, sizes=2))
    left = MODEL.loop(MODEL.of_design(coarse), 0.1, {}).error
    assert MODEL.loop(NUMBERS, 0.1, {}).error < 0.3 * left
