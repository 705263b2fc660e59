# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Outlines to and from DXF drawings: x is the radius, y the axis, a layer a region."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.design.geometry.section import Outline, Section

_MM = 1e-3
_UNITS = {0: _MM, 1: 25.4e-3, 2: 0.3048, 4: _MM, 5: 1e-2, 6: 1.0}
"""$INSUNITS of a drawing in metres; one without a unit is taken as millimetres."""


def write_dxf(section: Section, path: Path) -> None:
    """Write the outlines of a section as closed polylines in millimetres.

    Parameters
    ----------
    section : Section
        What is drawn.
    path : Path
        File to write.
    """
    from ezdxf.filemanagement import new

    drawing = new("R2010", units=4)
    space = drawing.modelspace()
    for region in section.regions:
        drawing.layers.add(region.name)
        corners = [(r / _MM, z / _MM) for r, z in region.outline]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": region.name})
    drawing.saveas(path)


def read_dxf(path: Path) -> dict[str, list[Outline]]:
    """Read the closed polylines of a drawing by layer [m].

    Parameters
    ----------
    path : Path
        File to read.

    Raises
    ------
    ValueError
        If it is no drawing, or holds what is no polygon of straight edges; names the layer.
    """
    from ezdxf.entities.lwpolyline import LWPolyline
    from ezdxf.filemanagement import readfile
    from ezdxf.lldxf.const import DXFError

    try:
        drawing = readfile(path)
    except (DXFError, OSError, UnicodeDecodeError) as err:
        message = f"{path}: is no DXF drawing ({' '.join(str(err).split())})"
        raise ValueError(message) from err
    unit = _UNITS.get(drawing.units)
    if unit is None:
        message = f"{path}: $INSUNITS = {drawing.units}: must be inch, foot, mm, cm or m"
        raise ValueError(message)
    found: dict[str, list[Outline]] = {}
    for item in drawing.modelspace():
        layer = str(item.dxf.layer)
        if not isinstance(item, LWPolyline):
            kind = item.dxftype()
            message = f"{path}: a {kind} on layer '{layer}': only LWPOLYLINEs are read"
            raise ValueError(message)
        corners = [(float(x), float(y), float(bulge)) for x, y, bulge in item.get_points("xyb")]
        if not item.closed or any(bulge for *_, bulge in corners):
            message = (
                f"{path}: layer '{layer}' holds an open or a bent polyline from "
                f"({corners[0][0]:g}, {corners[0][1]:g}): close it, replace arcs by straight edges"
            )
            raise ValueError(message)
        outline = tuple((unit * x, unit * y) for x, y, _ in corners)
        found.setdefault(layer, []).append(outline)
    if not found:
        message = f"{path}: holds no closed LWPOLYLINE"
        raise ValueError(message)
    return found
