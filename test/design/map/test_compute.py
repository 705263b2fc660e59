# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The map of a solenoid against fields that it was not made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.physics.coenergy import check_inductances
from valve_twin.design.field import make_model, solve_field
from valve_twin.design.geometry import DoubleStroke, Section, read_design
from valve_twin.design.map import MapGrid, compute_map, unlike

SECTION = DoubleStroke().section()
GRID = MapGrid(currents=6, positions=5, fine=0.3)


@pytest.fixture(scope="module")
def coarse():
    return compute_map(SECTION, GRID)


def off_by(found, fine, count, seed):
    """Return the largest errors of flux [Wb] and force [N] at random states."""
    model, rng = make_model(SECTION, fine), np.random.default_rng(seed)
    i, x = rng.uniform(0.0, 3.0, (count, 2)), rng.uniform(-1e-3, 1e-3, count)
    fields = [solve_field(model, one, float(at)) for one, at in zip(i, x, strict=True)]
    flux = found.flux(i, x) - np.array([f.flux for f in fields])
    force = found.force(i, x) - np.array([f.force for f in fields])
    return np.abs(flux).max(), np.abs(force).max()


def test_a_field_at_a_node_is_kept_to_all_digits(coarse):
    field = solve_field(make_model(SECTION, 0.3), (1.2, 0.6), 0.5e-3)
    i, x = np.array([[1.2, 0.6]]), np.array([0.5e-3])
    assert coarse.coenergy(i, x)[0] == pytest.approx(field.coenergy, rel=1e-9)
    assert coarse.flux(i, x)[0] == pytest.approx(field.flux, rel=1e-6)
    assert coarse.force(i, x)[0] == pytest.approx(field.force, rel=1e-6)


def test_between_the_nodes_it_is_near_the_field(coarse):
    flux, force = off_by(coarse, 0.3, 12, seed=3)
    assert flux < 1.5e-3  # of 0.17 Wb
    assert force < 2.0  # of 136 N


def test_it_is_a_mirror_and_rises_with_the_current(coarse):
    rng = np.random.default_rng(4)
    i, x = rng.uniform(0.0, 3.0, (50, 2)), rng.uniform(-1e-3, 1e-3, 50)
    assert coarse.flux(i, x) == pytest.approx(coarse.flux(i[:, ::-1], -x)[:, ::-1], abs=1e-10)
    assert coarse.force(i, x) == pytest.approx(-coarse.force(i[:, ::-1], -x), abs=1e-7)
    assert check_inductances(coarse) > 5e-3


def test_it_says_what_it_was_made_of(coarse):
    said = coarse.provenance
    assert "armature" in str(said["section"])
    assert said["fields"] == 6 * 6 * 2 + 21
    assert len(str(said["sha256"])) == 64
    assert {"skin", "largest_current", "currents", "positions", "fine"} < set(said)
    assert "numba" in said["versions"]


def test_it_says_in_what_it_is_not_the_map_that_would_be_computed(coarse):
    assert unlike(coarse, SECTION, GRID) == ()
    finer = replace(GRID, skin=1e-3, currents=7)
    assert unlike(coarse, SECTION, finer) == ("currents 6 (now 7)", "skin 1.0 (now 0.001)")
    versions = {**coarse.provenance["versions"], "numba": "0.1"}
    old = replace(coarse, provenance={**coarse.provenance, "versions": versions})
    (said,) = unlike(old, SECTION, GRID)
    assert said.startswith("numba 0.1 (now ")
    with pytest.raises(ValueError, match="the map was computed of another section"):
        unlike(coarse, DoubleStroke(gap_ratio=0.2).section(), GRID)


def test_a_single_coil_with_a_magnet_has_a_map(root):
    section = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(section, Section)
    grid = MapGrid(largest_current=8.0, currents=4, positions=4, fine=0.3)
    found = compute_map(section, grid)
    pull = found.force(np.array([[0.0], [8.0]]), np.full(2, -0.5e-3))
    assert pull[1] < pull[0] < 0.0


def test_a_section_in_which_nothing_moves_has_none():
    with pytest.raises(ValueError, match=r"motion.stroke: a map needs an armature that moves"):
        compute_map(replace(SECTION, motion=None), GRID)


def test_a_grid_outside_its_range_is_refused():
    with pytest.raises(ValueError, match="currents = 2: must be a number from 4 to 60"):
        MapGrid(currents=2)


@pytest.mark.slow
def test_the_usual_map_is_right_to_a_part_in_five_hundred():
    flux, force = off_by(compute_map(SECTION), 0.8, 40, seed=7)
    assert flux < 0.2e-3  # of 0.17 Wb
    assert force < 0.4  # of 136 N
