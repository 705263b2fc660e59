# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The mesh: exact areas, slanted edges, mirror, sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.design.field import make_model, solve_field
from valve_twin.design.field.grid import make_grid
from valve_twin.design.geometry import DoubleStroke, Region, Section, read_design
from valve_twin.design.geometry.section import area
from valve_twin.design.materials import Steel

SECTION = DoubleStroke().section()


def areas(grid):
    (r0, z0), (r1, z1), (r2, z2) = (grid.points[:, grid.triangles[k]] for k in range(3))
    return 0.5 * np.abs((r1 - r0) * (z2 - z0) - (r2 - r0) * (z1 - z0))


@pytest.mark.parametrize("fine", [0.4, 1.0])
@pytest.mark.parametrize("gap_ratio", [0.1875, 0.16, 0.22])
def test_every_region_is_filled_exactly_the_cone_as_well(fine, gap_ratio):
    section = DoubleStroke(gap_ratio=gap_ratio).section()
    grid = make_grid(section, fine)
    found = areas(grid)
    assert found.min() > 0.0
    for k, region in enumerate(section.regions):
        assert found[grid.region == k].sum() == pytest.approx(area(region.outline), rel=1e-9)
    assert found.sum() == pytest.approx(section.radius * (section.high - section.low), rel=1e-12)


def test_the_mesh_of_a_mirror_is_one_to_the_last_bit():
    grid = make_grid(SECTION, 1.0)
    assert (grid.lines_z == -grid.lines_z[::-1]).all()
    centres = grid.points[:, grid.triangles].mean(axis=1)
    there = {(round(r, 9), round(z, 9)) for r, z in centres.T}
    assert {(r, -z) for r, z in there} == there


def test_a_finer_mesh_has_more_triangles_and_the_sliding_gap_layers():
    sizes = [make_grid(SECTION, fine).triangles.shape[1] for fine in (0.5, 1.0, 2.0)]
    assert sizes[0] < 0.5 * sizes[1] < 0.25 * sizes[2]
    r = make_grid(SECTION, 1.0).lines_r
    assert np.sum((r > 8e-3 - 1e-9) & (r < 8.25e-3 + 1e-9)) == 4


def test_the_sample_with_one_coil_is_meshed_as_well(root):
    section = read_design(root / "samples" / "design" / "pot_magnet.yaml")
    assert isinstance(section, Section)
    assert make_grid(section, 0.5).triangles.shape[1] > 500


def like_the_reference(**changes):
    return replace(DoubleStroke(**changes).section(), like=SECTION)


@pytest.mark.parametrize(
    "changes", [{"gap_ratio": 0.2}, {"overlap_ratio": 0.3}, {"tip_ratio": 0.25}, {"turns": 350}]
)
def test_a_section_like_another_has_its_mesh_stretched(changes):
    known = make_grid(SECTION, 0.4, 1e-3)
    found = make_grid(like_the_reference(**changes), 0.4, 1e-3)
    assert (found.triangles == known.triangles).all()
    assert (found.region == known.region).all()
    assert np.abs(found.points - known.points).max() > 1e-5
    found = make_grid(replace(SECTION, like=SECTION), 0.4, 1e-3)
    assert (found.points == known.points).all()


def test_corners_that_part_get_a_line_and_the_others_keep_theirs():
    # collar and coil of the reference begin at one place
    for ratio in (2.85, 3.15):
        section = like_the_reference(armature_ratio=ratio)
        found, known = make_grid(section, 0.4), make_grid(SECTION, 0.4)
        assert len(found.lines_z) == len(known.lines_z) + 2
        assert len(found.lines_r) == len(known.lines_r)
        assert areas(found).sum() == pytest.approx(
            section.radius * (section.high - section.low), rel=1e-12
        )


def test_other_parts_have_a_mesh_of_their_own():
    own = make_grid(DoubleStroke(gap_ratio=0.2).section(), 0.4)
    fewer = replace(SECTION, regions=SECTION.regions[:-1])
    found = make_grid(replace(DoubleStroke(gap_ratio=0.2).section(), like=fewer), 0.4)
    assert (found.points == own.points).all()


def test_a_mesh_is_stretched_by_no_more_than_twice():
    own = make_grid(DoubleStroke(coil_ratio=9.0).section(), 0.4)
    found = make_grid(like_the_reference(coil_ratio=9.0), 0.4)
    assert 0.5 * len(own.lines_z) < len(found.lines_z) < len(own.lines_z)


def test_fields_on_a_stretched_mesh_change_evenly_with_a_dimension():
    """A line of the mesh more or less moves the force by as much as a dimension does."""
    ratios = 3.0 * np.linspace(0.97, 1.03, 9)
    sections = [DoubleStroke(armature_ratio=r, collar_ratio=0.3).section() for r in ratios]
    uneven = []
    for like in (None, sections[4]):
        models = [make_model(replace(s, like=like), 0.4) for s in sections]
        force = np.array([solve_field(m, (2.0, 0.0)).force for m in models])
        smooth = np.polynomial.Polynomial.fit(ratios, force, 2)(ratios)
        uneven.append(np.abs(force - smooth).max() / force.mean())
    own, stretched = uneven
    assert stretched < 2e-5
    assert own > 20.0 * stretched


def test_edges_that_no_grid_can_follow_are_refused():
    # three parallel edges turn a line by an irrational part of the height, again and again
    part = 10.0 * (np.sqrt(2.0) - 1.0)
    ends = (((0.0, 0.0), (10.0, 10.0)), ((part, 0.0), (10.0, 10.0 - part)),
            ((0.0, 10.0 - part), (part, 10.0)))  # fmt: skip
    regions = []
    for k, ((r0, z0), (r1, z1)) in enumerate(ends):
        corners = ((r0, z0), (r0 + 0.5, z0), (r1 + 0.5, z1), (r1, z1))
        outline = tuple((1e-3 * r, 1e-3 * z) for r, z in corners)
        regions.append(Region(f"rib_{k}", "s", outline))
    section = Section("s", tuple(regions), {"s": Steel()}, None, 0.03, -0.03, 0.03)
    with pytest.raises(ValueError, match="slanted edges ask for more than 600 grid lines"):
        make_grid(section)


def test_a_mesh_too_coarse_or_too_fine_is_refused():
    with pytest.raises(ValueError, match=r"fine = 10: must be from 0.2 to 6"):
        make_grid(SECTION, 10.0)
