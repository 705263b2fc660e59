# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of sensitivities."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import pytest

from valve_twin.report.design.effects import draw_effects


def test_bars_go_to_either_side_by_their_numbers_and_what_is_unknown_has_none():
    rows = {"gap": [(-2.0, 4.0), (math.nan, 1.0)], "turns <1>": [(1.0, -1.0), (0.5, math.nan)]}
    svg = draw_effects(["rise", "loss"], rows, "%", ("lower", "higher"))
    space = "{http://www.w3.org/2000/svg}"
    root = ElementTree.fromstring(svg)
    bars = [r for r in root.iter(f"{space}rect") if r.get("class")]
    wide = [float(r.attrib["width"]) for r in bars]
    assert len(bars) == 6
    assert wide[0] == pytest.approx(0.5 * wide[1], abs=0.1)
    assert float(bars[0].attrib["x"]) < float(bars[1].attrib["x"])
    assert "turns <1>" in [t.text for t in root.iter(f"{space}text")]
    assert "to ±4 %" in svg
