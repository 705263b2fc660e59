# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Outlines to and from DXF drawings: x is the radius, y the axis, a layer a region."""

from __future__ import annotations

from io import StringIO
from itertools import chain
from math import isclose, isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from valve_twin.design.geometry.section import Outline, Section

    _Piece = tuple[str, str, bool, list[tuple[float, float, float]]]

_MM = 1e-3
_UNITS = {0: _MM, 1: 25.4e-3, 2: 0.3048, 4: _MM, 5: 1e-2, 6: 1.0}
"""$INSUNITS of a drawing in metres; one without a unit is taken as millimetres."""
_LARGEST = 10 << 20
"""Of a drawing [B]: ezdxf takes some 15 times as much memory; 5000 outlines of 100 corners fit."""

_TURNED = "turned LWPOLYLINE"
_CLAIM, _X, _Y = 90, 10, 20  # group codes: how many corners there are, and of each


def write_dxf(
    section: Section, path: Path, write: Callable[[Path, bytes], object] = Path.write_bytes
) -> None:
    """Write the outlines of a section as closed polylines in millimetres.

    Parameters
    ----------
    section : Section
        What is drawn.
    path : Path
        File to write.
    write : callable
        Puts bytes into a file.
    """
    from ezdxf.filemanagement import new

    drawing = new("R2010", units=4)
    space = drawing.modelspace()
    for region in section.regions:
        drawing.layers.add(region.name)
        corners = [(r / _MM, z / _MM) for r, z in region.outline]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": region.name})
    text = StringIO()
    drawing.write(text)
    write(path, drawing.encode(text.getvalue()))


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
        lost = _lost_corners(path)
        units, pieces = _pieces(path)
    except Exception as err:  # whatever a broken drawing makes ezdxf raise
        why = " ".join(str(err).split()) or type(err).__name__
        message = f"{path}: is no DXF drawing that can be read ({why})"
        raise ValueError(message) from err
    if lost:
        message = f"{path}: {lost}: is damaged, save it anew"
        raise ValueError(message)
    unit = _UNITS.get(units)
    if unit is None:
        message = f"{path}: $INSUNITS = {units}: must be inch, foot, mm, cm or m"
        raise ValueError(message)
    found: dict[str, list[Outline]] = {}
    for layer, kind, closed, corners in pieces:
        if kind != "LWPOLYLINE":
            message = f"{path}: a {kind} on layer '{layer}': only LWPOLYLINEs are read"
            if kind == _TURNED:
                message = (
                    f"{path}: layer '{layer}' holds a polyline in another plane: draw it in x, y"
                )
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
        kind, closed, corners = item.dxftype(), False, []
        if isinstance(item, LWPolyline):
            closed = item.closed
            kind = item.dxftype() if _is_upright(item.dxf.extrusion) else _TURNED
            corners = [(float(x), float(y), float(b)) for x, y, b in item.get_points("xyb")]
        pieces.append((str(item.dxf.layer), kind, closed, corners))
    return int(drawing.units), pieces


def _is_upright(normal: Iterable[float]) -> bool:
    """Return whether a polyline lies in x, y; rounded by who wrote it."""
    return all(isclose(a, b, abs_tol=1e-9) for a, b in zip(normal, (0.0, 0.0, 1.0), strict=True))


def _lost_corners(path: Path) -> str:
    """Return which polyline has other corners than it claims, which ezdxf overlooks."""
    from ezdxf.lldxf.tagger import ascii_tags_loader, binary_tags_loader
    from ezdxf.lldxf.validator import is_binary_dxf_file

    if is_binary_dxf_file(str(path)):
        return _lost_of(binary_tags_loader(path.read_bytes(), errors="surrogateescape"))
    with path.open(encoding="utf-8", errors="surrogateescape") as file:
        return _lost_of(ascii_tags_loader(file))


def _lost_of(tags: Iterable[Any]) -> str:
    from ezdxf.lldxf.types import DXFTag

    kind, found = "", dict[int, list[str]]()
    for tag in chain(tags, [DXFTag(0, "EOF")]):
        code, value = int(tag.code), str(tag.value)
        if code:
            found.setdefault(code, []).append(value)
            continue
        if kind == "LWPOLYLINE":
            claimed = str(found.get(_CLAIM, ["none"])[0]).strip()
            count = len(found.get(_X, ()))
            as_many = claimed.isdecimal() and int(claimed) == count
            if not as_many or len(found.get(_Y, ())) != count:
                return f"a polyline of {count} corners that claims {claimed}"
        kind = value.strip()
        found = {}
    return ""


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
