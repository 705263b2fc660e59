# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A triangle mesh on a tensor grid of graded lines; no mesher.

Lines run through every corner of every region, and each cell is cut into two triangles. A slanted
edge is followed by the diagonals of the cells that it crosses: its lines in r are the images of
its lines in z. Where the section is a mirror of itself the mesh is so to the last bit, so that
opposite forces cancel. How many lines stand between two corners changes by whole ones with their
distance; a section that is `like` another has as many as that, so that its fields change evenly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.design.geometry.section import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.design.geometry.section import Section

_GROWTH = 0.5  # of the size of elements with the distance from a line that wants them small [1]
_WIDEST = 6.0  # elements at least across the radius of what is magnetic [1]
_AT_CORNER = 0.25  # size at the corners over the widest [1]
_ACROSS_SLIDE, _ACROSS_GAP = 3.0, 6.0  # elements across the gaps around and before the armature
_LEAST_SKIN = 2e-5  # [m]
_MOST_LINES = 600
_MOST_CELLS = 500_000  # some 2 GB of memory for a field, assumed
_SAME = 1e-7  # of the size of the box: lines so near are one [1]


@dataclass(frozen=True, slots=True)
class Grid:
    """Triangles of a half section.

    Attributes
    ----------
    points : (2, P) array
        Radius and place on the axis of the corners [m].
    triangles : (3, E) int array
        Corners of each triangle.
    region : (E,) int array
        Which region of the section each lies in, -1 = none.
    lines_r, lines_z : arrays
        Lines of the grid, rising [m].
    """

    points: FloatArray
    triangles: IntArray
    region: IntArray
    lines_r: FloatArray
    lines_z: FloatArray


@dataclass(frozen=True, slots=True)
class _Edge:
    """A slanted edge from (r0, z0) to (r1, z1) with z0 < z1."""

    r0: float
    z0: float
    r1: float
    z1: float

    def r_of(self, z: FloatArray) -> FloatArray:
        return self.r0 + (z - self.z0) * (self.r1 - self.r0) / (self.z1 - self.z0)

    def z_of(self, r: FloatArray) -> FloatArray:
        return self.z0 + (r - self.r0) * (self.z1 - self.z0) / (self.r1 - self.r0)


def make_grid(section: Section, fine: float = 1.0, skin: float = math.inf) -> Grid:
    """Return the mesh of a section.

    Parameters
    ----------
    section : Section
        What is meshed.
    fine : float
        Elements along a line over those of the default mesh [1].
    skin : float
        Largest size of elements at the surfaces of regions, for eddy currents [m].

    Raises
    ------
    ValueError
        If `fine` or `skin` is out of range, or the corners ask for more lines than can be.
    """
    if not 0.2 <= fine <= 6.0:
        message = f"fine = {fine:g}: must be from 0.2 to 6 [1]"
        raise ValueError(message)
    if not skin > _LEAST_SKIN:
        message = f"skin = {skin:g}: must be above {_LEAST_SKIN:g} [m]"
        raise ValueError(message)
    edges = _slanted(section)
    r, z = _lines(section, fine, skin, edges)
    if len(r) * len(z) > _MOST_CELLS:
        message = (
            f"the corners ask for {len(r)} times {len(z)} grid lines, more than {_MOST_CELLS} "
            "cells: let corners share radii or places on the axis, or lower fine"
        )
        raise ValueError(message)
    return _cut(section, r, z, edges, _near(section))


def _lines(
    section: Section, fine: float, skin: float, edges: Sequence[_Edge]
) -> tuple[FloatArray, FloatArray]:
    """Return the lines in r and z; between two corners as many as the section it is like has."""
    near, middle = _near(section), 0.5 * (section.low + section.high)
    corners, mirror = _corners(section)
    base_r, base_z = _closed(*corners, edges, near)
    widest = max(r for region in section.regions for r, _ in region.outline) / _WIDEST / fine
    r_sizes, z_sizes = _wanted(section, fine)
    sizes = widest, min(_AT_CORNER * widest, skin), _GROWTH / fine
    counts_r, counts_z = _counts(section, (base_r, base_z), corners, fine, skin)
    z = _divided(base_z, z_sizes, sizes, counts_z)
    kept = [(min(e.r0, e.r1), max(e.r0, e.r1)) for e in edges]
    r = _divided(base_r, r_sizes, sizes, counts_r, kept)
    r, z = _closed(r, z, edges, near)
    if mirror:
        z = middle + 0.5 * (z - z[::-1])
    return r, z


