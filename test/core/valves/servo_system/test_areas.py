# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Orifice areas of paper 003 against their identities and against circles on their own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from valve_twin.core.valves.servo_system.areas import ORIFICES, areas

R, C, U_S, U_R = 0.35e-3, 4e-6, 8e-6, 12e-6
X = st.floats(-1.5e-3, 1.5e-3)


def at(x):
    area, slope = np.empty(ORIFICES), np.empty(ORIFICES)
    areas(x, R, C, U_S, U_R, area, slope)
    return area, slope


def lens(distance):
    """Area common to two equal circles, by integration."""
    half = 0.5 * min(distance / R, 2.0)
    return 4 * R**2 * quad(lambda s: np.sqrt(1 - s**2), half, 1, epsabs=1e-13)[0]


def segment(height):
    """Area of a circle's segment, by integration."""
    from_ = 1 - min(max(height / R, 0.0), 2.0)
    return 2 * R**2 * quad(lambda s: np.sqrt(1 - s**2), from_, 1, epsabs=1e-13)[0]


@given(X)
def test_both_sides_mirror_each_other(x):
    here, there = at(x)[0], at(-x)[0]
    np.testing.assert_allclose(here[[0, 2, 4]], there[[1, 3, 4]], rtol=0, atol=1e-18)


@given(X)
def test_areas_are_finite_and_not_negative_for_every_position(x):
    area, slope = at(x)
    assert np.isfinite(area).all()
    assert np.isfinite(slope).all()
    assert (area >= -1e-20).all()


@given(X)
def test_strips_and_leak_fill_the_clearance(x):
    """L1 + L2 + A_L = 8 pi r c exactly."""
    whole = 8 * np.pi * R * C
    strips = [
        8 * R * C * np.arccos(np.clip((2 * R - s * x - U_S) / (2 * R), 0, 1)) for s in (1, -1)
    ]
    assert sum(strips) + at(x)[0][4] == pytest.approx(whole, rel=1e-12)


@given(X, st.floats(0.0, 1e-4))
def test_supply_opens_and_return_closes_monotonically(x, further):
    before, after = at(x)[0], at(x + further)[0]
    assert after[0] >= before[0] - 1e-20
    assert after[2] <= before[2] + 1e-20


def test_orifice_1_is_shut_beyond_its_underlap():
    assert at(-U_S)[0][0] == 0.0
    assert at(-1e-3)[0][0] == 0.0
    assert at(-U_S + 1e-9)[0][0] > 0.0


@pytest.mark.parametrize("x", [-2e-4, -1e-5, 0.0, 5e-6, 1e-4, 2.2e-4, 6e-4])
def test_openings_are_those_of_circles(x):
    """Four lenses of two circles on the supply side, four segments on the return side."""
    area, _ = at(x)
    strip = 8 * R * C * np.arccos(np.clip((2 * R - x - U_S) / (2 * R), 0, 1))
    assert area[0] - strip == pytest.approx(4 * lens(max(2 * R - x - U_S, 0.0)), abs=1e-17)
    whole = 8 * np.pi * R * C
    assert area[2] - (whole - strip) == pytest.approx(4 * segment(U_R - x), abs=1e-17)


@given(X)
def test_slopes_are_derivatives_away_from_edges(x):
    edges = np.array([U_S, U_R, 2 * R - U_S, 2 * R - U_R])
    if np.min(np.abs(np.abs(x) - edges)) < 2e-6:
        return
    step = 1e-9
    measured = (at(x + step)[0] - at(x - step)[0]) / (2 * step)
    np.testing.assert_allclose(at(x)[1], measured, rtol=1e-3, atol=1e-9)
