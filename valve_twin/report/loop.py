# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of a valve's steps: voltages, flux linkages, currents, output, force, position."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.report.svg import Panel, drawing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.valves.designed import Loop

_COLUMN, _ROW, _LEFT, _TOP = 330.0, 150.0, 58.0, 40.0
_SHOWN_S = 0.02  # of a step
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } path { fill: none; }
.tick, .label { fill: #545d68; } .end { text-anchor: end; } .mid { text-anchor: middle; }
.grid { stroke: #e4e7eb; } .axis { stroke: #8a929b; } .a { stroke: #0072b2; stroke-width: 1.4; }
.b { stroke: #c2500a; stroke-width: 1.4; } .c { stroke: #8a929b; stroke-dasharray: 5 3; }
.key { font-weight: 600; } .in-a { fill: #0072b2; } .in-b { fill: #c2500a; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""
_STYLES = {"B": "b", "wanted": "c"}  # of a signal by its name; "a" of all others


def draw_loops(loops: Mapping[float, Loop]) -> str:
    """Return the picture as an SVG document: a column a step, a row a group of signals.

    Parameters
    ----------
    loops : mapping
        By step over the way to an open port [1].
    """
    parts: list[str] = [_STYLE]
    rows = next(iter(loops.values())).rows
    for k, (label, _) in enumerate(rows):
        values = np.concatenate([y for of in loops.values() for y in of.rows[k][1].values()])
        low, high = min(0.0, float(values.min())), float(values.max())
        margin = 0.06 * (high - low)
        for column, (share, of) in enumerate(loops.items()):
            shown = of.time_s <= _SHOWN_S
            ms = 1e3 * of.time_s[shown]
            panel = Panel(_LEFT + _COLUMN * column, _TOP + _ROW * k, _COLUMN - 76.0, _ROW - 38.0,
                          (0.0, 1e3 * _SHOWN_S), (low - margin, high + margin))  # fmt: skip
            last = k + 1 == len(rows)
            panel.axes(x_label="time [ms]" if last else "", y_label=label, x_texts=last)
            for name, y in of.rows[k][1].items():
                panel.line(ms, y[shown], _STYLES.get(name, "a"))
            parts += panel.parts
            if k == 0:
                middle = _LEFT + _COLUMN * column + 0.5 * (_COLUMN - 76.0)
                parts.append(
                    f'<text class="key mid" x="{middle:g}" y="16">{100 * share:g} %</text>'
                )
    width, height = _COLUMN * len(loops), _TOP + _ROW * len(rows) + 18.0
    parts.append(
        '<text x="8" y="16"><tspan class="in-a">coil A</tspan> '
        '<tspan class="in-b">coil B</tspan></text>'
    )
    svg = str(drawing(width, height, parts, "steps of a designed valve"))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"
