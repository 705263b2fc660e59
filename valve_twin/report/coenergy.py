# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a coenergy map: force over position, flux linkage over current."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.report.svg import Panel, drawing

if TYPE_CHECKING:
    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray

_WIDTH, _HEIGHT, _POINTS, _CURVES = 480.0, 360.0, 121, 6
_COLOURS = ("#0072b2", "#009e73", "#c2500a", "#a85c90", "#545d68", "#b8860b")
_STYLE = (
    """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; }
"""
    + "".join(
        f".c{k} {{ stroke: {c}; stroke-width: 1.6; }} .t{k} {{ fill: {c}; }}\n"
        for k, c in enumerate(_COLOURS)
    )
    + """</style>
<rect width="100%" height="100%" fill="#fff"/>"""
)


def draw_coenergy(found: CoenergyMap) -> str:
    """Return the picture as an SVG document; the other coil carries no current."""
    x = np.linspace(found.positions[0], found.positions[-1], _POINTS)
    i = np.linspace(0.0, found.currents[-1], _POINTS)
    levels = found.currents[-1] * np.arange(1, _CURVES + 1) / _CURVES
    places = np.linspace(found.positions[0], found.positions[-1], _CURVES - 1)
    force = [found.force(_alone(found, np.full(_POINTS, c)), x) for c in levels]
    flux = [1e3 * found.flux(_alone(found, i), np.full(_POINTS, p))[:, 0] for p in places]
    name = found.coils[0]
    left = _panel(0.0, 1e3 * x, force, [f"{c:.3g} A" for c in levels])
    left.axes(x_label="x [mm]", y_label=f"force [N] over i_{name}", x_ticks=5, y_ticks=6)
    right = _panel(_WIDTH, i, flux, [f"{1e3 * p:.2g} mm" for p in places])
    right.axes(x_label=f"i_{name} [A]", y_label="flux linkage [mWb] over x", x_ticks=5, y_ticks=6)
    parts = [_STYLE, *left.parts, *right.parts]
    svg = str(drawing(2 * _WIDTH, _HEIGHT, parts, f"map of {found.provenance.get('name', '')}"))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _alone(found: CoenergyMap, current: FloatArray) -> FloatArray:
    """Return currents (N, C) of which only the first coil's is not 0."""
    currents = np.zeros((len(current), len(found.coils)))
    currents[:, 0] = current
    return currents


def _panel(left: float, x: FloatArray, curves: list[FloatArray], names: list[str]) -> Panel:
    """Return axes with the curves in them, each named at its end."""
    low = min(0.0, *(float(c.min()) for c in curves))
    high = max(0.0, *(float(c.max()) for c in curves))
    margin = 0.04 * (high - low)
    panel = Panel(left + 62.0, 28.0, _WIDTH - 132.0, _HEIGHT - 80.0, (float(x[0]), float(x[-1])),
                  (low - margin, high + margin))  # fmt: skip
    for k, (curve, name) in enumerate(zip(curves, names, strict=True)):
        panel.line(x, curve, f"c{k}")
        at_x, at_y = panel.place(x[-1], curve[-1])
        panel.text(float(at_x) + 5.0, float(at_y) + 4.0, name, f"t{k}")
    return panel
