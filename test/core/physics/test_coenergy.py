# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""One coenergy for flux linkages and force: exact slopes, no energy from a cycle, an inverse."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from valve_twin.core.physics.coenergy import (
    CoenergyMap,
    check_inductances,
    linear_map,
    spline_coefficients,
)

CURRENTS, POSITIONS = np.linspace(0.0, 3.0, 5), np.linspace(-1e-3, 1e-3, 6)
X0 = 2e-3


def two_coils(bend=-1e-3):
    """Return a map of W = L (a^2 (1 + x/X0) + b^2 (1 - x/X0))/2 + M a b + bend (a^3 + b^3)."""
    a, b, x = np.meshgrid(CURRENTS, CURRENTS, POSITIONS, indexing="ij")
    p, q, ell, m = 1 + x / X0, 1 - x / X0, 0.05, -0.004
    values = np.zeros(tuple(2 * n for n in a.shape))
    values[0::2, 0::2, 0::2] = ell * (a**2 * p + b**2 * q) / 2 + m * a * b + bend * (a**3 + b**3)
    values[1::2, 0::2, 0::2] = ell * a * p + m * b + 3 * bend * a**2
    values[0::2, 1::2, 0::2] = ell * b * q + m * a + 3 * bend * b**2
    values[0::2, 0::2, 1::2] = ell * (a**2 - b**2) / 2 / X0
    values[1::2, 1::2, 0::2] = m
    values[1::2, 0::2, 1::2], values[0::2, 1::2, 1::2] = ell * a / X0, -ell * b / X0
    axes = (CURRENTS, CURRENTS, POSITIONS)
    return CoenergyMap(("A", "B"), CURRENTS, POSITIONS, spline_coefficients(values, axes), {})


def rough():
    """Return a map of any values: what holds for it holds for every map."""
    values = np.random.default_rng(5).normal(size=(10, 10, 12))
    axes = (CURRENTS, CURRENTS, POSITIONS)
    return CoenergyMap(("A", "B"), CURRENTS, POSITIONS, spline_coefficients(values, axes), {})


def points(count, seed=2):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.05, 2.95, (count, 2)), rng.uniform(-0.9e-3, 0.9e-3, count)


def test_a_cubic_coenergy_comes_back_everywhere():
    i, x = points(200)
    a, b = i.T
    found = two_coils()
    psi = found.flux(i, x)
    assert psi[:, 0] == pytest.approx(0.05 * a * (1 + x / X0) - 0.004 * b - 3e-3 * a**2)
    assert psi[:, 1] == pytest.approx(0.05 * b * (1 - x / X0) - 0.004 * a - 3e-3 * b**2)
    assert found.force(i, x) == pytest.approx(0.05 * (a**2 - b**2) / 2 / X0)
    assert found.inductance(i, x)[:, 0, 1] == pytest.approx(np.full(200, -0.004))
    assert found.inductance(i, x)[:, 0, 0] == pytest.approx(0.05 * (1 + x / X0) - 6e-3 * a)


def test_coils_without_iron_are_linear():
    i, x = points(50)
    (a, b), found = i.T, linear_map(0.05, -0.004, X0, 5, 6)
    assert found.flux(i, x)[:, 1] == pytest.approx(0.05 * b * (1 - x / X0) - 0.004 * a)
    assert found.force(i, x) == pytest.approx(0.05 * (a**2 - b**2) / 2 / X0)


def test_force_over_current_is_flux_over_position_in_any_map():
    found, (i, x) = rough(), points(300)
    h = 1e-6
    for k in (0, 1):
        step = np.zeros(2)
        step[k] = h
        over_i = (found.force(i + step, x) - found.force(i - step, x)) / (2 * h)
        over_x = (found.flux(i, x + 1e-9) - found.flux(i, x - 1e-9))[:, k] / 2e-9
        smooth = np.abs(over_i - over_x) < 1e-4 * np.abs(over_i).max()
        assert smooth.mean() > 0.99  # but for a point within h of a node, where slopes jump