def _counts(
    section: Section,
    bases: tuple[FloatArray, FloatArray],
    corners: tuple[FloatArray, FloatArray],
    fine: float,
    skin: float,
) -> tuple[list[int], list[int]]:
    """Return how many cells stand between base lines where it is like another section; 0 = own."""
    own = [0] * (len(bases[0]) - 1), [0] * (len(bases[1]) - 1)
    if section.like is None:
        return own
    there, _ = _corners(section.like)
    if [len(a) for a in there] != [len(a) for a in corners]:
        return own  # other parts
    lines = _lines(section.like, fine, skin, _slanted(section.like))
    near = _near(section)
    r, z = (_between(bases[k], corners[k], there[k], lines[k], near) for k in (0, 1))
    return r, z


def _between(
    base: FloatArray, here: FloatArray, like: FloatArray, lines: FloatArray, near: float
) -> list[int]:
    """Return how many of the lines of another section stand between its corners, 0 = not known."""
    nearest = np.abs(base[:, None] - here).argmin(axis=1)
    known = np.abs(base - here[nearest]) <= near
    places = np.where(known, like[nearest], np.nan)
    return [
        int(np.sum((lines > a + near) & (lines < b - near))) + 1 if b > a + near else 0
        for a, b in pairwise(places.tolist())
    ]


def _slanted(section: Section) -> list[_Edge]:
    found = []
    for region in section.regions:
        for (r0, z0), (r1, z1) in pairwise((*region.outline, region.outline[0])):
            if r0 != r1 and z0 != z1:
                ends = sorted([(z0, r0), (z1, r1)])
                found.append(_Edge(ends[0][1], ends[0][0], ends[1][1], ends[1][0]))
    return list(dict.fromkeys(found))


def _near(section: Section) -> float:
    """Return how near lines are that are one [m]."""
    return _SAME * max(section.radius, section.high - section.low)


def _corners(section: Section) -> tuple[tuple[FloatArray, FloatArray], bool]:
    """Return radii and places of all corners, in their order, and whether it is a mirror."""
    corners = [corner for region in section.regions for corner in region.outline]
    r, z = [0.0, section.radius], [section.low, section.high]
    m = section.motion
    if m is not None:
        r += [m.radius, m.still_radius]
        z += [m.low, m.high, m.still_low, m.still_high]
    all_r, all_z = np.array(r + [c[0] for c in corners]), np.array(z + [c[1] for c in corners])
    middle, rising = 0.5 * (section.low + section.high), np.sort(all_z)
    mirror = bool(np.abs(rising + rising[::-1] - 2.0 * middle).max() < _near(section))
    return (all_r, np.append(all_z, middle) if mirror else all_z), mirror


def _merged(lines: FloatArray, near: float) -> FloatArray:
    lines = np.sort(lines)
    keep = np.concatenate([[True], np.diff(lines) > near])
    found: FloatArray = lines[keep]
    return found


def _closed(
    r: FloatArray, z: FloatArray, edges: Sequence[_Edge], near: float
) -> tuple[FloatArray, FloatArray]:
    """Add lines until every line that crosses a slanted edge meets one of the other kind there."""
    r, z = _merged(r, near), _merged(z, near)
    while True:
        count = len(r) + len(z)
        for e in edges:
            cross = z[(z > e.z0 + near) & (z < e.z1 - near)]
            r = _merged(np.concatenate([r, e.r_of(cross)]), near)
            low, high = sorted((e.r0, e.r1))
            cross = r[(r > low + near) & (r < high - near)]
            z = _merged(np.concatenate([z, e.z_of(cross)]), near)
        if len(r) + len(z) == count:
            return r, z
        if count > _MOST_LINES:
            message = (
                f"the slanted edges ask for more than {_MOST_LINES} grid lines: let their corners "
                "share radii or places on the axis, or make them straight"
            )
            raise ValueError(message)


