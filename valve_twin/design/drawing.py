# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A pen for half sections in SVG: the axis lies across, the radius points up, in millimetres."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import FloatArray

_WIDTH, _MARGIN, _FOOT = 900.0, 46.0, 58.0
_STYLE = """<style>
text { font: 12px sans-serif; fill: #1b2026; } .mid { text-anchor: middle; }
.end { text-anchor: end; } .steel { fill: #c9d3dd; stroke: #56616d; }
.coil { fill: #e9c9a6; stroke: #9a6428; } .magnet { fill: #d7b8e0; stroke: #7a3f8c; }
.other { fill: #eef1f4; stroke: #8a929b; } .axis { stroke: #8a929b; stroke-dasharray: 9 3 2 3; }
.tick { stroke: #8a929b; } .line { fill: none; stroke: #1b2026; stroke-width: 0.7; }
.edge { fill: none; stroke: #1b2026; stroke-width: 0.8; } .moves { stroke-width: 2; }
</style>
<rect width="100%" height="100%" fill="#fff"/>"""


class Sheet:
    """A drawing in the making.

    Parameters
    ----------
    radius, low, high : float
        What is shown: from the axis to a radius, between two places on the axis [m].
    """

    def __init__(self, radius: float, low: float, high: float) -> None:
        self._scale = (_WIDTH - 2.0 * _MARGIN) / (high - low)
        self._low, self._high = low, high
        self.height = radius * self._scale + _MARGIN + _FOOT
        self._base = radius * self._scale + 0.5 * _MARGIN
        self.parts: list[str] = [_STYLE]

    def place(self, r: float, z: float) -> tuple[float, float]:
        """Return the place of a point in the drawing.

        Parameters
        ----------
        r, z : float
            The point [m].
        """
        return _MARGIN + (z - self._low) * self._scale, self._base - r * self._scale

    def polygon(self, outline: Iterable[tuple[float, float]], style: str) -> None:
        """Draw a closed polygon of corners (r, z) [m] in a class of the style sheet."""
        at = " ".join("{:.2f},{:.2f}".format(*self.place(r, z)) for r, z in outline)
        self.parts.append(f'<polygon class="{style}" points="{at}"/>')

    def polygons(self, corners: FloatArray, colour: str) -> None:
        """Fill triangles of one colour, with (2, 3, S) corners [m]."""
        at = self._places(corners)
        moves = "".join(
            f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f} {e:.1f} {f:.1f}z" for a, b, c, d, e, f in at
        )
        style = f"fill:{colour};stroke:{colour};stroke-width:0.4"
        self.parts.append(f'<path style="{style}" d="{moves}"/>')

    def _places(self, corners: FloatArray) -> FloatArray:
        """Return places (S, 6) in the drawing."""
        x = _MARGIN + (corners[1] - self._low) * self._scale
        y = self._base - corners[0] * self._scale
        found: FloatArray = np.stack([x, y], axis=1).reshape(6, -1).T
        return found

    def lines(self, lines: Sequence[tuple[float, float, float, float]], style: str) -> None:
        """Draw straight pieces (r, z, r, z) [m] in a class of the style sheet."""
        moves = "".join(
            "M{:.1f} {:.1f}L{:.1f} {:.1f}".format(*self.place(a, b), *self.place(c, d))
            for a, b, c, d in lines
        )
        self.parts.append(f'<path class="{style}" d="{moves}"/>')

    def text(self, r: float, z: float, text: str, style: str = "mid") -> None:
        """Write words at a point.

        Parameters
        ----------
        r, z : float
            The point [m].
        text : str
            Words.
        style : str
            Class of the style sheet.
        """
        x, y = self.place(r, z)
        at = f'x="{x:.1f}" y="{y + 4:.1f}"'
        self.parts.append(f'<text class="{style}" {at}>{escape(text)}</text>')

    def ruler(self, step: float) -> None:
        """Draw the axis with millimetres every `step` metres."""
        self.lines([(0.0, self._low, 0.0, self._high)], "axis")
        first, last = int(self._low / step), int(self._high / step)
        for k in range(first, last + 1):
            x, y = self.place(0.0, k * step)
            self.parts.append(f'<path class="tick" d="M{x:.1f} {y:.1f}v5"/>')
            self.parts.append(
                f'<text class="mid" x="{x:.1f}" y="{y + 19:.1f}">{1e3 * k * step:g}</text>'
            )

    def note(self, text: str) -> None:
        """Write a line below the drawing."""
        self.parts.append(f'<text x="{_MARGIN}" y="{self.height - 10:.1f}">{escape(text)}</text>')

    def finished(self, title: str) -> str:
        """Return the SVG document."""
        body = "\n".join(self.parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {self.height:.0f}"'
            f' role="img" aria-label="{escape(title)}">\n{body}\n</svg>\n'
        )
