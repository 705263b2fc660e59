# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dynamics beside static curves: known ones are found again, those of a solenoid are explained."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from valve_twin.design.dynamics import fit_dynamics, identify
from valve_twin.design.field import Trapezoid, make_model, run_transient
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid, compute_map

TIME, CURRENTS = Trapezoid().record(1)
SOURCE = CURRENTS[:, 0]


def answer_of(b1, b2, slow_hz, fast_hz):
    """Return the response from another program: straight lines between the times."""
    slow, fast = 2 * np.pi * slow_hz, 2 * np.pi * fast_hz
    above = np.trim_zeros(np.array([b2, b1, 1.0]), "f")
    system = (above, [1 / (slow * fast), 1 / slow + 1 / fast, 1.0])
    return 1.0 + lsim(system, SOURCE - 1.0, TIME)[1]


@pytest.mark.parametrize(
    "truth",
    [(12.5e-3, 1.1e-5, 17.0, 380.0), (18e-3, 0.7e-5, 12.0, 120.0), (0.0, 0.0, 60.0, 900.0)],
)
def test_known_dynamics_are_found_again(truth):
    found = fit_dynamics(TIME, SOURCE, answer_of(*truth))
    assert found.poles_hz == pytest.approx(truth[2:], rel=1e-3)
    assert (found.b1, found.b2) == pytest.approx(truth[:2], rel=1e-3, abs=1e-8)
    assert found.fit > 99.99
    assert found.without < 95.0


def test_what_is_found_does_not_hang_on_the_last_digits():
    """Filters of polynomials rounded to 1e-6 of the sum: searches ended 5 % apart."""
    noise = np.random.default_rng(0).standard_normal((4, len(TIME)))
    answer = answer_of(12.5e-3, 1.1e-5, 17.0, 380.0) + 0.02 * np.cumsum(noise[0]) / len(TIME)
    first, *others = (fit_dynamics(TIME, SOURCE, answer * (1.0 + 1e-10 * of)) for of in noise)
    for other in others:
        assert other.poles_hz == pytest.approx(first.poles_hz, rel=1e-4)
        assert (other.b1, other.b2) == pytest.approx((first.b1, first.b2), rel=1e-4)


def test_noise_is_left_over_not_explained():
    noise = 0.02 * np.random.default_rng(3).normal(size=len(TIME))
    noise[0] = 0.0  # the first row is the rest from which changes count
    answer = answer_of(12.5e-3, 1.1e-5, 17.0, 380.0) + noise
    found = fit_dynamics(TIME, SOURCE, answer)
    possible = 100.0 * (1.0 - np.linalg.norm(noise) / np.linalg.norm(answer - answer.mean()))
    assert possible - 0.5 < found.fit < possible + 1.0


@pytest.mark.parametrize(
    ("time_s", "source", "words"),
    [
        (TIME**1.01, SOURCE, "291 times; must be 10 or more with even steps"),
        (TIME, np.ones(len(TIME)), "source stands still"),
    ],
)
def test_a_record_that_tells_nothing_is_refused(time_s, source, words):
    with pytest.raises(ValueError, match=words):
        fit_dynamics(time_s, source, SOURCE)


def test_the_eddy_currents_of_a_solenoid_are_explained():
    section = DoubleStroke().section()
    curves = compute_map(section, MapGrid(currents=5, positions=4, fine=0.3))
    time_s, currents = Trapezoid(step=2.5e-4).record(2)
    found = run_transient(make_model(section, 0.3), time_s, currents)
    flux_to_current, of_force = identify(found, curves)
    assert flux_to_current.fit > 90.0
    assert flux_to_current.fit - flux_to_current.without > 15.0
    assert flux_to_current.fast_gain > 1.0  # the current leads the flux
    assert of_force.fit > 85.0
    assert of_force.fit - of_force.without > 15.0
    assert 0.0 < of_force.fast_gain < 1.0  # the force lags the current
