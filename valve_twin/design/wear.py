# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Worn dimensions of a double-stroke solenoid, and how each changes its coenergy.

A dimension is changed in the section, the fields are computed again, and the difference of the
coenergies over the change is its signature: the secant to a size that is to be found, since wear
bends (a gap that is half as wide again takes less than half as much again). Where a corner moves,
the secant begins at a small change, so that both meshes have lines at the corners of either side
and most of their error cancels.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.designed import Wear
from valve_twin.design.chain import reaching
from valve_twin.design.geometry.section import Section
from valve_twin.design.map import MapGrid, compute_map

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.geometry.section import Region

GRID = MapGrid(currents=5, positions=5, fine=0.6)
"""Where the fields of a signature are computed, assumed."""

SIZES: Mapping[str, float] = {"gap": 0.12, "rim": 0.3, "turns": 0.04, "steel": 0.4}
"""How much each dimension is changed for its signature [1], assumed."""

_MOVED = ("gap", "rim")  # corners of the section move: taken from a small change
_LEAST = 0.1  # which, of the size [1], assumed
_ROUND = 12  # decimals of a metre to which corners are the same


def worn(design: DoubleStroke, name: str, size: float) -> Section:
    """Return the section of a solenoid with a worn dimension on side A.

    Parameters
    ----------
    design : DoubleStroke
        As new.
    name : str
        gap: pole A stands away by this share of the working gap; rim: its tip has lost this share
        of the rim; turns: this share of coil A is shorted (not the current in the shorted ones);
        steel: all field strengths of its curve are higher by this share.
    size : float
        How much [1].

    Raises
    ------
    ValueError
        If the dimension is not known or the section is none with it.
    """
    section = design.section()
    regions, motion = section.regions, section.motion
    materials = {"steel": section.materials["steel"]}
    if name == "gap" and motion is not None:
        far = size * design.gap
        moves = {design.face: design.face + far, design.rim_tip: design.rim_tip + far}
        regions = _moved(regions, moves)
        motion = replace(motion, still_high=design.face + far)
    elif name == "rim":
        lost = size * (design.face - design.rim_tip)
        regions = _moved(regions, {design.rim_tip: design.rim_tip + lost})
    elif name == "turns":
        regions = tuple(replace(r, turns=r.turns * (1.0 - size)) if r.name == "coil_a" else r
                        for r in regions)  # fmt: skip
    elif name == "steel":
        steel = design.steel
        materials["steel"] = replace(
            steel,
            knee=steel.knee * (1.0 + size),
            approach=steel.approach * (1.0 + size),
            table_h=tuple(h * (1.0 + size) for h in steel.table_h),
        )
    else:
        message = f"dimension '{name}': must be one of {', '.join(SIZES)}"
        raise ValueError(message)
    box = section.radius, section.low, section.high
    return Section(f"{section.name}, {name} {size:+g}", regions, materials, motion, *box)


def compute_wear(
    design: DoubleStroke, grid: MapGrid = GRID, advance: Callable[[], None] = lambda: None
) -> tuple[Wear, ...]:
    """Return the signatures of all dimensions, of both sides.

    Parameters
    ----------
    design : DoubleStroke
        As new; side B is the mirror image of side A.
    grid : MapGrid, optional
        Where the fields are computed.
    advance : callable
        Called once a field.

    Raises
    ------
    ValueError
        If a section or a map of it is none.
    """
    grid = reaching(grid, design)
    new = compute_map(design.section(), grid, advance)
    found: list[Wear] = []
    for name in SIZES:
        found += both_sides(name, signature(design, name, new, grid, advance))
    return tuple(found)


def signature(
    design: DoubleStroke,
    name: str,
    new: CoenergyMap,
    grid: MapGrid = GRID,
    advance: Callable[[], None] = lambda: None,
) -> CoenergyMap:
    """Return how a dimension of side A changes the coenergy, for a size of 1.

    Parameters
    ----------
    design : DoubleStroke
        As new.
    name : str
        One of `SIZES`, which says up to which size the secant is taken.
    new : CoenergyMap
        Of the design, on `grid`.
    grid : MapGrid, optional
        Where the fields are computed.
    advance : callable
        Called once a field.

    Raises
    ------
    ValueError
        If the section or a map of it is none.
    """
    size, less, part = SIZES[name], new, 1.0
    more = compute_map(worn(design, name, size), grid, advance)
    if name in _MOVED:
        less = compute_map(worn(design, name, _LEAST * size), grid, advance)
        part -= _LEAST
    return replace(more, coefficients=(more.coefficients - less.coefficients) / (part * size))


def both_sides(name: str, change: CoenergyMap) -> list[Wear]:
    """Return the change on side A and, but for the steel of both, its mirror image on side B."""
    if name == "steel":
        return [Wear(name, change)]
    return [Wear(f"{name}_a", change), Wear(f"{name}_b", mirrored(change))]


def mirrored(change: CoenergyMap) -> CoenergyMap:
    """Return the same change on the side of the other coil: W(i_A, i_B, x) = W(i_B, i_A, -x)."""
    turned = np.ascontiguousarray(change.coefficients.transpose(1, 0, 2)[:, :, ::-1])
    return replace(change, coefficients=turned)


def _moved(regions: tuple[Region, ...], moves: Mapping[float, float]) -> tuple[Region, ...]:
    """Return the regions with corners of pole A at other places on the axis."""
    to = {round(z, _ROUND): there for z, there in moves.items()}
    return tuple(
        replace(r, outline=tuple((radius, to.get(round(z, _ROUND), z)) for radius, z in r.outline))
        if r.name == "pole_a"
        else r
        for r in regions
    )
