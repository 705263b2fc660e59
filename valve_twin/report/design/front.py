# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a search: what was tried, the front, the reference and the chosen design."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.report.svg import Panel, drawing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray

_WIDTH, _HEIGHT = 470.0, 350.0
_BEYOND = 1.6  # of the reference: what lies further away is not shown [1]
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; }
.tried { stroke: #c3c9d0; stroke-width: 5; stroke-linecap: round; }
.front { stroke: #0072b2; stroke-width: 7; stroke-linecap: round; }
.reference { stroke: #c2500a; stroke-width: 2; }
.chosen { stroke: #1b2026; stroke-width: 14; stroke-linecap: round; }
.t { fill: #8a929b; } .f { fill: #0072b2; } .r { fill: #c2500a; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def draw_front(
    axes: Sequence[tuple[str, float, str]], points: Mapping[str, Sequence[Mapping[str, float]]]
) -> str:
    """Return the picture as an SVG document: the first figure against each of the others.

    Parameters
    ----------
    axes : sequence of tuple
        Name of a figure, its factor and its label.
    points : mapping
        Figures of the designs "tried", "front", "reference" and "chosen".
    """
    parts: list[str] = [_STYLE]
    (x_name, x_factor, x_label), *others = axes
    own = points["reference"][0]
    for k, (name, factor, label) in enumerate(others):
        shown = [p for p in points["tried"] if _near(p, own, (x_name, name))]
        every = [*shown, *points["front"], *points["reference"]]
        panel = Panel(
            _WIDTH * k + 60.0, 46.0, _WIDTH - 92.0, _HEIGHT - 98.0,
            _ends([x_factor * p[x_name] for p in every]), _ends([factor * p[name] for p in every]),
        )  # fmt: skip
        panel.axes(x_label=x_label, y_label=label, x_ticks=5, y_ticks=5)
        for kind, style in (("tried", "tried"), ("chosen", "chosen"), ("front", "front")):
            at = shown if kind == "tried" else points[kind]
            panel.dots(_of(at, x_name, x_factor), _of(at, name, factor), style)
        at = points["reference"]
        panel.crosses(_of(at, x_name, x_factor), _of(at, name, factor), "reference", 5.0)
        parts += panel.parts
    parts.append(
        '<text x="8" y="16"><tspan class="r">cross: reference</tspan>, '
        '<tspan class="f">front, the chosen design ringed</tspan>, '
        '<tspan class="t">tried</tspan></text>'
    )
    svg = str(
        drawing(_WIDTH * len(others), _HEIGHT, parts, "front of a search for better designs")
    )
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _near(point: Mapping[str, float], own: Mapping[str, float], names: tuple[str, str]) -> bool:
    return all(point[name] <= _BEYOND * own[name] for name in names)


def _of(points: Sequence[Mapping[str, float]], name: str, factor: float) -> FloatArray:
    return factor * np.array([p[name] for p in points], dtype=np.float64)


def _ends(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    margin = max(0.08 * (high - low), 1e-3 * abs(high), 1e-12)
    return low - margin, high + margin
