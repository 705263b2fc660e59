# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a field."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from valve_twin.design.field import draw_field, make_model, solve_field
from valve_twin.design.geometry import DoubleStroke

SVG = "{http://www.w3.org/2000/svg}"


def test_it_shows_steel_lines_and_what_was_computed():
    found = solve_field(make_model(DoubleStroke().section(), 0.4), (3.0, 0.0), 0.5e-3)
    picture = ET.fromstring(draw_field(found))
    words = " ".join(t.text or "" for t in picture.iter(f"{SVG}text"))
    assert "i_A = 3 A, i_B = 0 A, x = 0.5 mm" in words
    assert f"{found.force:.4g} N" in words
    lines = [p.attrib["d"] for p in picture.iter(f"{SVG}path") if p.attrib.get("class") == "line"]
    assert len(re.findall("M", "".join(lines))) > 500
    # the armature is drawn where it stands
    edges = [p.attrib["points"] for p in picture.iter(f"{SVG}polygon")]
    assert len(edges) == 10
