# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compressible fluid, line losses, smooth root and seal friction against closed forms."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.physics.fluid import compressibility, fittings, laminar, smooth_root
from valve_twin.core.physics.friction import stribeck


def slope_of(f, x, step):
    return (f(x + step) - f(x - step)) / (2.0 * step)


def test_fluid_without_air_has_its_bulk_modulus():
    assert compressibility(5e6, 1e9, 0.0) == (1e-9, 0.0)


@given(st.floats(0.0, 3e7), st.floats(1e-4, 0.1))
def test_air_softens_the_fluid_less_the_higher_the_pressure(pressure, air):
    soft, slope = compressibility(pressure, 1e9, air)
    assert soft > 1e-9
    assert slope < 0.0
    measured = slope_of(lambda p: compressibility(p, 1e9, air)[0], pressure, 1e2)
    assert slope == pytest.approx(measured, rel=1e-3)


def test_air_is_not_stretched_without_end():
    assert np.isfinite(compressibility(-1e9, 1e9, 0.01)).all()


@given(st.floats(-2e7, 2e7))
def test_root_is_odd_smooth_and_close_to_the_root(drop):
    value, slope = smooth_root(drop, 5e3)
    assert smooth_root(-drop, 5e3)[0] == -value
    assert slope > 0.0
    assert abs(value) <= np.sqrt(abs(drop)) + 1e-12
    if abs(drop) > 1e6:
        assert value == pytest.approx(np.sign(drop) * np.sqrt(abs(drop)), rel=1e-5)
    measured = slope_of(lambda d: smooth_root(d, 5e3)[0], drop, 1.0)
    assert slope == pytest.approx(measured, rel=1e-3)


def test_line_losses_follow_hagen_poiseuille_and_its_fittings():
    assert laminar(0.014, 1.5, 4.6e-3) == pytest.approx(8 * 0.014 * 1.5 / (pi * 2.3e-3**4))
    area = 1e-5
    assert fittings(4.0, 860.0, area) * 1e-10 == pytest.approx(4.0 * 860.0 / 2.0)


@given(st.floats(-1.0, 1.0))
def test_friction_is_odd_and_grows_to_coulomb_and_viscous(v):
    args = (25.0, 40.0, 60.0, 2e-3, 1e-2)
    force, slope = stribeck(v, *args)
    assert stribeck(-v, *args)[0] == -force
    assert force * v >= 0.0
    measured = slope_of(lambda x: stribeck(x, *args)[0], v, 1e-7)
    assert slope == pytest.approx(measured, rel=1e-3, abs=1e-2)
    if abs(v) > 0.05:
        assert abs(force) == pytest.approx(25.0 + 60.0 * abs(v), rel=1e-6)
