# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Doubts about a map: what the fields of the changed section say."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from valve_twin.design.doubt import TOLERANCES, compute_doubts
from valve_twin.design.field import make_model, solve_field
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid, compute_map
from valve_twin.design.wear import worn

NEW = DoubleStroke()
GRID = MapGrid(currents=4, positions=4, fine=0.3)
AT = np.array([[2.0, 0.3]]), np.array([3e-4])


@pytest.fixture(scope="module")
def doubts(maps_once):
    curves = compute_map(NEW.section(), replace(GRID, currents=5))
    return curves, {of.name: of.change for of in compute_doubts(NEW, curves, GRID)}


def test_every_doubt_stands_on_the_nodes_of_the_map(doubts):
    curves, found = doubts
    assert list(found) == ["mesh", "gap_a", "gap_b", "steel"]
    for change in found.values():
        assert change.coefficients.shape == curves.coefficients.shape


def test_that_of_the_mesh_is_what_a_finer_one_changes(doubts):
    coarse, fine = (
        solve_field(make_model(NEW.section(), n * GRID.fine), AT[0][0], AT[1][0]) for n in (1, 2)
    )
    told = doubts[1]["mesh"]
    assert told.flux(*AT)[0, 0] == pytest.approx(fine.flux[0] - coarse.flux[0], rel=0.3)


def test_those_of_gap_and_steel_are_a_standard_deviation_of_their_tolerances(doubts):
    """A signature is a secant to a larger change, which bends: a third."""
    for name, size in TOLERANCES.items():
        section = worn(NEW, name, size / sqrt(3.0))
        new, old = (
            solve_field(make_model(of, GRID.fine), AT[0][0], AT[1][0])
            for of in (NEW.section(), section)
        )
        told = doubts[1]["gap_a" if name == "gap" else name].flux(*AT)[0, 0]
        assert told < 0.0
        assert told == pytest.approx(old.flux[0] - new.flux[0], rel=0.33)
