# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a field computation is in doubt about, as changes of the coenergy by a standard deviation.

Mesh: the same fields once more on twice the elements along a line; their whole difference counts
as a standard deviation. Steel and gaps: tolerances, every size in them alike, times the change
that a worn dimension makes.
"""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import TYPE_CHECKING

from valve_twin.core.valves.designed import Wear
from valve_twin.design.map import MapGrid, compute_map
from valve_twin.design.wear import both_sides, signature

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.design.geometry import DoubleStroke

GRID = MapGrid(currents=5, positions=5)
"""Where the fields are computed, on the mesh of the usual map."""

TOLERANCES: Mapping[str, float] = {"gap": 0.02, "steel": 0.1}
"""Half widths: working gap of either side; field strengths of the steel's curve; assumed [1]."""

_FINER = 2.0


def compute_doubts(
    design: DoubleStroke,
    curves: CoenergyMap,
    grid: MapGrid = GRID,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Wear, ...]:
    """Return the changes of a design's map by each doubt, on the nodes of the map.

    Parameters
    ----------
    design : DoubleStroke
        Side B is the mirror image of side A.
    curves : CoenergyMap
        Its map.
    grid : MapGrid, optional
        Where the fields are computed, default `GRID`.
    advance : callable
        Called once a field.

    Raises
    ------
    ValueError
        If a section or a map of it is none.
    """
    end = max(grid.largest_current, float(curves.currents[-1]))
    grid = replace(grid, largest_current=end)
    own = compute_map(design.section(), grid, advance)
    finer = compute_map(design.section(), replace(grid, fine=_FINER * grid.fine), advance)
    found = [Wear("mesh", replace(own, coefficients=finer.coefficients - own.coefficients))]
    for name, half in TOLERANCES.items():
        of = signature(design, name, own, grid, advance)
        found += both_sides(name, replace(of, coefficients=half / sqrt(3.0) * of.coefficients))
    return tuple(
        replace(of, change=of.change.on_nodes(curves.currents, curves.positions)) for of in found
    )
