# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Lines through the cycles before, and how far the newest cycles lie off them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.watch.growing import Growing
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines through the cycles before: prediction at `x` and its variance over that of a cycle."""

    level: FloatArray
    slope: FloatArray
    centre: FloatArray
    count: FloatArray

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the prediction (N, F) at `x` (N,) and its variance (N,)."""
        spread = self.count * (self.count**2 - 1.0) / 12.0
        off = x - self.centre
        return self.level + self.slope * off[:, None], 1.0 / self.count + off**2 / spread


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums of the first rows of w (N, F), and of each times its number; (N + 1, F) both."""

    _total: Growing
    _moment: Growing

    @classmethod
    def of(cls, w: FloatArray) -> Sums:
        """Return the sums of w (N, F), whitened features [standard deviations]."""
        sums = cls.none(w.shape[1])
        sums.put(0, w)
        return sums

    @classmethod
    def none(cls, width: int) -> Sums:
        """Return the sums of no row of so many features."""
        zero = np.zeros((1, width))
        return cls(Growing(width, zero), Growing(width, zero))

    def put(self, first: int, w: FloatArray) -> None:
        """Let the sums from row `first` on be those of w (M, F), behind which there are none."""
        number = np.arange(first, first + len(w))
        self._total.add_up(first, w)
        self._moment.add_up(first, w * number[:, None])

    @property
    def total(self) -> FloatArray:
        """Sums of the first rows, (N + 1, F)."""
        return self._total.rows

    @property
    def moment(self) -> FloatArray:
        """Sums of the first rows, each times its number, (N + 1, F)."""
        return self._moment.rows

    def lines(self, last: IntArray, window: int) -> Lines:
        """Fit a line through at most `window` rows that end with each of `last` (K,)."""
        total, moment = self.total, self.moment
        first = np.maximum(last - window + 1, 0)
        count = (last - first + 1).astype(np.float64)
        centre = 0.5 * (first + last).astype(np.float64)
        level = (total[last + 1] - total[first]) / count[:, None]
        above = moment[last + 1] - moment[first] - (count * centre)[:, None] * level
        return Lines(level, above / (count * (count**2 - 1.0) / 12.0)[:, None], centre, count)


@njit(cache=True)
def follow(
    total: FloatArray,
    past: FloatArray,
    moment: FloatArray,
    rays: FloatArray,
    begin: int,
    number: int,
    rule: tuple[int, int, float],
    squares: FloatArray,
    ratio: FloatArray,
    stray: FloatArray,
) -> bool:
    """Say how far the newest m cycles up to each row lie off the line before them, along each ray.

    Scatter that wanders leads a line astray: beside it stands by how much more than by chance the
    cycles before strayed from their lines.

    Parameters
    ----------
    total : (N + 1, F) array
        Sums of the first rows of w [standard deviations].
    past, moment : (N + 1, F) arrays
        `Sums` of the same without outliers.
    rays : (F, S) array
        Unit signatures [1].
    begin, number : int
        First row that is looked at, and how many were before.
    rule : (int, int, float)
        m, most cycles of a line, and the square up to which one that strayed counts [1].
    squares : (R, S) array
        Sums of squares up to each row, at its number modulo R; the newest R do not count, and as
        many that stray by chance stand before the first [1]. Is kept up to the last row.
    ratio : (N - begin, S) array
        Gets how far they lie off [standard deviations].
    stray : (N - begin, S) array
        Gets the root mean square of what was known in each row, at least 1 [1].

    Returns
    -------
    bool
        Whether any of them lies off by more than the root of the square.
    """
    m, window, most = rule
    recent, width = len(squares), rays.shape[0]
    beyond, off = np.sqrt(most), np.empty(width)
    found = False
    for k in range(len(ratio)):
        end = begin + k
        last = end - m
        first = max(last - window + 1, 0)
        count = float(last - first + 1)
        centre = 0.5 * float(first + last)
        spread = count * (count**2 - 1.0) / 12.0
        x = end - 0.5 * (m - 1) - centre
        scale = np.sqrt(1.0 / m + (1.0 / count + x**2 / spread))
        for i in range(width):
            level = (past[last + 1, i] - past[first, i]) / count
            above = moment[last + 1, i] - moment[first, i] - count * centre * level
            line = level + above / spread * x
            off[i] = ((total[end + 1, i] - total[end + 1 - m, i]) / m - line) / scale
        ratio[k] = 0.0
        for i in range(width):
            for j in range(rays.shape[1]):
                ratio[k, j] += off[i] * rays[i, j]
        row = number + k
        known, before = squares[row % recent], squares[(row - 1) % recent]
        share = recent + max(row - recent + 1.0, 0.0)
        for j in range(rays.shape[1]):
            far = ratio[k, j]
            found |= far > beyond
            stray[k, j] = np.sqrt(max((recent + known[j]) / share, 1.0))
            known[j] = before[j] + min(far**2, most)
    return found


def lines_through(w: FloatArray, last: IntArray, window: int) -> Lines:
    """Fit a line through at most `window` rows of w (N, F) that end with each of `last`.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    last : (K,) int array
        Last row of each line.
    window : int
        Most rows of a line [1].
    """
    return Sums.of(w).lines(last, window)