def test_no_closed_cycle_makes_energy():
    # the work psi di + F dx along straight lines, cut where they cross a node: Gauss is exact
    found = rough()
    corners = np.array([(0.1, 0.2, -0.9e-3), (2.8, 0.4, 0.3e-3), (1.3, 2.9, 0.9e-3),
                        (0.6, 1.9, -0.2e-3), (0.1, 0.2, -0.9e-3)])  # fmt: skip
    at, weight = np.polynomial.legendre.leggauss(6)
    total, gone = 0.0, 0.0
    for start, end in pairwise(corners):
        nodes = (CURRENTS, CURRENTS, POSITIONS)
        crossed = [(n - a) / (b - a) for n, a, b in zip(nodes, start, end, strict=True)]
        cuts = np.unique(np.clip(np.concatenate([[0.0, 1.0], *crossed]), 0.0, 1.0))
        for low, high in pairwise(cuts):
            share = low + 0.5 * (at + 1.0) * (high - low)
            path = start + np.outer(share, end - start)
            i, x = path[:, :2], path[:, 2]
            work = np.column_stack([found.flux(i, x), found.force(i, x)]) @ (end - start)
            piece = 0.5 * (high - low) * float(weight @ work)
            total, gone = total + piece, gone + abs(piece)
    assert gone > 1.0
    assert abs(total) < 1e-10 * gone


def test_the_inverse_finds_the_current_again():
    found, (i, x) = two_coils(), points(100)
    psi = found.flux(i, x)
    for k in (0, 1):
        assert found.current(k, psi[:, k], i, x) == pytest.approx(i[:, k], abs=1e-9)


def test_what_lies_beyond_the_map_is_named_with_its_range():
    found = two_coils()
    with pytest.raises(ValueError, match=r"i_B = 4: beyond the map, from 0 to 3 \[A\]"):
        found.flux(np.array([[1.0, 4.0]]), np.zeros(1))
    with pytest.raises(ValueError, match=r"x = 0.002: beyond the map, from -0.001 to 0.001 \[m\]"):
        found.force(np.array([[1.0, 1.0]]), np.array([2e-3]))
    with pytest.raises(ValueError, match=r"psi_A = 0.5: beyond the map, from -0.004 to"):
        found.current(0, np.array([0.5]), np.array([[0.0, 1.0]]), np.zeros(1))
    with pytest.raises(ValueError, match="i_A = nan: beyond"):
        found.force(np.array([[np.nan, 1.0]]), np.zeros(1))


@pytest.mark.parametrize("shape", [(1, 1), (2,), (2, 2), (1, 3)])
def test_currents_of_another_shape_are_one_line(shape):
    with pytest.raises(ValueError, match=r"currents of shape .*, 1 positions: must be a row for"):
        two_coils().flux(np.ones(shape), np.zeros(1))


def test_a_flux_that_falls_with_its_current_is_refused():
    assert check_inductances(two_coils()) == pytest.approx(0.025 - 18e-3, rel=1e-3)
    with pytest.raises(ValueError, match=r"psi_A falls with its current at .* compute the map at"):
        check_inductances(two_coils(bend=-2e-3))


def test_a_single_coil_has_a_map_as_well():
    a, x = np.meshgrid(CURRENTS, POSITIONS, indexing="ij")
    values = np.zeros((10, 12))
    values[0::2, 0::2], values[1::2, 0::2] = 0.01 * a**2 * (1 + x), 0.02 * a * (1 + x)
    values[0::2, 1::2], values[1::2, 1::2] = 0.01 * a**2, 0.02 * a
    coefficients = spline_coefficients(values, (CURRENTS, POSITIONS))
    found = CoenergyMap(("A",), CURRENTS, POSITIONS, coefficients, {})
    i = np.array([[0.3], [2.2]])
    assert found.flux(i, np.zeros(2)) == pytest.approx(0.02 * i)
    assert found.force(i, np.zeros(2)) == pytest.approx(0.01 * i[:, 0] ** 2)


def test_on_other_nodes_it_is_the_same_where_it_is_cubic():
    of = linear_map(0.05, -0.004, X0, 5, 6)
    nodes = np.linspace(0.0, 2.5, 4), np.linspace(-0.8e-3, 1e-3, 5)
    found, i, x = of.on_nodes(*nodes), np.array([[0.4, 2.1], [1.7, 0.2]]), np.array([-3e-4, 7e-4])
    assert found.coefficients.shape == (8, 8, 10)
    assert found.coenergy(i, x) == pytest.approx(of.coenergy(i, x))
    assert found.force(i, x) == pytest.approx(of.force(i, x))
    with pytest.raises(ValueError, match="beyond the map"):
        of.on_nodes(np.linspace(0.0, 4.0, 4), nodes[1])
