# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sections: what cannot be one is refused with place and value."""

from __future__ import annotations

import time

import numpy as np
import pytest

from test.peak import forget_peak, peak_mb
from valve_twin.design.field.grid import make_grid
from valve_twin.design.geometry.section import (
    Motion,
    Region,
    Section,
    area,
    crossing,
    inside,
    rectangle,
)
from valve_twin.design.materials import Steel

CROSS = ((0, 0), (5, 0), (5, 9), (2, 9), (2, -3), (3, -3), (3, 5), (0, 5))
ONE = Region("one", "steel", rectangle(0.0, 2e-3, 0.0, 5e-3))


def section(*regions: Region) -> Section:
    return Section("s", regions, {"steel": Steel()}, None, 0.02, -0.02, 0.02)


def test_area_and_inside_of_a_triangle():
    triangle = ((0.0, 0.0), (2.0, 0.0), (0.0, 1.0))
    assert area(triangle) == 1.0
    r, z = np.array([0.5, 1.5, 0.5, -0.1]), np.array([0.5, 0.5, 0.9, 0.5])
    assert inside(triangle, r, z).tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("region", "words"),
    [
        (Region("two", "steel", rectangle(1e-3, 3e-3, 4e-3, 6e-3)), "one and two overlap at r ="),
        (
            Region("two", "iron", rectangle(3e-3, 4e-3, 0.0, 1e-3)),
            "'iron' is not known; there are",
        ),
        (
            Region("two", "air", rectangle(3e-3, 3e-2, 0.0, 1e-3)),
            "outside the box, r from 0 to 0.02",
        ),
        (
            Region("two", "air", rectangle(3e-3, 3e-3, 0.0, 1e-3)),
            "two: outline of 4 corners has no",
        ),
        (Region("two", "air", rectangle(3e-3, 4e-3, 0.0, 1e-3), "A"), "turns = 0 of coil A"),
        (
            Region("two", "steel", rectangle(3e-3, 4e-3, 0.0, 1e-3), "A", 5),
            "wound in a linear material without",
        ),
        (
            Region("two", "air", ((3e-3, 0.0), (5e-3, 9e-3), (5e-3, 0.0), (3e-3, 12e-3))),
            "two: the edge from r = 0.003, z = 0 to r = 0.005, z = 0.009 crosses that from "
            "r = 0.005, z = 0 to r = 0.003, z = 0.012",
        ),
        (
            Region("two", "air", tuple((3e-3 + 1e-3 * r, 1e-3 * z) for r, z in CROSS)),
            "two: the edge from r = 0.003, z = 0 to r = 0.008, z = 0 crosses that from r = 0.005,",
        ),
        (
            Region("two", "air", ((3e-3, 0.0), (5e-3, 2e-3), (5e-3, 0.0), (3e-3, 2e-3))),
            "two: the edge from r = 0.003, z = 0 to r = 0.005, z = 0.002 crosses",  # no area
        ),
        (Region("two", "air", ((3e-3, 0.0), (5e-3, 2e-3))), "two: outline of 2 corners has no"),
        (
            Region("two", "air", ((3e-3, 0.0), (5e-3, np.nan), (5e-3, 0.0))),
            "two: corner r = 0.005, z = nan lies outside the box",
        ),
    ],
)
def test_a_region_that_cannot_be_is_refused(region, words):
    with pytest.raises(ValueError, match=words):
        section(ONE, region)


@pytest.mark.parametrize("box", [(0.0, -1.0, 1.0), (0.02, 0.02, -0.02), (0.02, np.nan, 0.02)])
def test_a_box_without_room_is_refused(box):
    with pytest.raises(ValueError, match="radius must be above 0, high above low"):
        Section("s", (), {}, None, *box)


