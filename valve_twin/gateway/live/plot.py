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

from valve_twin.report.svg import round_ticks, tick_texts

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import TypeAlias

    from valve_twin.core.types import BoolArray, FloatArray, IntArray

    Names: TypeAlias = tuple[str, ...]
    """Curves whose samples have the same stamps."""

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

FIT_EVERY = 5
"""Ranges are narrowed to what is seen at one look in so many; widened at once [1]."""

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
_PLACE_OF = {curve: k for k, strip in enumerate(STRIPS) for curve in strip.curves}
_RESIDUAL = 1
_COMMANDS = frozenset(STRIPS[-1].curves)


@dataclass(slots=True)
class Slice:
    """What came between two looks: decimated points of the curves.

    Attributes
    ----------
    start_s, end_s : float
        Since the beginning of the plot [s].
    points : mapping
        Times since `start_s` [s], and values of each curve; NaN interrupts one.
    sigma : float
        Expected standard deviation of the residual [1]; NaN = not known.
    extent : tuple of float
        Lowest value of each strip, then the highest; infinite where there is none.
    """

    start_s: float
    end_s: float
    points: dict[Names, tuple[list[float], list[list[float]]]]
    sigma: float = math.nan
    extent: tuple[float, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Find the extent."""
        lows, highs = [math.inf] * len(STRIPS), [-math.inf] * len(STRIPS)
        if math.isfinite(self.sigma):
            lows[_RESIDUAL], highs[_RESIDUAL] = -BAND * self.sigma, BAND * self.sigma
        for names, (_, rows) in self.points.items():
            for name, values in zip(names, rows, strict=True):
                known = values if _are_finite(values) else [v for v in values if math.isfinite(v)]
                if known:
                    place = _PLACE_OF[name]
                    lows[place] = min(lows[place], *known)
                    highs[place] = max(highs[place], *known)
        self.extent = *lows, *highs


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
        self._waiting: dict[Names, list[tuple[IntArray, FloatArray]]] = {}
        self._slices: deque[Slice] = deque()
        self._last: dict[Names, tuple[float, list[float]]] = {}
        self._begin_ns = self._newest_ns = 0
        self._drawn_s = 0.0
        self._sigma = math.nan
        self._anew, self._fitted = True, 0
        self._ranges = [strip.least for strip in STRIPS]

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
        names = tuple(name for name in curves if name in _PLACE_OF)
        if not names:
            return
        parts = self._waiting.setdefault(names, [])
        parts.append((stamp_ns, np.array([curves[name] for name in names], dtype=np.float64)))
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
            if self._fit_ranges(fresh):
                self._anew = True
        if self._anew:
            self._anew = False
            return Drawn(anew=True)
        return Drawn([self._paths(fresh)] if fresh is not None else [])

    def all(self) -> list[dict[str, Any]]:
        """Return all slices of the window."""
        return [self._paths(one) for one in self._slices]

    def axes(self) -> list[dict[str, Any]]:
        """Return the lines of the axes: height in the drawing and the number beside it."""
        found: list[dict[str, Any]] = []
        for place, strip in enumerate(STRIPS):
            if strip.name == "command" and not self._has_commands():
                continue
            ticks = round_ticks(*self._ranges[place], 4 if strip.height > 150 else 2)
            for value, text in zip(ticks, tick_texts(ticks), strict=True):
                found.append({"y": round(self._height(place, value), 1), "text": text})
        return found

    def _has_commands(self) -> bool:
        return any(not _COMMANDS.isdisjoint(names) for one in self._slices for names in one.points)

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
        if end_s <= self._drawn_s or not any("measured" in names for names in self._waiting):
            return None
        start_s, points = self._drawn_s, {}
        for names in list(self._waiting):
            taken = self._take(names, start_s, end_s)
            if taken is not None:
                points[names] = taken
        self._drawn_s = end_s
        return Slice(start_s, end_s, points, self._sigma)

    def _take(
        self, names: Names, start_s: float, end_s: float
    ) -> tuple[list[float], list[list[float]]] | None:
        """Return the decimated points of curves up to a time, joined to those before."""
        parts = self._waiting.pop(names)
        stamp_ns, rows = parts[0]
        if len(parts) > 1:
            stamp_ns = np.concatenate([p[0] for p in parts])
            rows = np.concatenate([p[1] for p in parts], axis=1)
        t = np.asarray((stamp_ns - self._begin_ns) * 1e-9, np.float64)
        left = t >= end_s
        if left.any():
            self._waiting[names] = [(stamp_ns[left], rows[:, left])]
        keep = ~left & (t >= start_s - JUMP_S)
        if not keep.all():
            t, rows = t[keep], rows[:, keep]
        t, rows = decimated(t, rows, BIN_S)
        if not len(t):
            return None
        found, before = rows.tolist(), self._last.get(names)
        times = (t - start_s).tolist()
        self._last[names] = float(t[-1]), [values[-1] for values in found]
        if before is not None:
            at, held = before[0] - start_s, not _COMMANDS.isdisjoint(names)
            times[:0] = [at, times[0]] if held else [at]  # a command holds until the next one
            for values, old in zip(found, before[1], strict=True):
                values[:0] = [old, old] if held else [old]
        return times, found

    def _fit_ranges(self, fresh: Slice) -> bool:
        """Widen or narrow the ranges to what is seen; return whether one has changed."""
        self._fitted += 1
        if self._fitted % FIT_EVERY and self._holds(fresh.extent):
            return False
        changed, columns = False, list(zip(*(one.extent for one in self._slices), strict=True))
        for place, strip in enumerate(STRIPS):
            lower = min(*strip.least, *columns[place])
            upper = max(*strip.least, *columns[place + len(STRIPS)])
            if place == _RESIDUAL:
                upper = max(-lower, upper)
                lower = -upper
            old = self._ranges[place]
            outside = lower < old[0] or upper > old[1]
            if outside or upper - lower < 0.3 * (old[1] - old[0]):
                room = 0.1 * (upper - lower)
                new = (lower - room * (lower < strip.least[0]), upper + room)
                new = (-new[1], new[1]) if place == _RESIDUAL else new
                changed |= new != old
                self._ranges[place] = new
        return changed

    def _holds(self, extent: tuple[float, ...]) -> bool:
        """Return whether the ranges have room for a slice."""
        lows, highs = extent[: len(STRIPS)], extent[len(STRIPS) :]
        return all(r[0] <= low and high <= r[1]
                   for r, low, high in zip(self._ranges, lows, highs, strict=True))  # fmt: skip

    def _height(self, place: int, value: float) -> float:
        strip, (lower, upper) = STRIPS[place], self._ranges[place]
        return strip.top + (upper - value) / (upper - lower) * strip.height

    def _paths(self, one: Slice) -> dict[str, Any]:
        """Return a slice as a page takes it."""
        paths = {}
        for names, (times, rows) in one.points.items():
            x = [f"{t * UNITS_A_SECOND:.1f}" for t in times]
            for name, values in zip(names, rows, strict=True):
                place = _PLACE_OF[name]
                zero = self._height(place, 0.0)
                slope = self._height(place, 1.0) - zero
                paths[name] = _path(x, [zero + slope * v for v in values], held=name in _COMMANDS)
        if math.isfinite(one.sigma) and "residual" in paths:
            end = (one.end_s - one.start_s) * UNITS_A_SECOND
            low, high = (self._height(_RESIDUAL, k * BAND * one.sigma) for k in (-1.0, 1.0))
            paths["expected"] = f"M0 {high:.1f}H{end:.1f}V{low:.1f}H0Z"
        return {"t": round(one.start_s * UNITS_A_SECOND, 2), "d": paths}


def _are_finite(values: list[float]) -> bool:
    return math.isfinite(sum(values))


def _path(x: list[str], y: list[float], *, held: bool) -> str:
    """Return a path through points; what is no number interrupts it.

    Of what is held, only where it begins and ends.
    """
    if not _are_finite(y):
        moves, pen = [], "M"
        for a, b in zip(x, y, strict=True):
            if math.isfinite(b):
                moves.append(f"{pen}{a} {b:.1f}")
            pen = "L" if math.isfinite(b) else "M"
        return "".join(moves)
    points = list(zip(x, y, strict=True))
    if held:
        inner = zip(y, points[1:-1], y[2:], strict=False)
        points[1:-1] = [p for before, p, after in inner if not before == p[1] == after]
    return "M" + "L".join([f"{a} {b:.1f}" for a, b in points])


def decimated(t: FloatArray, values: FloatArray, bin_s: float) -> tuple[FloatArray, FloatArray]:
    """Keep lowest and highest value of each bin of time, in their order; few samples stay.

    Parameters
    ----------
    t : (N,) array
        Times, not decreasing [s].
    values : (..., N) array
        Values of one or more curves [any unit]; NaN = none.
    bin_s : float
        Width of a bin [s].

    Returns
    -------
    (M,) array, (..., M) array
        At most two points a bin; those of NaN where a bin has no value of a curve.
    """
    number = np.floor(t / bin_s)
    if (number[2:] != number[:-2]).all():
        return t, values
    starts = np.flatnonzero(np.concatenate([[True], number[1:] != number[:-1]]))
    ends = np.append(starts[1:], len(t)) - 1
    known: BoolArray = np.isfinite(values)
    lowest = np.minimum.reduceat(np.where(known, values, np.inf), starts, axis=-1)
    highest = np.maximum.reduceat(np.where(known, values, -np.inf), starts, axis=-1)
    empty = lowest > highest
    rising = ~(values[..., ends] < values[..., starts])
    first = np.where(empty, np.nan, np.where(rising, lowest, highest))
    second = np.where(empty, np.nan, np.where(rising, highest, lowest))
    times = np.column_stack([t[starts], t[ends]]).ravel()
    return times, np.stack([first, second], axis=-1).reshape(*values.shape[:-1], -1)
