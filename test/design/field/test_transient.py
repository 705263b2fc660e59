# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eddy currents against a series of Bessel functions, the balance of energy, and static fields."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import jn_zeros

from valve_twin.design.field import make_model, run_transient, solve_field, static_force
from valve_twin.design.field.excitation import Trapezoid
from valve_twin.design.geometry import DoubleStroke, Region, Section
from valve_twin.design.geometry.section import rectangle
from valve_twin.design.materials import Linear, Steel

VACUUM = 4e-7 * np.pi
RADIUS, HALF, MU_R, SIGMA, TURNS = 5e-3, 2e-3, 100.0, 5.8e6, 100.0
TAU = MU_R * VACUUM * SIGMA * RADIUS**2
SHORT = Trapezoid(slope=1.5e-3, hold=1.5e-3, rest=2e-3)
SECTION = DoubleStroke().section()


@pytest.fixture(scope="module")
def cylinder():
    """Return a solid cylinder whose flux comes back without resistance: H is N i/2h around it."""
    regions = (
        Region("core", "metal", rectangle(0.0, RADIUS, -HALF, HALF)),
        Region("coil", "air", rectangle(5.5e-3, 6.5e-3, -HALF, HALF), "A", TURNS),
        Region("low", "yoke", rectangle(0.0, 10e-3, -6e-3, -HALF)),
        Region("high", "yoke", rectangle(0.0, 10e-3, HALF, 6e-3)),
        Region("shell", "yoke", rectangle(7e-3, 10e-3, -HALF, HALF)),
    )
    materials = {"metal": Linear(MU_R, SIGMA), "yoke": Linear(1e7)}
    section = Section("cylinder", regions, materials, None, 12e-3, -8e-3, 8e-3)
    return make_model(section, 1.0)


def off_by(model, method, steps):
    """Return the error of the flux after 0.1 and 0.3 of the time constant, over its end [1]."""
    time_s = np.linspace(0.0, 0.3 * TAU, steps + 1)
    currents = np.ones((steps + 1, 1))
    currents[0] = 0.0
    end = solve_field(model, (1.0,)).flux[0]
    whole = TURNS * MU_R * VACUUM * TURNS / (2.0 * HALF) * np.pi * RADIUS**2
    found = run_transient(model, time_s, currents, method=method).flux[:, 0]
    zeros = jn_zeros(0, 400)
    at = [steps // 3, steps]
    lacks = [np.sum(4.0 / zeros**2 * np.exp(-(zeros**2) * time_s[k] / TAU)) for k in at]
    return np.abs(found[at] - end + whole * np.array(lacks)) / whole


def test_the_flux_of_a_solid_cylinder_follows_its_bessel_series(cylinder):
    first, second = off_by(cylinder, "bdf2", 99)
    assert first < 1e-4
    assert second < 5e-5


def test_the_error_of_eulers_formula_halves_with_the_step(cylinder):
    wide, narrow = off_by(cylinder, "euler", 48), off_by(cylinder, "euler", 96)
    assert narrow.max() < 5e-3
    assert wide / narrow == pytest.approx([2.0, 2.0], rel=0.1)


def lacks_of_energy(model, step, position=None):
    """Return what the balance of energy lacks, over the heat of the eddy currents [1]."""
    time_s, currents = replace(SHORT, step=step).record(2)
    x = np.zeros(len(time_s)) if position is None else position(time_s / time_s[-1])
    found = run_transient(model, time_s, currents, x)
    mean = 0.5 * (currents[1:] + currents[:-1])
    given = np.sum(mean * np.diff(found.flux, axis=0))
    heat = np.sum(found.joule[1:] * np.diff(time_s))
    done = np.sum(0.5 * (found.force[1:] + found.force[:-1]) * np.diff(x))
    return (given - (found.energy[-1] - found.energy[0]) - heat - done) / heat, heat


def test_what_the_coils_give_becomes_field_and_heat():
    model = make_model(SECTION, 0.3)
    (wide, heat), (narrow, _) = (lacks_of_energy(model, step) for step in (2e-4, 1e-4))
    assert heat > 1e-3
    assert abs(narrow) < 5e-3
    assert wide / narrow == pytest.approx(4.0, rel=0.25)  # of second order


def test_a_moving_armature_takes_the_work_of_its_force():
    def there_and_back(share):
        return 0.6e-3 * np.sin(np.pi * share)

    found, heat = lacks_of_energy(make_model(SECTION, 0.3), 1e-4, there_and_back)
    assert heat > 1e-3
    assert abs(found) < 1e-2


def test_without_conductivity_it_is_the_static_field():
    section = replace(SECTION, materials={"steel": Steel(conductivity=1.0)})
    model = make_model(section, 0.3)
    time_s, currents = replace(SHORT, step=5e-4).record(2)
    found = run_transient(model, time_s, currents)
    for k in (3, 11):
        static = solve_field(model, currents[k])
        assert found.force[k] == pytest.approx(static.force, abs=1e-3)
        assert found.flux[k] == pytest.approx(static.flux, rel=1e-5)


def test_eddy_currents_delay_the_force():
    model = make_model(SECTION, 0.3)
    time_s, currents = replace(SHORT, step=2e-4).record(2)
    found = run_transient(model, time_s, currents)
    static = static_force(model, currents[::5], found.position[::5])
    middle = int(np.argmax(currents[::5, 0] > 1.5))
    assert 0.0 < found.force[::5][middle] < 0.8 * static[middle]
    assert static[middle] == pytest.approx(solve_field(model, currents[5 * middle]).force)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"method": "rk4"}, "method = 'rk4': must be one of euler, bdf2"),
        ({"time_s": np.array([0.0, 1e-3, 1e-3])}, "time_s: 3 times; must be 2 or more, rising"),
        ({"time_s": np.array([0.0, 1e-3, 3e-3]), "method": "bdf2"}, "bdf2 needs even ones"),
        (
            {"currents": np.ones((2, 1))},
            r"currents \(2, 1\) and position \(3,\): must be \(3, 1\)",
        ),
    ],
)
def test_records_that_do_not_fit_are_refused(cylinder, changes, words):
    given = {"time_s": np.array([0.0, 1e-3, 2e-3]), "currents": np.ones((3, 1))}
    with pytest.raises(ValueError, match=words):
        run_transient(cylinder, **{**given, **changes})
