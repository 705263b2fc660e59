# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The last seconds of a valve as paths of SVG, drawn slice by slice.

A sample is drawn once, whoever looks: what is new since the last look is a slice of paths in
coordinates of its own, which a page puts beside those that it has.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.report.svg import polyline, round_ticks, tick_texts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

WINDOW_S = 10.0
"""What the plot shows [s of the data's clock]."""

WIDTH = 1000.0
"""Width of the plot [units of the drawing]."""

BIN_S = WINDOW_S / 400
"""Of more than two samples within this time the lowest and the highest are drawn [s]."""

JUMP_S = 60.0
"""Stamps that jump by more than this, or back, begin a new plot [s]."""

MOST_WAITING = 100_000
"""Samples of a curve that wait to be drawn, as commands do while no prediction comes; of more the
oldest are left out [1]."""

UNITS_A_SECOND = WIDTH / WINDOW_S
BAND = 2.0
"""Half the width of the residual's band [expected standard deviations]."""

MOST_COMMANDS = 4
"""Commands that are drawn [1]."""


@dataclass(frozen=True, slots=True)
class Strip:
    """One of the plots above each other: its curves, place and least range."""

    name: str
    curves: tuple[str, ...]
    top: float
    height: float
    least: tuple[float, float]


STRIPS = (
    Strip("position", ("measured", "predicted", "freerun"), 26.0, 250.0, (0.0, 1.0)),
    Strip("residual", ("residual",), 312.0, 92.0, (-1e-4, 1e-4)),
    Strip("command", tuple(f"s{k}" for k in range(MOST_COMMANDS)), 440.0, 76.0, (0.0, 1.0)),
)
HEIGHT = 524.0
"""Height of the plot [units of the drawing]."""

_STRIP_OF = {curve: strip for strip in STRIPS for curve in strip.curves}


@dataclass(slots=True)
class Slice:
    """What came between two looks: decimated points by curve, and its paths.

    Attributes
    ----------
    start_s, end_s : float
        Since the beginning of the plot [s].
    points : mapping
        Times since `start_s` [s] and values by curve; NaN interrupts a curve.
    sigma : float
        Expected standard deviation of the residual [1]; NaN = not known.
    """

    start_s: float
    end_s: float
    points: dict[str, tuple[FloatArray, FloatArray]]
    sigma: float = math.nan


@dataclass(slots=True)
class Drawn:
    """What a look at the plot finds new.

    Attributes
    ----------
    slices : list of dict
        Each with `t`, where it begins [units since the beginning], and `d`, paths by curve.
    anew : bool
        Whether what was drawn before does not count any more.
    """

    slices: list[dict[str, Any]] = field(default_factory=list)
    anew: bool = False


