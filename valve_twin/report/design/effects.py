# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The picture of sensitivities: a row a dimension, a column a figure, a bar to either side."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from markupsafe import escape

from valve_twin.report.svg import drawing

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_LEFT, _COLUMN, _ROW, _TOP, _GAP = 150.0, 130.0, 22.0, 52.0, 14.0
_STYLE = """<style>
svg { font: 12px sans-serif; fill: #1b2026; } .end { text-anchor: end; }
.mid { text-anchor: middle; }
.soft { fill: #545d68; } .zero { stroke: #8a929b; fill: none; } .high { fill: #0072b2; }
.low { fill: #e69f00; } .h { fill: #0072b2; } .l { fill: #a86b00; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


def draw_effects(
    columns: Sequence[str],
    rows: Mapping[str, Sequence[tuple[float, float]]],
    unit: str,
    legend: tuple[str, str],
) -> str:
    """Return the picture as an SVG document; every column has its own scale.

    Parameters
    ----------
    columns : sequence of str
        Labels.
    rows : mapping
        By label of a row, two numbers a column, NaN = not known [unit].
    unit : str
        Of all numbers.
    legend : tuple of str
        What the first and the second number are.
    """
    width = _LEFT + _COLUMN * len(columns) + 12.0
    parts = [
        _STYLE,
        f'<text x="8" y="16"><tspan class="l">{escape(legend[0])}</tspan>, '
        f'<tspan class="h">{escape(legend[1])}</tspan></text>',
    ]
    for k, label in enumerate(columns):
        values = [abs(v) for row in rows.values() for v in row[k] if math.isfinite(v)]
        most = max(values, default=0.0) or 1.0
        middle = _LEFT + _COLUMN * (k + 0.5)
        parts.append(f'<text class="mid" x="{middle:.1f}" y="34">{escape(label)}</text>')
        parts.append(
            f'<text class="mid soft" x="{middle:.1f}" y="48">to ±{most:.3g} {escape(unit)}</text>'
        )
        scale = 0.5 * (_COLUMN - _GAP) / most
        for n, row in enumerate(rows.values()):
            for half, (style, value) in enumerate(zip(("low", "high"), row[k], strict=True)):
                if math.isfinite(value):
                    left, wide = middle + min(value, 0.0) * scale, abs(value) * scale
                    top = _TOP + _ROW * n + 4.0 + half * 0.36 * _ROW
                    parts.append(
                        f'<rect class="{style}" x="{left:.1f}" y="{top:.1f}" '
                        f'width="{wide:.1f}" height="{0.34 * _ROW:.1f}"/>'
                    )
        bottom = _TOP + _ROW * len(rows)
        parts.append(f'<path class="zero" d="M{middle:.1f} {_TOP:.1f}V{bottom:.1f}"/>')
    for n, name in enumerate(rows):
        at = _TOP + _ROW * (n + 0.5) + 4.0
        parts.append(f'<text class="end" x="{_LEFT - 8:.1f}" y="{at:.1f}">{escape(name)}</text>')
    svg = str(drawing(width, _TOP + _ROW * len(rows) + 10.0, parts, "sensitivities"))
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"
