# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The field of a solution as a picture: flux density in the steel, flux lines everywhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.design.drawing import Sheet
from valve_twin.design.field.shapes import flux_density
from valve_twin.design.geometry.section import area
from valve_twin.design.materials import Linear

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.design.field.solve import Field

_COLOURS = ("#f3f6f9", "#dcebf5", "#b9dbee", "#8ec6e2", "#63aed2", "#7fbf9b", "#c9d36a", "#f2c14e",
            "#ee8f3c", "#d9512c", "#a81f24")  # fmt: skip
_STEP = 0.2  # of flux density from colour to colour [T]
_LINES = 24


def draw_field(field: Field) -> str:
    """Return the half section with its field as an SVG document."""
    model = field.model
    points = model.moved(field.position)
    pieces = [r for r in model.section.regions if area(r.outline) > 0.0]
    corners = [corner for region in pieces for corner in region.outline]
    low, high = min(z for _, z in corners), max(z for _, z in corners)
    shown = 1.04 * max(r for r, _ in corners)
    sheet = Sheet(shown, 1.06 * low, 1.06 * high)
    triangles = model.elements.triangles
    magnetic = [
        k
        for k, region in enumerate(model.section.regions)
        if not isinstance(model.section.materials[region.material], Linear)
    ]
    of = np.flatnonzero(np.isin(model.grid.region, magnetic))
    b_r, b_z = flux_density(model, points, field.potential, of)
    level = np.hypot(b_r.mean(axis=1), b_z.mean(axis=1)) / _STEP
    for k, colour in enumerate(_COLOURS):
        within = of[(level >= k) & ((level < k + 1) | (k == len(_COLOURS) - 1))]
        if len(within):
            sheet.polygons(points[:, triangles[:, within]], colour)
    for k, region in enumerate(model.section.regions):
        here = triangles[:, model.grid.region == k]
        by = field.position if model.shift[here].min(initial=1.0) > 0.0 else 0.0
        sheet.polygon([(r, z + by) for r, z in region.outline], "edge")
    sheet.lines(_flux_lines(field, points, shown), "line")
    sheet.ruler(5e-3 if high - low < 0.08 else 2e-2)
    currents = ", ".join(
        f"i_{name} = {i:g} A" for name, i in zip(model.section.coils, field.currents, strict=True)
    )
    sheet.note(
        f"{currents}, x = {1e3 * field.position:g} mm: {field.force:.4g} N; steel from white, "
        f"0 T, to red, {_STEP * (len(_COLOURS) - 1):g} T and more; z in mm"
    )
    return sheet.finished(f"field of {model.section.name}")


def _flux_lines(
    field: Field, points: FloatArray, shown: float
) -> list[tuple[float, float, float, float]]:
    """Return pieces of lines of equal flux r A, at even steps of flux."""
    e = field.model.elements
    corner = points[:, e.triangles]
    middle = 0.5 * (corner[:, [0, 1, 0]] + corner[:, [1, 2, 2]])
    nodes = np.concatenate([corner, middle], axis=1)
    flux = nodes[0] * field.potential[e.dofs]
    levels = np.linspace(flux.min(), flux.max(), _LINES + 2)[1:-1]
    found: list[tuple[float, float, float, float]] = []
    for part in ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)):
        for level in levels:
            found += _crossings(nodes[:, list(part)], flux[list(part)], float(level), shown)
    return found


def _crossings(
    corner: FloatArray, value: FloatArray, level: float, shown: float
) -> list[tuple[float, float, float, float]]:
    """Return where a level crosses triangles (2, 3, S) with values (3, S) at their corners."""
    above = value > level
    crossed: IntArray = np.flatnonzero((above.sum(axis=0) == 1) | (above.sum(axis=0) == 2))
    if not len(crossed):
        return []
    above, value, corner = above[:, crossed], value[:, crossed], corner[:, :, crossed]
    alone = np.where(above.sum(axis=0) == 1, above.argmax(axis=0), (~above).argmax(axis=0))
    at = np.arange(len(crossed))
    ends = []
    for turn in (1, 2):
        other = (alone + turn) % 3
        share = (level - value[alone, at]) / (value[other, at] - value[alone, at])
        ends.append(corner[:, alone, at] + share * (corner[:, other, at] - corner[:, alone, at]))
    rows = np.concatenate(ends).T
    rows = rows[(rows[:, [0, 2]].max(axis=1) < shown)]
    return [(float(a), float(b), float(c), float(d)) for a, b, c, d in rows]
