# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a coenergy map."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from valve_twin.core.physics.coenergy import CoenergyMap, spline_coefficients
from valve_twin.report.coenergy import draw_coenergy

SVG = "{http://www.w3.org/2000/svg}"


def test_every_curve_is_named_at_its_end():
    i, x = np.linspace(0.0, 3.0, 4), np.linspace(-1e-3, 1e-3, 4)
    values = np.zeros((8, 8))
    values[0::2, 0::2], values[1::2, 0::2] = 0.01 * i[:, None] ** 2, 0.02 * i[:, None]
    found = CoenergyMap(("A",), i, x, spline_coefficients(values, (i, x)), {"name": "probe"})
    picture = ET.fromstring(draw_coenergy(found))
    words = {t.text for t in picture.iter(f"{SVG}text")}
    assert {"0.5 A", "3 A", "-1 mm", "1 mm", "force [N] over i_A"} <= words
    curves = [p for p in picture.iter(f"{SVG}path") if p.attrib["class"] in {"c0", "c4"}]
    assert len(curves) == 4
