# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tables of a coenergy map: the spline between its nodes, straight lines beyond its currents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from valve_twin.core.physics.coenergy import CoenergyMap, spline_coefficients
from valve_twin.core.physics.coenergy_tables import coupling_of, make_tables
from valve_twin.core.physics.curves import flux_of, force_of, locate, static_currents

CURRENTS, POSITIONS = np.linspace(0.0, 3.0, 7), np.linspace(-1e-3, 1e-3, 9)
X0, GAIN, MUTUAL, SATURATION = 2e-3, 0.05, -4e-3, 4.0


def solenoid():
    """Return the map of W = w(a) (1 + x/X0) + w(b) (1 - x/X0) + M a b, which saturates."""

    def own(i):
        u = i / SATURATION
        return GAIN * SATURATION**2 * (np.sqrt(1 + u**2) - 1), GAIN * i / np.sqrt(1 + u**2)

    a, b, x = np.meshgrid(CURRENTS, CURRENTS, POSITIONS, indexing="ij")
    p, q = 1 + x / X0, 1 - x / X0
    (wa, da), (wb, db) = own(a), own(b)
    values = np.zeros(tuple(2 * n for n in a.shape))
    values[0::2, 0::2, 0::2] = wa * p + wb * q + MUTUAL * a * b
    values[1::2, 0::2, 0::2] = da * p + MUTUAL * b
    values[0::2, 1::2, 0::2] = db * q + MUTUAL * a
    values[0::2, 0::2, 1::2] = (wa - wb) / X0
    values[1::2, 1::2, 0::2] = MUTUAL
    values[1::2, 0::2, 1::2], values[0::2, 1::2, 1::2] = da / X0, -db / X0
    axes = (CURRENTS, CURRENTS, POSITIONS)
    return CoenergyMap(("A", "B"), CURRENTS, POSITIONS, spline_coefficients(values, axes), {})


MAP = solenoid()
TABLES = make_tables(MAP)


def states(count, seed, low=0.0, high=3.0):
    rng = np.random.default_rng(seed)
    return rng.uniform(low, high, (count, 2)), rng.uniform(-1e-3, 1e-3, count)


def flux(i, x):
    return np.array([[flux_of(TABLES, 0, a, b, p), flux_of(TABLES, 1, b, a, p)]
                     for (a, b), p in zip(i, x, strict=True)])  # fmt: skip


def force(i, x):
    return np.array([force_of(TABLES, a, b, p) for (a, b), p in zip(i, x, strict=True)])


def test_tables_are_the_spline_on_states_between_their_nodes():
    i, x = states(500, seed=11)
    assert np.abs(flux(i, x) - MAP.flux(i, x)).max() < 5e-4 * MAP.flux(i, x).max()
    assert np.abs(force(i, x) - MAP.force(i, x)).max() < 1e-3 * MAP.force(i, x).max()


@njit
def currents_of(tables, psi, last, x):
    return static_currents(tables, psi, last, locate(tables, x))


def test_the_inverse_finds_the_currents_again_inside_and_beyond():
    i, x = states(500, seed=12, low=-0.3, high=3.6)
    psi = flux(i, x)
    pairs = zip(psi.tolist(), i.tolist(), x.tolist(), strict=True)
    found = np.array([currents_of(TABLES, tuple(p), tuple(c), at) for p, c, at in pairs])
    assert np.abs(found - i).max() < 1e-9


def test_the_inverse_rises_with_the_flux_linkage_everywhere():
    psi = np.linspace(-0.05, 0.25, 400)
    (i, x) = states(40, seed=13, low=-0.3, high=3.3)
    for (a, b), at in zip(i.tolist(), x.tolist(), strict=True):
        found = np.array([currents_of(TABLES, (p, p), (a, b), at) for p in psi.tolist()])
        assert (np.diff(found, axis=0) > 0.0).all()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_closed_cycle_of_the_tables_makes_no_energy(seed):
    # the work psi di + F dx around a loop of currents and position, midpoints of 4000 pieces
    rng = np.random.default_rng(seed)
    phase, angle = rng.uniform(0, 2 * np.pi, 3), np.linspace(0.0, 2 * np.pi, 4001)
    loops = np.sin(np.outer(angle, [1, 1, 2]) + phase)
    path = np.array([1.6, 1.6, 0.0]) + np.array([1.5, 1.5, 0.95e-3]) * loops
    middle = 0.5 * (path[1:] + path[:-1])
    i, x = middle[:, :2], middle[:, 2]
    slopes = np.column_stack([flux(i, x), force(i, x)])
    work = (slopes * np.diff(path, axis=0)).sum(axis=1)
    assert abs(work.sum()) < 3e-4 * np.abs(work).sum()


def test_beyond_the_map_flux_goes_on_straight_and_the_maxwell_relation_holds():
    at, h = np.array([0.3e-3]), np.array([0.1, 0.0])
    edge, more = np.array([[3.0, 1.0]]), np.array([0.3, 0.0])
    slope = MAP.inductance(edge, at)[0, 0, 0]
    assert flux(edge + more, at)[0, 0] - MAP.flux(edge, at)[0, 0] == pytest.approx(
        0.3 * slope, rel=1e-2
    )
    for beyond in (np.array([[3.18, 1.0]]), np.array([[-0.18, 1.0]])):
        over_i = (force(beyond + h, at) - force(beyond - h, at)) / 0.2
        over_x = (flux(beyond, at + 2e-4) - flux(beyond, at - 2e-4))[:, 0] / 4e-4
        assert over_i == pytest.approx(over_x, rel=3e-2)


def test_the_coupling_is_that_of_the_inductances():
    i, x = states(3000, seed=14)
    own = MAP.inductance(i, x)
    share = np.abs(own[:, 0, 1] / own[:, 0, 0]).max()
    assert share < coupling_of(TABLES) < 1.3 * share


def test_maps_of_another_valve_are_refused_with_the_place():
    alone = CoenergyMap(("A",), CURRENTS, POSITIONS, MAP.coefficients[0], {})
    with pytest.raises(ValueError, match=r"map of 1 coils: this valve has 2"):
        make_tables(alone)
    with pytest.raises(ValueError, match=r"map_position from -0.001 to 0.003 m: must be symm"):
        make_tables(replace(MAP, positions=POSITIONS + (POSITIONS + 1e-3)))
    with pytest.raises(ValueError, match=r"map_coenergy: psi_A falls with its current at -0.3 A"):
        make_tables(replace(MAP, coefficients=-MAP.coefficients))
