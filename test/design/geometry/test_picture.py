# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a half section."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from valve_twin.design.geometry import DoubleStroke, draw_section, read_design

SVG = "{http://www.w3.org/2000/svg}"


def styles(section) -> list[str]:
    picture = ET.fromstring(draw_section(section))
    return [p.attrib["class"] for p in picture.iter(f"{SVG}polygon")]


def test_every_region_is_drawn_in_the_style_of_its_material(root):
    assert styles(DoubleStroke().section()).count("coil") == 2
    found = styles(read_design(root / "samples" / "design" / "pot_magnet.yaml"))
    assert sorted(found) == ["coil", "magnet", "steel", "steel", "steel", "steel"]
