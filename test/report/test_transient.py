# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a transient field."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np

from valve_twin.report.transient import draw_switched, draw_transient

SVG = "{http://www.w3.org/2000/svg}"


def test_three_rows_share_one_axis_of_time():
    t = np.linspace(0.0, 0.02, 21)
    wave = np.sin(300.0 * t)
    picture = ET.fromstring(draw_transient(t, 1.0 + wave, wave, (t[::5], wave[::5]), wave**2))
    words = [text.text for text in picture.iter(f"{SVG}text")]
    assert words.count("time [ms]") == 1
    assert {"current [A]", "force [N]; dashed: static", "eddy currents [W]"} <= set(words)
    lines = [p.attrib["class"] for p in picture.iter(f"{SVG}path")]
    assert (lines.count("a"), lines.count("b")) == (3, 1)


def test_switched_voltages_are_drawn_over_the_field():
    time_s = np.linspace(0.0, 1e-3, 11)
    drawn = draw_switched(
        time_s, (time_s, time_s, np.sin(time_s)), (np.linspace(0.0, 1e-3, 81), np.ones(81)), 2.0
    )
    assert drawn.startswith("<svg ")
    for label in ("V - 2 ohm i [V]; means", "flux linkage [mWb]", "dashed: i_s", "force [N]"):
        assert label in drawn
    assert drawn.count('class="b"') == 3
