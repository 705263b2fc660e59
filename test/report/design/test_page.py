# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The page of a search."""

from __future__ import annotations

import base64
import re

from valve_twin.report.design.page import DesignPage, Side, picture, render_design
from valve_twin.report.tables import Table


def test_the_page_holds_its_pictures_tables_and_links_and_nothing_from_outside():
    sides = tuple(
        Side(name, *(f"<svg>{name} {k}</svg>" for k in ("section", "field", "curves", "steps")))
        for name in ("Reference", "Chosen design")
    )
    page = DesignPage(
        title="A <valve>",
        summary="rise -10 %",
        front="<svg>front</svg>",
        figures=Table(["design", "rise"], [["reference", "3.1"]]),
        numbers=Table(["number", "unit"], [["turns", "1"]]),
        sides=sides,
        effects=(("Sobol' indices", "", Table(["figure"], [["rise_s"]]), "why not"),),
        files=(("chosen.dxf", "its half section"),),
        notes=("all assumed",),
    )
    html = render_design(page)
    held = [base64.b64decode(t).decode() for t in re.findall(r"svg\+xml;base64,([^\"]+)", html)]
    assert sorted(held) == sorted(
        ["<svg>front</svg>", *(s for side in sides for s in (side.section, side.field, side.curves,
                                                           side.steps))]
    )  # fmt: skip
    assert "A &lt;valve&gt;" in html
    assert '<a href="chosen.dxf">' in html
    for words in ("3.1", "turns", "rise_s", "why not", "all assumed"):
        assert words in html
    assert "http" not in html.replace("http://www.w3.org", "")


def test_the_words_of_a_picture_are_escaped():
    assert 'alt="a &#34;b"' in picture("<svg/>", 'a "b')
