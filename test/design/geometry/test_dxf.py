# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Outlines to and from DXF."""

from __future__ import annotations

import os
import random

import pytest
from ezdxf.filemanagement import new

from valve_twin.design.geometry import DoubleStroke, read_dxf, write_dxf


def drawing_of(path, points, *, units=4, **options):
    drawing = new("R2010", units=units)
    drawing.modelspace().add_lwpolyline(points, dxfattribs={"layer": "core"}, **options)
    drawing.saveas(path)
    return path


def test_a_section_comes_back_in_metres(tmp_path):
    section = DoubleStroke().section()
    write_dxf(section, tmp_path / "d.dxf")
    found = read_dxf(tmp_path / "d.dxf")
    assert set(found) == {r.name for r in section.regions}
    assert found["armature"][0][2] == pytest.approx((8e-3, 12e-3))


def test_the_unit_of_the_drawing_is_heeded(tmp_path):
    path = drawing_of(tmp_path / "d.dxf", [(0, 0), (1, 0), (1, 1)], units=1, close=True)
    assert read_dxf(path)["core"][0][1] == pytest.approx((25.4e-3, 0.0))


def test_open_and_bent_outlines_are_refused_with_their_layer(tmp_path):
    points = [(0, 0), (1, 0), (1, 1)]
    with pytest.raises(
        ValueError, match=r"layer 'core' holds an open or a bent polyline from \(0"
    ):
        read_dxf(drawing_of(tmp_path / "open.dxf", points, close=False))
    bent = [(0, 0, 0.3), (1, 0, 0), (1, 1, 0)]
    with pytest.raises(ValueError, match="open or a bent"):
        read_dxf(drawing_of(tmp_path / "bent.dxf", bent, close=True, format="xyb"))


def test_other_entities_units_and_files_are_refused(tmp_path):
    drawing = new("R2010", units=4)
    drawing.modelspace().add_circle((0, 0), 1.0, dxfattribs={"layer": "core"})
    drawing.saveas(tmp_path / "circle.dxf")
    with pytest.raises(ValueError, match="a CIRCLE on layer 'core'"):
        read_dxf(tmp_path / "circle.dxf")
    miles = drawing_of(tmp_path / "mile.dxf", [(0, 0), (1, 0), (1, 1)], units=3, close=True)
    with pytest.raises(ValueError, match=r"INSUNITS = 3: must be"):
        read_dxf(miles)
    (tmp_path / "text.dxf").write_text("no drawing", encoding="utf-8")
    with pytest.raises(ValueError, match="is no DXF drawing"):
        read_dxf(tmp_path / "text.dxf")
    new("R2010").saveas(tmp_path / "empty.dxf")
    with pytest.raises(ValueError, match="holds no closed LWPOLYLINE"):
        read_dxf(tmp_path / "empty.dxf")


def test_what_is_no_file_or_too_large_for_outlines_is_refused_unread(tmp_path):
    (tmp_path / "large.dxf").write_bytes(b"")
    os.truncate(tmp_path / "large.dxf", 11 << 20)
    with pytest.raises(ValueError, match="has 11 MB, read are at most 10: keep the outlines"):
        read_dxf(tmp_path / "large.dxf")
    with pytest.raises(ValueError, match="is no file"):
        read_dxf(tmp_path)
    with pytest.raises(ValueError, match="No such file"):
        read_dxf(tmp_path / "missing.dxf")


def test_a_broken_drawing_gets_one_line_whatever_is_broken(tmp_path):
    path, rng = tmp_path / "d.dxf", random.Random(1)
    write_dxf(DoubleStroke().section(), path)
    lines = path.read_bytes().split(b"\n")
    drawn = next(i for i, line in enumerate(lines) if line.strip() == b"ENTITIES")
    said = []
    for k in range(150):
        broken, at = list(lines), rng.randrange(drawn if k % 2 else 0, len(lines))
        broken[at : at + 1] = rng.choice(([], [b"-1"], [b"1e999"], [b"nan"], [b"\xff\x00"]))
        path.write_bytes(b"\n".join(broken))
        try:
            read_dxf(path)
        except ValueError as err:
            said.append(str(err))
    assert len(said) > 20
    assert [text for text in said if not text.startswith(f"{path}: ") or "\n" in text] == []


def test_a_polyline_that_lost_a_corner_or_lies_in_another_plane_is_refused(tmp_path):
    """Read in silence before: a triangle of a rectangle, and what is drawn mirrored as it is."""
    path = tmp_path / "d.dxf"
    write_dxf(DoubleStroke().section(), path)
    text = path.read_text(encoding="utf-8")
    drawn = text.index("LWPOLYLINE")
    at = text.index(" 10\n", drawn)
    corner = text[at : text.index(" 10\n", at + 1)]
    for changed, words in (
        (corner, "a polyline of 3 corners that claims 4: is damaged"),
        (corner.partition(" 20\n")[0], "a polyline of 3 corners that claims 4: is damaged"),
    ):
        path.write_text(text[:at] + text[at:].replace(changed, "", 1), encoding="utf-8")
        with pytest.raises(ValueError, match=words):
            read_dxf(path)
    turned = "210\n0\n220\n0\n230\n-1\n"
    rounded = turned.replace("-1", "0.9999999999999999")
    same = text[:drawn] + text[drawn:at].replace("\n4\n", "\n04\n", 1) + rounded + text[at:]
    assert "\n04\n" in same
    path.write_text(same, encoding="utf-8")
    assert read_dxf(path)["armature"][0][2] == pytest.approx((8e-3, 12e-3))
    path.write_text(text[:at] + turned + text[at:], encoding="utf-8")
    with pytest.raises(ValueError, match="holds a polyline in another plane: draw it in x, y"):
        read_dxf(path)
