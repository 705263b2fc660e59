# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The mesh: exact areas, slanted edges, mirror, sizes."""

from __future__ import annotations

import numpy as np
import pytest

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
