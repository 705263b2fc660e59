# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.valves.hybrid_actuator.magnetics import (
    FIT,
    LINEAR,
    REGULAR,
    Magnetics,
    coil_current,
    coil_force,
    field_energy,
    flux_linkage,
    force,
    magnet_flux,
    magnet_force,
)

KINDS = (LINEAR, REGULAR, FIT)
GAPS = st.floats(1.1e-4, 9e-3)
CURRENTS = st.floats(-60.0, 60.0)


def solenoid(kernel=LINEAR, magnet=0.0, coupling=0.0, c3=2.18e-4):
    """Return the solenoid of paper 001 with its two magnet forces."""
    return Magnetics(
        kernel, 2.8e-7, 1.04e-6, 0.046, 7.0e-6, 6.04e-5, c3, magnet, 7.34e-4, coupling
    )


@given(kernel=st.sampled_from(KINDS), current=CURRENTS, gap=GAPS)
def test_current_and_flux_are_inverse_functions_and_odd(kernel, current, gap):
    m = solenoid(kernel)
    flux = flux_linkage(m, current, gap)
    assert coil_current(m, flux, gap) == pytest.approx(current, rel=1e-6, abs=1e-9)
    assert flux_linkage(m, -current, gap) == -flux
    if kernel != LINEAR:
        assert abs(flux) < m.saturation_flux


@given(kernel=st.sampled_from(KINDS), current=CURRENTS, gap=GAPS)
def test_force_is_not_negative_and_even_and_falls_with_the_gap(kernel, current, gap):
    m = solenoid(kernel)
    here = coil_force(m, current, gap)
    assert here >= 0.0
    assert here == coil_force(m, -current, gap)
    # the reading "fit" rises with the gap in deep saturation: its force tends to
    # lam_s 2 C1/(2 C1 - C3 d)^2, so it is tested below 80 % of the saturation flux
    deep = kernel == FIT and abs(flux_linkage(m, current, gap)) > 0.8 * m.saturation_flux
    if abs(current) > 1e-3 and not deep:
        assert coil_force(m, current, gap * 1.01) < here


@given(
    kernel=st.sampled_from(KINDS),
    current=st.floats(-12.0, 40.0),
    gap=st.floats(3e-4, 9e-3),
    coupling=st.floats(0.0, 1.0),
)
def test_force_is_the_slope_of_the_field_energy_at_constant_flux(kernel, current, gap, coupling):
    m = solenoid(kernel, 128.0, coupling)
    flux = flux_linkage(m, current, gap)
    step = 1e-4 * gap
    slope = (field_energy(m, flux, gap + step) - field_energy(m, flux, gap - step)) / (2 * step)
    assert slope == pytest.approx(force(m, current, gap), rel=1e-5, abs=1e-4)


@pytest.mark.parametrize("kernel", [REGULAR, FIT])
def test_saturating_kernel_is_linear_for_small_currents(kernel):
    """With C3 = 0 its beta is lam_s C1 = 0.322 N mm^2/A^2 (equations.md, section 6)."""
    m = solenoid(kernel, c3=0.0)
    beta = m.saturation_flux * m.c1
    assert beta == pytest.approx(0.322e-6, rel=1e-12)
    distance = 1e-3 + (m.c2 if kernel == REGULAR else -m.c2)
    for current in (1e-3, 1e-2):
        linear = beta * (current / distance) ** 2
        assert coil_force(m, current, 1e-3) == pytest.approx(linear, rel=1e-3)


def test_series_and_closed_form_of_the_force_meet():
    m = solenoid(REGULAR)
    f = 2.0 * m.c1 / (1e-3 + m.c2) + m.c3
    below, above = coil_force(m, 0.999e-3 / f, 1e-3), coil_force(m, 1.001e-3 / f, 1e-3)
    assert above / below == pytest.approx((1.001 / 0.999) ** 2, rel=1e-5)


def test_magnet_has_the_two_measured_forces():
    m = solenoid(LINEAR, 128.0)
    assert magnet_force(m, 0.5e-3) == pytest.approx(128.0, rel=1e-12)
    assert magnet_force(m, 4e-3) == pytest.approx(8.7, rel=2e-3)
    assert force(m, 0.0, 0.5e-3) == pytest.approx(128.0, rel=1e-12)


def test_inverse_current_releases_and_more_of_it_holds_again():
    """Paper 001, 3.3: there is an optimal inverse current, beyond it the force rises."""
    m = solenoid(LINEAR, 128.0, 1.0)
    currents = np.linspace(-25.0, 0.0, 251)
    forces = np.array([force(m, i, 0.5e-3) for i in currents])
    best = currents[np.argmin(forces)]
    assert best == pytest.approx(-10.7, abs=0.1)  # equations.md 1.2, item 6
    assert forces.min() == pytest.approx(0.0, abs=0.01)
    assert forces[0] > forces.min() + 100.0


@given(gap=GAPS, coupling=st.floats(0.0, 1.0))
def test_magnet_flux_falls_with_the_gap(gap, coupling):
    m = solenoid(LINEAR, 128.0, coupling)
    assert magnet_flux(m, gap) >= magnet_flux(m, gap * 1.1) >= 0.0