def test_an_outline_with_a_slit_to_its_hole_is_none_that_crosses_itself():
    ring = ((0, 0), (9, 0), (9, 9), (0, 9), (0, 4), (3, 4), (3, 6), (6, 6), (6, 3), (3, 3),
            (3, 4), (0, 4))  # fmt: skip
    assert crossing(tuple((1e-3 * r, 1e-3 * z) for r, z in ring)) == ()
    turns = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    fine = [(1.0 + np.cos(a), np.sin(a)) for a in turns]
    assert crossing(tuple(fine)) == ()
    fine[3], fine[5] = fine[5], fine[3]
    assert len(crossing(tuple(fine))) == 2


def test_regions_that_touch_do_not_overlap():
    two = Region("two", "steel", ((2e-3, 0.0), (4e-3, 0.0), (2e-3, 5e-3)))
    three = Region("three", "air", ((4e-3, 0.0), (4e-3, 5e-3), (2e-3, 5e-3)))
    assert len(section(ONE, two, three).regions) == 3


def halves(r: float, z: float, wide: float, tall: float, *, rises: bool) -> tuple[Region, Region]:
    low, right, high, left = ((1e-3 * a, 1e-3 * b) for a, b in rectangle(r, r + wide, z, z + tall))
    if rises:
        return Region("one", "air", (low, right, high)), Region("two", "air", (low, high, left))
    return Region("one", "air", (low, right, left)), Region("two", "air", (right, high, left))


@pytest.mark.parametrize("rises", [True, False])
def test_halves_of_a_rectangle_touch_along_its_diagonal(rises):
    """5 x 14 mm at (10, 20) overlapped: points of the same share in r and z lie on it."""
    rng = np.random.default_rng(1)
    for wide, tall in [(5.0, 14.0), *rng.integers(1, 200, (60, 2)) / 10.0]:
        one, two = halves(10.0, 20.0, wide, tall, rises=rises)
        assert len(box((one, two)).regions) == 2
        moved = 2.5e-4 * wide if rises else -2.5e-4 * wide
        over = Region("over", "air", tuple((r + moved, z) for r, z in two.outline))
        with pytest.raises(ValueError, match="one and over overlap"):
            box((one, over))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"still_radius": 7e-3}, "motion.still_radius = 0.007: must be above radius = 0.008"),
        ({"still_high": 11e-3}, "must rise"),
        ({"stroke": 2e-3}, "motion.stroke = 0.002: must be from 0, below 0.0015"),
    ],
)
def test_a_motion_that_would_fold_the_air_is_refused(change, words):
    known = {"radius": 8e-3, "still_radius": 8.25e-3, "low": -12e-3, "high": 12e-3,
             "still_low": -13.5e-3, "still_high": 13.5e-3, "stroke": 1e-3}  # fmt: skip
    Motion(**known)
    with pytest.raises(ValueError, match=words):
        Motion(**{**known, **change})


def stairs(count, wide):
    """Return the regions of so many squares along a diagonal, `wide` of their distance each."""
    step = 40e-3 / count
    places = [1e-3 + k * step for k in range(count)]
    outlines = [rectangle(a, a + wide * step, a, a + wide * step) for a in places]
    return tuple(Region(f"s{k}", "steel", outline) for k, outline in enumerate(outlines))


def box(regions):
    return Section("box", regions, {"steel": Steel()}, None, radius=0.05, low=-0.05, high=0.05)


def test_a_drawing_of_many_corners_is_checked_at_once_or_refused():
    """4 GB and minutes went for 2000 squares, 60 MB a square."""
    begin = time.process_time()
    forget_peak()
    before_mb = peak_mb()
    section = box(stairs(499, 0.5))
    with pytest.raises(ValueError, match="s8 and s9 overlap at r ="):
        box((*stairs(499, 0.5)[:8], *stairs(499, 1.5)[8:9], *stairs(499, 0.5)[9:]))
    with pytest.raises(ValueError, match="2004 corners, a field is computed of at most 2000"):
        box(stairs(501, 0.5))
    with pytest.raises(ValueError, match="more than 500000 cells: let corners share"):
        make_grid(section)
    assert time.process_time() - begin < 10.0
    assert peak_mb() - before_mb < 200.0
