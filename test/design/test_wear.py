# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Worn dimensions: what the fields of the changed section say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid
from valve_twin.design.materials import Steel
from valve_twin.design.wear import SIZES, compute_wear, mirrored, worn

FINE = 0.3
NEW = DoubleStroke()
GRID = MapGrid(currents=4, positions=4, fine=FINE)


@pytest.fixture(scope="module")
def found(maps_once):
    seen = []
    wear = compute_wear(NEW, GRID, lambda: seen.append(1))
    return {w.name: w.change for w in wear}, len(seen)


def field(section, currents, x=0.0):
    return solve_field(make_model(section, FINE), np.array(currents), x)


def test_shorted_turns_are_less_current_and_less_flux():
    short, new = worn(NEW, "turns", 0.1), NEW.section()
    one, other = field(short, [2.0, 0.5], 3e-4), field(new, [1.8, 0.5], 3e-4)
    assert one.force == pytest.approx(other.force, rel=1e-6)
    assert one.flux == pytest.approx([0.9 * other.flux[0], other.flux[1]], rel=1e-6)


@pytest.mark.parametrize("name", list(SIZES))
def test_wear_takes_flux_from_side_a(name):
    new = field(NEW.section(), [2.0, 0.0], -5e-4)
    old = field(worn(NEW, name, SIZES[name]), [2.0, 0.0], -5e-4)
    assert old.flux[0] < 0.995 * new.flux[0]


def test_signatures_are_those_of_both_sides(found):
    changes, fields = found
    assert list(changes) == ["gap_a", "gap_b", "rim_a", "rim_b", "turns_a", "turns_b", "steel"]
    assert fields > 5 * 4 * 10  # of every dimension
    currents, x = np.array([[1.0, 2.0], [2.5, 0.3]]), np.array([2e-4, -6e-4])
    for name in ("gap", "rim", "turns"):
        one, other = changes[f"{name}_a"], changes[f"{name}_b"]
        assert one.force(currents, x) == pytest.approx(-other.force(currents[:, ::-1], -x))
        fluxes = other.flux(currents[:, ::-1], -x)[:, ::-1]
        assert one.flux(currents, x) == pytest.approx(fluxes, abs=1e-12)
    steel = changes["steel"]
    assert steel.force(currents, x) == pytest.approx(mirrored(steel).force(currents, x), rel=1e-3)


def test_a_signature_tells_a_change_of_another_size(found):
    changes, _ = found
    currents, size = [2.0, 0.3], 0.5 * SIZES["gap"]
    new, old = (field(s, currents) for s in (NEW.section(), worn(NEW, "gap", size)))
    told = size * changes["gap_a"].force(np.array([currents]), np.zeros(1))[0]
    # a coarse mesh of four currents and four positions
    assert told == pytest.approx(old.force - new.force, rel=0.25)


def test_a_table_of_steel_ages_as_the_closed_form():
    h, b = Steel().curve()
    at = np.searchsorted(b, [0.5, 1.0, 1.4, 1.6, 1.8, 2.0])
    table = Steel(table_h=(0.0, *h[at].tolist()), table_b=(0.0, *b[at].tolist()))
    aged = worn(replace(NEW, steel=table), "steel", 0.5).materials["steel"]
    assert isinstance(aged, Steel)
    assert aged.table_h[1:] == pytest.approx(1.5 * h[at])


def test_what_is_no_dimension_is_named():
    with pytest.raises(
        ValueError, match="dimension 'yoke': must be one of gap, rim, turns, steel"
    ):
        worn(NEW, "yoke", 0.1)
    with pytest.raises(ValueError, match="stroke"):
        worn(NEW, "gap", -0.9)
