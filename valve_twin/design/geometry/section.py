# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Half section of an axisymmetric solenoid: regions with materials and coils, a moving part.

What no region covers is air; on the axis and on the box around, the vector potential is 0. The
armature moves along the axis. The air between it and what stands still is stretched instead of
meshed anew: a shift x moves a point by x g with g = 1 on the armature, falling linearly to 0
across the gaps at its ends (in z) and around it (in r).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.design.materials import AIR, Linear, Magnet, Material

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import BoolArray, FloatArray

Outline = tuple[tuple[float, float], ...]

_MOST_CORNERS = 2000
"""Of all outlines, assumed: each is a line of the grid in r and in z [1]."""


@dataclass(frozen=True, slots=True)
class Region:
    """One piece of a section.

    Attributes
    ----------
    name : str
        Of the piece.
    material : str
        Name in the section's materials.
    outline : tuple of (r, z)
        Corners of its polygon [m].
    coil : str
        Name of the coil of which it is a winding space, empty = none.
    turns : float
        Turns in it; negative = wound the other way [1].
    """

    name: str
    material: str
    outline: Outline
    coil: str = ""
    turns: float = 0.0


@dataclass(frozen=True, slots=True)
class Motion:
    """The box of the armature and how far the air around it is stretched.

    Attributes
    ----------
    radius, still_radius : float
        Outer radius of the armature, and where the part that stands still begins [m].
    low, high : float
        Ends of the armature on the axis at x = 0 [m].
    still_low, still_high : float
        What stands still beyond its ends [m].
    stroke : float
        Largest shift to either side that is meant [m].
    """

    radius: float
    still_radius: float
    low: float
    high: float
    still_low: float
    still_high: float
    stroke: float

    def __post_init__(self) -> None:
        """Refuse a box that is none."""
        if not 0.0 < self.radius < self.still_radius:
            message = (
                f"motion.still_radius = {self.still_radius:g}: must be above radius = "
                f"{self.radius:g} > 0 [m]"
            )
            raise ValueError(message)
        if not self.still_low < self.low < self.high < self.still_high:
            message = (
                f"motion: still_low, low, high, still_high = {self.still_low:g}, {self.low:g}, "
                f"{self.high:g}, {self.still_high:g}: must rise [m]"
            )
            raise ValueError(message)
        least = min(self.low - self.still_low, self.still_high - self.high)
        if not 0.0 <= self.stroke < least:
            message = f"motion.stroke = {self.stroke:g}: must be from 0, below {least:g} [m]"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class Section:
    """What the field is computed of.

    Attributes
    ----------
    name : str
        Of the solenoid.
    regions : tuple of Region
        Pieces; no two overlap.
    materials : mapping
        Material by name; air is always known.
    motion : Motion or None
        Of the armature; None where nothing moves.
    radius, low, high : float
        Box around, where the field ends [m].
    like : Section or None
        The same parts with other dimensions, whose mesh is stretched to this section: what the
        fields of both differ by is then no matter of the mesh.
    """

    name: str
    regions: tuple[Region, ...]
    materials: Mapping[str, Material]
    motion: Motion | None
    radius: float
    low: float
    high: float
    coils: tuple[str, ...] = field(init=False)
    like: Section | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Refuse regions outside the box, of unknown material, or without an area."""
        object.__setattr__(self, "materials", {AIR: Linear(), **self.materials})
        names = dict.fromkeys(r.coil for r in self.regions if r.coil)
        object.__setattr__(self, "coils", tuple(sorted(names)))
        if not (0.0 < self.radius < math.inf and -math.inf < self.low < self.high < math.inf):
            message = (
                f"box: radius = {self.radius:g}, low = {self.low:g}, high = {self.high:g}: radius "
                "must be above 0, high above low [m]"
            )
            raise ValueError(message)
        corners = sum(len(region.outline) for region in self.regions)
        if corners > _MOST_CORNERS:
            message = (
                f"{self.name}: its outlines have {corners} corners, a field is computed of at "
                f"most {_MOST_CORNERS}: draw arcs with fewer edges"
            )
            raise ValueError(message)
        for region in self.regions:
            self._check(region)
        self._check_overlaps()

    def _check(self, region: Region) -> None:
        if region.material not in self.materials:
            known = ", ".join(sorted(self.materials))
            message = (
                f"{region.name}: material '{region.material}' is not known; there are {known}"
            )
            raise ValueError(message)
        for r, z in region.outline:
            if not (0.0 <= r <= self.radius and self.low <= z <= self.high):
                message = (
                    f"{region.name}: corner r = {r:g}, z = {z:g} lies outside the box, r from 0 "
                    f"to {self.radius:g}, z from {self.low:g} to {self.high:g} [m]"
                )
                raise ValueError(message)
        crossed = crossing(region.outline)
        if crossed:
            one, other = (
                f"r = {a[0]:.6g}, z = {a[1]:.6g} to r = {b[0]:.6g}, z = {b[1]:.6g}"
                for a, b in crossed
            )
            message = (
                f"{region.name}: the edge from {one} crosses that from {other} [m]: an outline "
                "goes around its area once"
            )
            raise ValueError(message)
        if len(region.outline) < 3 or not area(region.outline) > 0.0:
            message = f"{region.name}: outline of {len(region.outline)} corners has no area"
            raise ValueError(message)
        if region.coil and region.turns == 0.0:
            message = f"{region.name}: turns = 0 of coil {region.coil}: must not be 0"
            raise ValueError(message)
        of = self.materials[region.material]
        if region.coil and not (isinstance(of, Linear) and of.conductivity == 0.0):
            message = (
                f"{region.name}: a coil is wound in a linear material without conductivity, not "
                f"{region.material}"
            )
            raise ValueError(message)

    def _check_overlaps(self) -> None:
        """Refuse two regions that share a place; tried in every cell between corners."""
        outlines = [region.outline for region in self.regions]
        corners = np.array([corner for outline in outlines for corner in outline])
        start = np.concatenate([np.array(outline) for outline in outlines])
        end = np.concatenate([np.roll(np.array(outline), -1, axis=0) for outline in outlines])
        owner = np.repeat(np.arange(len(outlines)), [len(outline) for outline in outlines])
        (r0, z0), (r1, z1) = start.T, end.T
        r = _between(corners[:, 0], (0.31, 0.72))  # others than in z, lest a diagonal meets both
        heights = _between(corners[:, 1], (0.37, 0.66))
        inwards = np.array([1e-9, -1e-9]) * np.ptp(r)
        for z in heights:
            on = np.flatnonzero((z0 > z) != (z1 > z))
            at = r0[on] + (z - z0[on]) * (r1[on] - r0[on]) / (z1[on] - z0[on])
            order = np.lexsort((at, owner[on]))  # each region's edges by pairs: in and out again
            bounds = np.searchsorted(r, at[order].reshape(-1, 2) + inwards)
            of = owner[on][order][::2]
            covers = np.zeros(len(r) + 1, dtype=np.int64)
            np.add.at(covers, bounds[:, 0], 1)
            np.subtract.at(covers, bounds[:, 1], 1)
            shared = np.flatnonzero(np.cumsum(covers) > 1)
            if len(shared):
                within = (bounds[:, 0] <= shared[0]) & (shared[0] < bounds[:, 1])
                one, other = (self.regions[k] for k in np.sort(of[within])[:2])
                message = (
                    f"{one.name} and {other.name} overlap at r = {r[shared[0]]:.6g}, "
                    f"z = {z:.6g} [m]: move their outlines apart"
                )
                raise ValueError(message)

    @property
    def excited(self) -> bool:
        """Whether a magnet makes a field without currents."""
        used = {r.material for r in self.regions}
        return any(isinstance(self.materials[m], Magnet) for m in used)


def area(outline: Outline) -> float:
    """Return the area of a polygon [m^2]."""
    twice = 0.0
    for (r0, z0), (r1, z1) in zip(outline, (*outline[1:], outline[0]), strict=True):
        twice += r0 * z1 - r1 * z0
    return 0.5 * abs(twice)


def crossing(outline: Outline) -> tuple[Outline, ...]:
    """Return the ends of the first two edges of a polygon that cross; () where none do.

    Edges that touch or lie on each other, as of a slit to a hole, do not cross.

    Parameters
    ----------
    outline : tuple of (r, z)
        Corners [m].
    """
    if len(outline) < 4:
        return ()
    start = np.array(outline)
    end = np.roll(start, -1, axis=0)
    least = 1e-12 * float(np.ptp(start, axis=0).max()) ** 2

    def side(a: FloatArray, b: FloatArray, of: FloatArray) -> FloatArray:
        """Return on which side of the lines a-b points lie: 1, -1, or 0 = on it."""
        turn = (b - a)[..., 0] * (of - a)[..., 1] - (b - a)[..., 1] * (of - a)[..., 0]
        found: FloatArray = np.sign(np.where(np.abs(turn) > least, turn, 0.0))
        return found

    for k in range(len(start) - 2):
        a, b, c, d = start[k], end[k], start[k + 2 :], end[k + 2 :]
        apart = (side(a, b, c) * side(a, b, d) < 0.0) & (side(c, d, a) * side(c, d, b) < 0.0)
        if apart.any():
            other = k + 2 + int(np.argmax(apart))
            pairs = [(outline[n], outline[(n + 1) % len(outline)]) for n in (k, other)]
            return tuple(pairs)
    return ()


def rectangle(r0: float, r1: float, z0: float, z1: float) -> Outline:
    """Return the corners of a rectangle.

    Parameters
    ----------
    r0, r1 : float
        Inner and outer radius [m].
    z0, z1 : float
        Ends on the axis [m].
    """
    return ((r0, z0), (r1, z0), (r1, z1), (r0, z1))


def mirrored(outline: Outline) -> Outline:
    """Return the corners mirrored at z = 0."""
    return tuple((r, -z) for r, z in reversed(outline))


def inside(outline: Outline, r: FloatArray, z: FloatArray) -> BoolArray:
    """Return which points lie inside a polygon, (N,) bool.

    Parameters
    ----------
    outline : tuple of (r, z)
        Corners [m].
    r, z : (N,) arrays
        Points, none on an edge [m].
    """
    found = np.zeros(len(r), dtype=np.bool_)
    for (r0, z0), (r1, z1) in pairwise((*outline, outline[0])):
        if z0 != z1:
            crosses = (z0 > z) != (z1 > z)
            found ^= crosses & (r < r0 + (z - z0) * (r1 - r0) / (z1 - z0))
    return found


def _between(corners: FloatArray, shares: tuple[float, float]) -> FloatArray:
    """Return two points between each line through corners and the next, rising."""
    lines = np.unique(corners)
    steps = np.diff(lines)
    steps = np.where(steps > 1e-9 * (lines[-1] - lines[0]), steps, np.nan)  # one line, rounded
    points = np.concatenate([lines[:-1] + share * steps for share in shares])
    found: FloatArray = np.sort(points[np.isfinite(points)])
    return found
