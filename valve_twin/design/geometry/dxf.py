# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Outlines to and from DXF drawings: x is the radius, y the axis, a layer a region."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from valve_twin.design.geometry.section import Outline, Section

    _Piece = tuple[str, str, bool, list[tuple[float, float, float]]]

_MM = 1e-3
_UNITS = {0: _MM, 1: 25.4e-3, 2: 0.3048, 4: _MM, 5: 1e-2, 6: 1.0}
"""$INSUNITS of a drawing in metres; one without a unit is taken as millimetres."""
_LARGEST = 10 << 20
"""Of a drawing [B]: ezdxf takes some 15 times as much memory; 5000 outlines of 100 corners fit."""


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
        If it is no drawing or too large for one of outlines, or holds what is no polygon of
        straight edges; names the layer.
    """
    _check_size(path)
    try:
        units, pieces = _pieces(path)
    except Exception as err:  # whatever a broken drawing makes ezdxf raise
        why = " ".join(str(err).split()) or type(err).__name__
        message = f"{path}: is no DXF drawing that can be read ({why})"
        raise ValueError(message) from err
    unit = _UNITS.get(units)
    if unit is None:
        message = f"{path}: $INSUNITS = {units}: must be inch, foot, mm, cm or m"
        raise ValueError(message)
    found: dict[str, list[Outline]] = {}
    for layer, kind, closed, corners in pieces:
        if kind != "LWPOLYLINE":
            message = f"{path}: a {kind} on layer '{layer}': only LWPOLYLINEs are read"
            raise ValueError(message)
        if not isfinite(sum(map(sum, corners))):
            message = f"{path}: layer '{layer}' holds a corner that is no finite number"
            raise ValueError(message)
        if not closed or any(bulge for *_, bulge in corners):
            start = f"({corners[0][0]:g}, {corners[0][1]:g})" if corners else "no corner at all"
            message = (
                f"{path}: layer '{layer}' holds an open or a bent polyline from {start}: close "
                "it, replace arcs by straight edges"
            )
            raise ValueError(message)
        outline = tuple((unit * x, unit * y) for x, y, _ in corners)
        found.setdefault(layer, []).append(outline)
    if not found:
        message = f"{path}: holds no closed LWPOLYLINE"
        raise ValueError(message)
    return found


def _pieces(path: Path) -> tuple[int, list[_Piece]]:
    """Return the unit of a drawing and what it holds: layer, kind, closed, (x, y, bulge)."""
    from ezdxf.entities.lwpolyline import LWPolyline
    from ezdxf.filemanagement import readfile

    drawing = readfile(path)
    pieces: list[_Piece] = []
    for item in drawing.modelspace():
        closed, corners = False, []
        if isinstance(item, LWPolyline):
            closed = item.closed
            corners = [(float(x), float(y), float(b)) for x, y, b in item.get_points("xyb")]
        pieces.append((str(item.dxf.layer), item.dxftype(), closed, corners))
    return int(drawing.units), pieces


def _check_size(path: Path) -> None:
    if path.exists() and not path.is_file():
        message = f"{path}: is no file"
        raise ValueError(message)
    size = path.stat().st_size if path.exists() else 0
    if size > _LARGEST:
        message = (
            f"{path}: has {size / (1 << 20):.0f} MB, read are at most {_LARGEST >> 20}: keep the "
            "outlines alone"
        )
        raise ValueError(message)
