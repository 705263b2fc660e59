# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A small pen for charts in SVG: axes with round numbers, lines, dots, bands, words.

Coordinates are rounded to a tenth of a unit. Colours are classes, so that the page's style sheet
decides on them; no element needs a script or anything from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup, escape

from valve_twin.report.text import MINUS

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.types import BoolArray, FloatArray, IntArray


def round_ticks(lower: float, upper: float, count: int) -> list[float]:
    """Return about `count` round numbers inside [lower, upper].

    Parameters
    ----------
    lower, upper : float
        Ends of the axis [its unit].
    count : int
        About how many are wanted [1].
    """
    if not (math.isfinite(lower) and math.isfinite(upper) and upper > lower):
        return []
    for parts in (count, 2 * count, 4 * count):  # finer where fewer than two fit
        raw = (upper - lower) / max(parts, 1)
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= raw * (1 - 1e-9))
        first, last = math.ceil(lower / step - 1e-9), math.floor(upper / step + 1e-9)
        if last > first:
            break
    return [k * step for k in range(first, last + 1)]


def tick_texts(ticks: Sequence[float]) -> list[str]:
    """Return the texts of ticks, all with the decimals that the step needs."""
    if not ticks:
        return []
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(ticks[0]) or 1.0
    largest = max(abs(t) for t in ticks)
    if largest < 1e-3 or largest >= 1e6:
        digits = math.ceil(math.log10(largest / step)) + 1 if largest else 1
        return [f"{t:.{digits}g}".replace("-", MINUS) for t in ticks]
    places = next((d for d in range(8) if abs(round(step, d) - step) < 1e-6 * step), 8)
    return [f"{t:.{places}f}".replace("-", MINUS) if t else "0" for t in ticks]