def _wanted(
    section: Section, fine: float
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Return lines with the size of elements that they want, in r and z [m]."""
    m = section.motion
    if m is None:
        return [], []
    slide = (m.still_radius - m.radius) / max(1.0, round(_ACROSS_SLIDE * fine))
    r = [(m.radius, slide), (m.still_radius, slide)]
    below = (m.low - m.still_low) / (_ACROSS_GAP * fine)
    above = (m.still_high - m.high) / (_ACROSS_GAP * fine)
    z = [(m.low, below), (m.still_low, below), (m.high, above), (m.still_high, above)]
    return r, z


def _divided(
    base: FloatArray,
    wanted: Sequence[tuple[float, float]],
    sizes_and_growth: tuple[float, float, float],
    counts: Sequence[int],
    kept: Sequence[tuple[float, float]] = (),
) -> FloatArray:
    """Return lines between base lines: as many as counted, else as near as is wanted there."""
    widest, corner, growth = sizes_and_growth
    lines = [base[:1]]
    small = dict.fromkeys(base.tolist(), corner)
    for line, size in wanted:
        nearest = float(base[np.abs(base - line).argmin()])
        small[nearest] = min(small[nearest], size)
    places, sizes = np.array(list(small)), np.array(list(small.values()))
    for (a, b), known in zip(pairwise(base.tolist()), counts, strict=True):
        if any(low < 0.5 * (a + b) < high for low, high in kept):
            lines.append(np.array([b]))
            continue
        p = np.linspace(a, b, 201)
        size = np.minimum((sizes + growth * np.abs(p[:, None] - places)).min(axis=1), 4 * widest)
        density = np.concatenate([[0.0], np.cumsum(0.5 * (1 / size[1:] + 1 / size[:-1]))])
        density *= (b - a) / 200.0
        own = max(1, int(np.ceil(density[-1] - 0.05)))
        count = max(known, own // 2) if known else own  # stretched by no more than twice
        steps = np.linspace(0.0, density[-1], count + 1)[1:]
        lines.append(np.interp(steps, density, p))
        lines[-1][-1] = b
    return np.concatenate(lines)


def _cut(
    section: Section, r: FloatArray, z: FloatArray, edges: Sequence[_Edge], near: float
) -> Grid:
    """Cut every cell into two triangles and find their regions."""
    n_r, n_z = len(r), len(z)
    points = np.array([np.repeat(r, n_z), np.tile(z, n_r)])
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n_r - 1), np.arange(n_z - 1), indexing="ij"))
    rising = z[j] + z[j + 1] > z[0] + z[-1]
    for e in edges:
        at_z = np.array([z[j], z[j + 1]])
        within = (at_z[0] > e.z0 - near) & (at_z[1] < e.z1 + near)
        at_r = e.r_of(at_z)
        up = within & (np.abs(at_r[0] - r[i]) < near) & (np.abs(at_r[1] - r[i + 1]) < near)
        down = within & (np.abs(at_r[0] - r[i + 1]) < near) & (np.abs(at_r[1] - r[i]) < near)
        rising = (rising | up) & ~down
    a, b = i * n_z + j, (i + 1) * n_z + j
    c, d = b + 1, a + 1  # corners of the cell: a (r, z), b (r+, z), c (r+, z+), d (r, z+)
    first = np.where(rising, [a, b, c], [a, b, d])
    second = np.where(rising, [a, c, d], [b, c, d])
    triangles = np.sort(np.concatenate([first, second], axis=1), axis=0)  # as skfem numbers them
    centre = points[:, triangles].mean(axis=1)
    region = np.full(triangles.shape[1], -1)
    for k, piece in enumerate(section.regions):
        region[inside(piece.outline, centre[0], centre[1])] = k
    return Grid(points, triangles, region, r, z)
