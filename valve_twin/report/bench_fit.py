# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a bench fit: measured points and fitted lines, axes side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.report.svg import Panel, drawing, thin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.bench_fit import BenchPlot

_WIDTH, _HEIGHT, _BINS, _MOST_POINTS = 480.0, 330.0, 300, 2000
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; }
.dot { stroke: #8a929b; stroke-width: 3; stroke-linecap: round; }
.fit { stroke: #c2500a; stroke-width: 1.5; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def draw_bench_fit(title: str, plots: Sequence[BenchPlot]) -> str:
    """Return the picture as an SVG document.

    Parameters
    ----------
    title : str
        What a screen reader says.
    plots : sequence of BenchPlot
        At least one.
    """
    parts: list[str] = [_STYLE]
    for column, plot in enumerate(plots):
        panel = Panel(_WIDTH * column + 62.0, 26.0, _WIDTH - 90.0, _HEIGHT - 76.0,
                      *_ends([*plot.measured, *plot.fitted]))  # fmt: skip
        panel.axes(x_label=plot.x_label, y_label=plot.y_label, x_ticks=5, y_ticks=5)
        for x, y in plot.measured:
            step = max(1, len(x) // _MOST_POINTS)
            panel.dots(x[::step], y[::step], "dot")
        for x, y in plot.fitted:
            # a loop goes back in x: thinned over its own length instead
            shown = thin(x, y, _BINS) if (np.diff(x) >= 0.0).all() else (x, y)
            panel.line(*shown, "fit")
        parts += panel.parts
    svg = str(drawing(_WIDTH * len(plots), _HEIGHT, parts, title))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _ends(
    curves: Sequence[tuple[FloatArray, FloatArray]],
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of both axes: all finite values with a margin."""
    found = []
    for axis in (0, 1):
        values = np.concatenate([curve[axis] for curve in curves])
        values = values[np.isfinite(values)]
        low, high = float(values.min()), float(values.max())
        half = max(0.54 * (high - low), 1e-3 * abs(high + low), 1e-12)
        found.append((0.5 * (low + high) - half, 0.5 * (low + high) + half))
    return found[0], found[1]
