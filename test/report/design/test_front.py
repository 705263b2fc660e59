# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a search."""

from __future__ import annotations

from xml.etree import ElementTree

from valve_twin.report.design.front import draw_front

AXES = (("rise", 1e3, "rise [ms]"), ("loss", 1.0, "loss [W]"), ("settling", 1e3, "settling [ms]"))


def point(rise, loss):
    return {"rise": rise, "loss": loss, "settling": 2.0 * rise}


def test_every_design_is_drawn_and_what_is_far_off_left_out():
    front = [point(0.9e-3, 1.0), point(1.0e-3, 0.9)]
    points = {
        "tried": [point(1.1e-3, 1.1), point(9e-3, 1.0)],
        "front": front,
        "reference": [point(1e-3, 1.0)],
        "chosen": front[:1],
    }
    svg = draw_front(AXES, points)
    paths = ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}path")
    drawn = [(p.get("class"), p.get("d") or "") for p in paths]
    moves = {style: [d.count("M") for s, d in drawn if s == style] for style, _ in drawn}
    assert moves["front"] == [2, 2]
    assert moves["tried"] == [1, 1]
    assert moves["chosen"] == moves["reference"] == [1, 1]
