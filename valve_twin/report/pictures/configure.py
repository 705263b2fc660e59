# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a proposal: command, answer, and the free run over the unseen half."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.report.svg import Panel, drawing, thin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray

_WIDTH, _HEIGHT, _LEFT, _BINS = 960.0, 200.0, 78.0, 700
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; }
.measured { stroke: #1f5fa8; } .fit { stroke: #c2500a; stroke-width: 1.5; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def draw_proposal(
    title: str,
    rows: Sequence[tuple[str, FloatArray, FloatArray]],
    free_run: tuple[FloatArray, FloatArray] | None,
    time_label: str,
) -> str:
    """Return the picture as an SVG document.

    Parameters
    ----------
    title : str
        Words above it.
    rows : sequence of (str, (N,) array, (N,) array)
        Label, times [s] and values of each channel, one below the other, the answer last.
    free_run : pair of (N,) arrays, optional
        Times [s] and the model's answer, drawn over the last row.
    time_label : str
        What the times are: invented ones are counted in samples.
    """
    parts: list[str] = [_STYLE]
    for row, (label, x, y) in enumerate(rows):
        curves = [(x, y)]
        if free_run is not None and row == len(rows) - 1:
            curves.append(free_run)
        values = np.concatenate([c[1] for c in curves])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        room = max(0.05 * (high - low), 1e-9)
        panel = Panel(
            _LEFT, 48.0 + _HEIGHT * row, _WIDTH - _LEFT - 24.0, _HEIGHT - 70.0,
            (float(rows[-1][1][0]), float(rows[-1][1][-1])), (low - room, high + room),
        )  # fmt: skip
        panel.axes(x_label=time_label, y_label=label, x_texts=row == len(rows) - 1)
        panel.line(*thin(x, y, _BINS), "measured")
        if len(curves) > 1:
            panel.line(*thin(*curves[1], _BINS), "fit")
        if row == 0:
            panel.text(_LEFT, 18.0, title, "")
        parts += panel.parts
    svg = str(drawing(_WIDTH, 60.0 + _HEIGHT * len(rows), parts, title))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"