@dataclass(slots=True)
class Panel:
    """One pair of axes inside a drawing.

    Attributes
    ----------
    left, top, width, height : float
        Place of the plotting area in the drawing.
    x, y : tuple of float
        Lower and upper end of each axis.
    parts : list of str
        What was drawn.
    """

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    parts: list[str] = field(default_factory=list)

    def place(self, x: FloatArray | float, y: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Return the place of values in the drawing; values outside keep within reason."""
        px = self.left + (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0]) * self.width
        py = self.top + (self.y[1] - np.asarray(y, float)) / (self.y[1] - self.y[0]) * self.height
        clipped: FloatArray = np.clip(py, self.top - 2.0, self.top + self.height + 2.0)
        return px, clipped

    def axes(self, *, x_label: str = "", y_label: str = "", x_ticks: int = 6, y_ticks: int = 4,
             x_texts: bool = True, x_whole: bool = False) -> None:  # fmt: skip
        """Draw grid lines, ticks and labels.

        Parameters
        ----------
        x_label, y_label : str
            Words at the axes.
        x_ticks, y_ticks : int
            About how many numbers stand at each [1].
        x_texts : bool
            Whether the horizontal axis is numbered and labelled.
        x_whole : bool
            Whether it counts something: no number stands between two of them.
        """
        bottom, right = self.top + self.height, self.left + self.width
        ys = round_ticks(*self.y, y_ticks)
        for value, text in zip(ys, tick_texts(ys), strict=True):
            at = float(self.place(self.x[0], value)[1])
            self.parts.append(f'<path class="grid" d="M{self.left:.1f} {at:.1f}H{right:.1f}"/>')
            self.text(self.left - 6, at + 4, text, "tick end")
        xs = round_ticks(*self.x, x_ticks)
        if x_whole:
            xs = sorted({float(round(x)) for x in xs if self.x[0] <= round(x) <= self.x[1]})
        for value, text in zip(xs, tick_texts(xs), strict=True):
            at = float(self.place(value, self.y[0])[0])
            self.parts.append(f'<path class="axis" d="M{at:.1f} {bottom:.1f}v4"/>')
            if x_texts:
                self.text(at, bottom + 17, text, "tick mid")
        self.parts.append(f'<path class="axis" d="M{self.left:.1f} {bottom:.1f}H{right:.1f}"/>')
        if x_label and x_texts:
            self.text(right, bottom + 33, x_label, "label end")
        if y_label:
            self.text(self.left, self.top - 9, y_label, "label")

    def text(self, x: float, y: float, text: str, style: str) -> None:
        """Write text at a place in the drawing.

        Parameters
        ----------
        x, y : float
            Place in the drawing [1].
        text : str
            Words.
        style : str
            Class of the style sheet.
        """
        self.parts.append(f'<text class="{style}" x="{x:.1f}" y="{y:.1f}">{escape(text)}</text>')

    def line(self, x: FloatArray, y: FloatArray, style: str) -> None:
        """Draw a line through the points; NaN interrupts it.

        Parameters
        ----------
        x, y : (N,) arrays
            Points [units of the axes].
        style : str
            Class of the style sheet.
        """
        self._path(polyline(*self.place(x, y)), style)

    def dots(self, x: FloatArray, y: FloatArray, style: str) -> None:
        """Draw a dot at every point.

        Parameters
        ----------
        x, y : (N,) arrays
            Points [units of the axes].
        style : str
            Class of the style sheet; its stroke width is the size.
        """
        px, py = self.place(x, y)
        keep = np.isfinite(px) & np.isfinite(py)
        self._path(
            "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(px[keep], py[keep], strict=True)), style
        )

    def crosses(self, x: FloatArray, y: FloatArray, style: str, half: float = 3.0) -> None:
        """Draw a small cross at every point.

        Parameters
        ----------
        x, y : (N,) arrays
            Points [units of the axes].
        style : str
            Class of the style sheet.
        half : float
            Half the width of a cross in the drawing [1].
        """
        px, py = self.place(x, y)
        w = 2 * half
        moves = (
            f"M{a - half:.1f} {b - half:.1f}l{w} {w}m{-w} 0l{w} {-w}"
            for a, b in zip(px, py, strict=True)
            if math.isfinite(a) and math.isfinite(b)
        )
        self._path("".join(moves), style)

    def bars(self, x: FloatArray, lower: FloatArray, upper: FloatArray, style: str) -> None:
        """Draw an upright bar from lower to upper at every x.

        Parameters
        ----------
        x, lower, upper : (N,) arrays
            Places and ends of the bars [units of the axes].
        style : str
            Class of the style sheet.
        """
        px, low = self.place(x, lower)
        _, high = self.place(x, upper)
        keep = np.isfinite(low) & np.isfinite(high)
        moves = (
            f"M{a:.1f} {b:.1f}V{c:.1f}"
            for a, b, c in zip(px[keep], low[keep], high[keep], strict=True)
        )
        self._path("".join(moves), style)

    def band(self, x: FloatArray, lower: FloatArray, upper: FloatArray, style: str) -> None:
        """Fill between two curves.

        Parameters
        ----------
        x, lower, upper : (N,) arrays
            Points of both curves [units of the axes].
        style : str
            Class of the style sheet.
        """
        px, low = self.place(x, lower)
        _, high = self.place(x, upper)
        if len(px) > 1 and np.isfinite(low).all() and np.isfinite(high).all():
            there = polyline(px, high)
            back = polyline(px[::-1], low[::-1]).replace("M", "L", 1)
            self._path(there + back + "Z", style)

    def shade(self, x: FloatArray, mask: BoolArray, style: str) -> None:
        """Shade the whole height where the mask holds.

        Parameters
        ----------
        x : (N,) array
            Points [unit of the axis].
        mask : (N,) bool array
            Where it is shaded.
        style : str
            Class of the style sheet.
        """
        edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
        last = len(x) - 1
        for start, stop in edges.reshape(-1, 2):
            a = float(self.place(x[start], 0.0)[0])
            b = float(self.place(x[min(stop, last)], 0.0)[0])
            self.parts.append(
                f'<rect class="{style}" x="{a:.1f}" y="{self.top:.1f}"'
                f' width="{max(b - a, 0.5):.1f}" height="{self.height:.1f}"/>'
            )

    def level(self, y: float, style: str) -> None:
        """Draw a horizontal line across the panel."""
        at = float(self.place(self.x[0], y)[1])
        self._path(f"M{self.left:.1f} {at:.1f}h{self.width:.1f}", style)

    def mark(self, x: float, style: str) -> None:
        """Draw an upright line across the panel."""
        at = float(self.place(x, self.y[0])[0])
        self._path(f"M{at:.1f} {self.top:.1f}v{self.height:.1f}", style)

    def _path(self, d: str, style: str) -> None:
        if d:
            self.parts.append(f'<path class="{style}" d="{d}"/>')


def drawing(
    width: float, height: float, parts: Iterable[str], title: str, style: str = ""
) -> Markup:
    """Return an SVG element.

    Parameters
    ----------
    width, height : float
        Its size [1]; the page scales it.
    parts : iterable of str
        What is drawn in it, as `Panel.parts`.
    title : str
        What a screen reader says.
    style : str
        Class of the style sheet.

    Returns
    -------
    Markup
        SVG element.
    """
    body = "\n".join(parts)
    return Markup(
        f'<svg class="{style}" viewBox="0 0 {width:g} {height:g}" role="img"'
        f' aria-label="{escape(title)}">\n{body}\n</svg>'
    )


def thin(x: FloatArray, y: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Keep first, lowest, highest and last point of each bin: the picture stays the same.

    Parameters
    ----------
    x, y : (N,) arrays
        Points [units of the axes].
    bins : int
        Parts of the horizontal axis [1].
    """
    n = len(x)
    if n <= 4 * bins:
        return x, y
    index = extremes(np.arange(n) * bins // n, y)
    return x[index], y[index]


def extremes(column: IntArray, y: FloatArray) -> IntArray:
    """Return which points show the first, lowest, highest and last of each column, rising.

    Parameters
    ----------
    column : (N,) int64 array
        Where each point is drawn, in any order.
    y : (N,) array
        Their heights [any unit]; one that is NaN is neither the lowest nor the highest.
    """
    found = []
    order = np.argsort(column, kind="stable")
    by_height = np.lexsort((y, column))
    for points in (order, by_height[np.isfinite(y[by_height])]):
        new = np.diff(column[points]) != 0
        found += [points[np.r_[True, new]], points[np.r_[new, True]]] if len(points) else []
    return np.unique(np.concatenate(found)) if found else np.zeros(0, np.int64)


def polyline(px: FloatArray, py: FloatArray) -> str:
    """Return a path through points; NaN interrupts it.

    Parameters
    ----------
    px, py : (N,) arrays
        Points [units of the drawing].
    """
    pen_down = False
    moves = []
    for a, b in zip(px.tolist(), py.tolist(), strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            pen_down = False
            continue
        moves.append(f"{'L' if pen_down else 'M'}{a:.1f} {b:.1f}")
        pen_down = True
    return "".join(moves)
