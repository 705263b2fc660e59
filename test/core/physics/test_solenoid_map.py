# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Characteristic curves: one energy behind current and force, monotone, or refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.physics.solenoid_map import (
    FluxCurves,
    coil_current,
    coil_flux,
    coil_force,
    map_from_curves,
    pole_curves,
)

GAP, CONSTANT, SATURATION = 1.7e-3, 4e-7 * np.pi * 350.0**2 * 1.2e-4, 0.040
MUTUAL = 0.06 * CONSTANT / GAP
POLE = pole_curves(
    350.0,
    1.2e-4,
    GAP,
    SATURATION,
    mutual=MUTUAL,
    reach=0.96e-3,
    largest_flux=0.046,
    largest_current=6.0,
)
positions = st.floats(-0.9e-3, 0.9e-3)


def exact_current(flux, x):
    return flux * (GAP - x) / CONSTANT + (flux / SATURATION) ** 9


@pytest.mark.parametrize(
    ("current", "x", "force"), [(1.0, 0.0, 3.2), (2.5, 0.0, 19.5), (2.5, 0.8e-3, 39.2)]
)
def test_forces_of_the_reference_set(current, x, force):
    """equations.md 5.2: 3.2 N and 19.5 N at the centre, 39 N at the end."""
    assert coil_force(POLE, current, x) == pytest.approx(force, rel=5e-3)


@pytest.mark.parametrize(
    ("x", "inductance"), [(-0.8e-3, 7.4e-3), (0.0, 10.9e-3), (0.8e-3, 20.5e-3)]
)
def test_inductances_of_the_reference_set(x, inductance):
    assert 1e-3 / coil_current(POLE, 1e-3, 0.0, x) == pytest.approx(inductance, rel=5e-3)


@given(st.floats(0.0, 0.044), st.floats(-2.6, 2.6), positions)
def test_current_is_that_of_the_pole_behind_the_mutual_flux(own, other, x):
    found = coil_current(POLE, own + MUTUAL * other, other, x)
    assert found == pytest.approx(exact_current(own, x), abs=4e-3)


@given(st.floats(-0.05, 0.05), st.floats(1e-5, 0.02), st.floats(-3.0, 3.0), positions)
def test_current_rises_with_flux_and_is_odd(flux, more, other, x):
    assert coil_current(POLE, flux + more, other, x) > coil_current(POLE, flux, other, x)
    assert coil_current(POLE, -flux, -other, x) == -coil_current(POLE, flux, other, x)


@given(st.floats(0.0, 5.0), st.floats(0.01, 1.0), positions)
def test_force_draws_shut_rises_with_current_and_is_even(current, more, x):
    assert coil_force(POLE, current, x) >= 0.0
    assert coil_force(POLE, current + more, x) > coil_force(POLE, current, x)
    assert coil_force(POLE, -current, x) == coil_force(POLE, current, x)


def work_around(m, fluxes, xs):
    """Return what a closed loop of fluxes and position gains, over what it moves [1]."""
    gained = moved = 0.0
    count = len(xs)
    for n in range(count):
        k = (n + 1) % count
        ia, ib = solved(m, fluxes[n], xs[n])
        ja, jb = solved(m, fluxes[k], xs[k])
        electric = 0.5 * ((ia + ja) * (fluxes[k][0] - fluxes[n][0]))
        electric += 0.5 * ((ib + jb) * (fluxes[k][1] - fluxes[n][1]))
        force = coil_force(m, ia, xs[n]) - coil_force(m, ib, -xs[n])
        after = coil_force(m, ja, xs[k]) - coil_force(m, jb, -xs[k])
        mechanic = 0.5 * (force + after) * (xs[k] - xs[n])
        gained += electric - mechanic
        moved += abs(electric) + abs(mechanic)
    return gained / moved


def solved(m, flux, x):
    """Return the currents that belong to two fluxes, by repeated substitution."""
    ia = ib = 0.0
    for _ in range(40):
        ia, ib = coil_current(m, flux[0], ib, x), coil_current(m, flux[1], ia, -x)
    return ia, ib


@pytest.mark.no_cover
@pytest.mark.parametrize("phase", [0.0, 0.7, 1.9, 3.3])
def test_a_closed_loop_gains_no_energy(phase):
    """Both coils and the position move: the curves come from one energy within 0.1 %."""
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    xs = 0.7e-3 * np.sin(angle)
    fluxes = np.column_stack(
        [0.02 + 0.012 * np.cos(angle + phase), 0.015 - 0.008 * np.sin(2.0 * angle + phase)]
    )
    assert abs(work_around(POLE, fluxes, xs)) < 1e-3


@cache
def computed():
    """Return a field computation's table of the same pole."""
    current = np.linspace(0.0, 6.0, 25)
    position = np.linspace(-0.96e-3, 0.96e-3, 17)
    flux = np.array([[coil_flux(POLE, i, 0.0, x) for x in position] for i in current])
    flux[0] = 0.0
    return FluxCurves(current, position, flux, MUTUAL)


def test_computed_curves_give_the_pole_back():
    """From 25 x 17 values; the corner of saturation is the worst."""
    found = map_from_curves(computed())
    for x in (-0.8e-3, -0.3e-3, 0.0, 0.4e-3, 0.8e-3):
        for current in (0.5, 1.0, 1.7, 2.5):
            wanted = coil_force(POLE, current, x)
            assert coil_force(found, current, x) == pytest.approx(wanted, rel=0.02, abs=0.02)
            flux = coil_flux(POLE, current, 0.0, x)
            assert coil_current(found, flux, 0.0, x) == pytest.approx(current, rel=0.01)


def test_computed_curves_gain_no_energy_either():
    angle = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    fluxes = np.column_stack([0.02 + 0.01 * np.cos(angle), 0.015 + 0.008 * np.sin(angle)])
    assert abs(work_around(map_from_curves(computed()), fluxes, 0.6e-3 * np.sin(angle))) < 1e-3


def dented(row, column, value):
    curves = computed()
    flux = curves.flux.copy()
    flux[row, column] = value
    return replace(curves, flux=flux)


@pytest.mark.parametrize(
    ("curves", "words"),
    [
        (dented(5, 3, 0.0), r"map_flux\[5\]\[3\] = 0 Wb: must rise with the current"),
        (dented(0, 2, 1e-3), "the first current must be 0, with a flux of 0"),
        (replace(computed(), position=np.linspace(-1e-3, 2e-3, 17)), "symmetric about 0"),
        (replace(computed(), current=np.linspace(6.0, 0.0, 25)), r"map_current\[1\] = 5.75"),
        (replace(computed(), position=np.linspace(-1e-3, 1e-3, 5)), "425 values for 25 currents"),
    ],
)
def test_what_is_no_solenoid_is_refused_by_name(curves, words):
    with pytest.raises(ValueError, match=words):
        map_from_curves(curves)