class LivePlot:
    """The last `WINDOW_S` of a valve; to be used by one thread at a time."""

    def __init__(self) -> None:
        self._waiting: dict[str, list[tuple[IntArray, FloatArray]]] = {}
        self._slices: deque[Slice] = deque()
        self._last: dict[str, tuple[float, float]] = {}
        self._begin_ns = self._newest_ns = 0
        self._drawn_s = 0.0
        self._sigma = math.nan
        self._anew = True
        self._ranges = {strip.name: strip.least for strip in STRIPS}

    @property
    def right(self) -> float:
        """Where the newest drawn sample stands [units since the beginning]."""
        return self._drawn_s * UNITS_A_SECOND

    def add(
        self, stamp_ns: IntArray, curves: Mapping[str, FloatArray], sigma: float = math.nan
    ) -> None:
        """Take samples.

        Parameters
        ----------
        stamp_ns : (N,) int64 array
            Stamps, not decreasing [ns].
        curves : mapping of (N,) arrays
            Values by curve [units of the strip].
        sigma : float
            Expected standard deviation of the residual [1].
        """
        if not len(stamp_ns):
            return
        if "measured" in curves:
            self._follow(int(stamp_ns[0]), int(stamp_ns[-1]))
            self._sigma = sigma
        for name, values in curves.items():
            if name in _STRIP_OF:
                parts = self._waiting.setdefault(name, [])
                parts.append((stamp_ns, values))
                while len(parts) > 1 and sum(len(p[0]) for p in parts) > MOST_WAITING:
                    del parts[0]

    def interrupt(self) -> None:
        """Leave a gap between what came so far and what comes."""
        self._waiting.clear()
        self._last.clear()

    def draw(self) -> Drawn:
        """Draw what came since the last call."""
        fresh = self._cut()
        if fresh is not None:
            self._slices.append(fresh)
            while self._slices and self._slices[0].end_s < self._drawn_s - WINDOW_S - 1.0:
                self._slices.popleft()
        grown = self._fit_ranges()
        if self._anew or grown:
            self._anew = False
            return Drawn(anew=True)
        return Drawn([self._paths(fresh)] if fresh is not None else [])

    def all(self) -> list[dict[str, Any]]:
        """Return all slices of the window."""
        return [self._paths(one) for one in self._slices]

    def axes(self) -> list[dict[str, Any]]:
        """Return the lines of the axes: height in the drawing and the number beside it."""
        found: list[dict[str, Any]] = []
        for strip in STRIPS:
            if strip.name == "command" and not self._has_commands():
                continue
            ticks = round_ticks(*self._ranges[strip.name], 4 if strip.height > 150 else 2)
            for value, text in zip(ticks, tick_texts(ticks), strict=True):
                found.append({"y": round(self._height(strip, value), 1), "text": text})
        return found

    def _has_commands(self) -> bool:
        commands = STRIPS[-1].curves
        return any(c in one.points for one in self._slices for c in commands)

    def _follow(self, first_ns: int, last_ns: int) -> None:
        """Begin a new plot where the clock jumps."""
        ahead_s = (first_ns - self._newest_ns) * 1e-9
        if not self._newest_ns or not -1.0 < ahead_s < JUMP_S:
            self._waiting.clear()
            self._slices.clear()
            self._last.clear()
            self._begin_ns, self._drawn_s, self._anew = first_ns, 0.0, True
        self._newest_ns = last_ns

    def _cut(self) -> Slice | None:
        """Take the samples up to the last whole bin; None where there are none."""
        newest_s = (self._newest_ns - self._begin_ns) * 1e-9
        end_s = math.floor(newest_s / BIN_S) * BIN_S
        if end_s <= self._drawn_s or "measured" not in self._waiting:
            return None
        start_s, points = self._drawn_s, {}
        for name in list(self._waiting):
            taken = self._take(name, start_s, end_s)
            if taken is not None:
                points[name] = taken
        self._drawn_s = end_s
        return Slice(start_s, end_s, points, self._sigma)

    def _take(
        self, name: str, start_s: float, end_s: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the decimated points of a curve up to a time, joined to those before."""
        parts = self._waiting.pop(name)
        stamp_ns = np.concatenate([p[0] for p in parts])
        values = np.concatenate([p[1] for p in parts])
        t = (stamp_ns - self._begin_ns) * 1e-9
        left = t >= end_s
        if left.any():
            self._waiting[name] = [(stamp_ns[left], values[left])]
        keep = ~left & (t >= start_s - JUMP_S)
        t, values = decimated(t[keep], values[keep], BIN_S)
        if not len(t):
            return None
        before = self._last.get(name)
        self._last[name] = float(t[-1]), float(values[-1])
        if before is not None:
            if name in STRIPS[-1].curves:  # a command holds until the next one
                t = np.concatenate([[before[0], t[0]], t])
                values = np.concatenate([[before[1], before[1]], values])
            else:
                t, values = np.concatenate([[before[0]], t]), np.concatenate([[before[1]], values])
        return t - start_s, values

    def _fit_ranges(self) -> bool:
        """Widen or narrow the ranges to what is seen; return whether one has changed."""
        changed = False
        for strip in STRIPS:
            seen = [one.points[c][1] for one in self._slices for c in strip.curves
                    if c in one.points]  # fmt: skip
            values = np.concatenate(seen) if seen else np.empty(0)
            values = values[np.isfinite(values)]
            lower, upper = strip.least
            if len(values):
                lower, upper = min(lower, float(values.min())), max(upper, float(values.max()))
            if strip.name == "residual":
                sigmas = [BAND * one.sigma for one in self._slices if math.isfinite(one.sigma)]
                most = max(-lower, upper, *sigmas)
                lower, upper = -most, most
            old = self._ranges[strip.name]
            outside = lower < old[0] or upper > old[1]
            if outside or upper - lower < 0.3 * (old[1] - old[0]):
                room = 0.1 * (upper - lower)
                new = (lower - room * (lower < strip.least[0]), upper + room)
                new = (-new[1], new[1]) if strip.name == "residual" else new
                changed |= new != old
                self._ranges[strip.name] = new
        return changed

    def _height(self, strip: Strip, value: float) -> float:
        lower, upper = self._ranges[strip.name]
        return strip.top + (upper - value) / (upper - lower) * strip.height

    def _paths(self, one: Slice) -> dict[str, Any]:
        """Return a slice as a page takes it."""
        paths = {}
        for name, (t, values) in one.points.items():
            strip = _STRIP_OF[name]
            lower, upper = self._ranges[strip.name]
            y = strip.top + (upper - values) / (upper - lower) * strip.height
            paths[name] = polyline(t * UNITS_A_SECOND, y)
        if math.isfinite(one.sigma) and "residual" in one.points:
            strip, end = STRIPS[1], (one.end_s - one.start_s) * UNITS_A_SECOND
            low, high = (self._height(strip, k * BAND * one.sigma) for k in (-1.0, 1.0))
            paths["expected"] = f"M0 {high:.1f}H{end:.1f}V{low:.1f}H0Z"
        return {"t": round(one.start_s * UNITS_A_SECOND, 2), "d": paths}


def decimated(t: FloatArray, values: FloatArray, bin_s: float) -> tuple[FloatArray, FloatArray]:
    """Keep lowest and highest value of each bin of time, in their order; few samples stay.

    Parameters
    ----------
    t, values : (N,) arrays
        Times, not decreasing [s], and values [any unit]; NaN = none.
    bin_s : float
        Width of a bin [s].

    Returns
    -------
    tuple of (M,) arrays
        At most two points a bin; one of NaN where a bin has no value.
    """
    if not len(t):
        return t, values
    number = np.floor(t / bin_s)
    starts = np.flatnonzero(np.concatenate([[True], number[1:] != number[:-1]]))
    sizes = np.diff(np.concatenate([starts, [len(t)]]))
    if sizes.max() <= 2:
        return t, values
    known: BoolArray = np.isfinite(values)
    lowest = np.minimum.reduceat(np.where(known, values, np.inf), starts)
    highest = np.maximum.reduceat(np.where(known, values, -np.inf), starts)
    empty = lowest > highest
    ends = starts + sizes - 1
    rising = ~(values[ends] < values[starts])
    first = np.where(empty, np.nan, np.where(rising, lowest, highest))
    second = np.where(empty, np.nan, np.where(rising, highest, lowest))
    times = np.column_stack([t[starts], t[ends]]).ravel()
    return times, np.column_stack([first, second]).ravel()
