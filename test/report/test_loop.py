# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a designed valve's steps."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from valve_twin.core.valves.designed import Loop
from valve_twin.report.loop import draw_loops

TIME = 1e-4 * np.arange(801.0)
ROWS = (
    ("current [A]", {"A": np.exp(-TIME), "B": -np.exp(-TIME)}),
    ("position [mm]", {"x": 1.0 - np.exp(-300 * TIME), "wanted": np.ones(801)}),
)
LOOP = Loop(TIME, ROWS, 2e-3, 0.0, 5e-3, 5e-3, 0.0, 1.0)


def test_every_step_has_a_column_and_every_signal_its_line():
    tree = ElementTree.fromstring(draw_loops({0.1: LOOP, 1.0: LOOP}))
    texts = ["".join(t.itertext()) for t in tree.iter("{http://www.w3.org/2000/svg}text")]
    assert texts.count("10 %") == texts.count("100 %") == 1
    assert texts.count("current [A]") == texts.count("position [mm]") == 2
    styles = [p.get("class") for p in tree.iter("{http://www.w3.org/2000/svg}path")]
    assert (styles.count("a"), styles.count("b"), styles.count("c")) == (4, 2, 2)
