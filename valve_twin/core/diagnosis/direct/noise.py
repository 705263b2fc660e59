# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A sensor that has become noisier than it was, over all products alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.diagnosis.changes.finding import Finding
from valve_twin.core.diagnosis.watch.growing import begins, present
from valve_twin.core.estimation.data.robust import robust_sigma
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from valve_twin.core.types import FloatArray, IntArray

_LEAST = 8
"""Fewest cycles that say how noisy the sensor is usually."""

_MOST = 40
"""Most cycles that say so."""

_CONFIRM = 2
"""Newest cycles that must all be noisier."""

_CONFIRM_ANEW = 5
"""The same where they are the first of a product, which may begin with other noise than it has."""

_RISE = 0.5
"""Least rise of the logarithm of the noise: two thirds as much again [1]."""

_SURE = 4.0
"""Least rise of each of these cycles in standard deviations [1]."""

_TAIL, _TAIL_DEVIATIONS = 0.9, 1.645
_HEAL = 5
"""Cycles that are less than half as much noisier after which it is over."""


def noisier(cycles: IntArray, noise: FloatArray, product: IntArray | None = None) -> list[Finding]:
    """Find the times in which a sensor was noisier than before.

    Noise at rest does not depend on what the valve makes, so that all products are one series;
    the first cycles of a product have to show it for longer.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    noise : (N,) array
        Standard deviation of the position at rest [unit of the position]; NaN where unknown.
    product : (N,) int64 array, optional
        What each cycle makes, -1 = not known [1].

    Returns
    -------
    list of Finding
        Oldest first; the size is how many times noisier.
    """
    product = product if product is not None else np.zeros(len(cycles), dtype=np.int64)
    return Noise().found(cycles, noise, product)


def first_quieter(noise: FloatArray) -> int:
    """Return how many of the first cycles those that follow are noisier than, 0 = none.

    They are looked at as they came: what few of them showed stays when the sensor is mended.

    Parameters
    ----------
    noise : (N,) array
        Standard deviation of the position at rest [unit of the position]; NaN where unknown.
    """
    known = np.flatnonzero(np.isfinite(noise) & (noise > 0.0))
    level = np.log(noise[known])
    for count in range(_CONFIRM + _LEAST, min(len(level), _CONFIRM + _MOST) + 1):
        for first in reversed(range(_CONFIRM, min(_LEAST, count - _LEAST + 1))):
            quiet, others = level[:first], level[first:count]
            if _rise(-others, -quiet)[0]:
                half = 0.5 * float(np.median(quiet) + np.median(others))
                return int(known[first + int(np.argmax(others > half))])
    return 0


class Noise:
    """Finds when a sensor was noisier, as cycles come; see `noisier`."""

    def __init__(self) -> None:
        self._given: tuple[NDArray[Any], ...] = ()
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._row, self._over, self._usual = 0, list[Finding](), np.empty(0)

    def found(self, cycles: IntArray, noise: FloatArray, product: IntArray) -> list[Finding]:
        """Find the times; what was settled in the first of these cycles is not sought again.

        Parameters
        ----------
        cycles, noise, product : (N,) arrays
            As for `noisier`.

        Returns
        -------
        list of Finding
            Oldest first.
        """
        given = (cycles, noise, product)
        if not (self._given and all(map(begins, self._given, given))):
            self._begin_anew()
        self._given = given
        known = np.isfinite(noise) & (noise > 0.0)
        numbers, level, confirm = cycles[known], np.log(noise[known]), _confirms(product[known])
        found, usual, settled = list(self._over), np.empty(len(level)), True
        row, count = self._row, len(self._usual)
        usual[:count] = self._usual
        while True:
            row, count = skip_quiet(level, confirm, usual, count, row)
            newest = level[row : row + confirm[row]] if row < len(level) else level[row:]
            if settled:
                self._row, self._over, self._usual = row, list(found), usual[:count]
            if row == len(level):
                return found
            before = usual[max(count - _MOST, 0) : count]
            rise, sure = _rise(before, newest)
            if not rise or len(newest) < confirm[row]:
                settled &= len(newest) == confirm[row]
                if confirm[row] == _CONFIRM:
                    usual[count], count = level[row], count + 1
                row += 1
                continue
            end = _over(level, row, float(np.median(before)) + 0.5 * rise)
            settled &= end >= 0
            stop = len(level) if end < 0 else end - _HEAL + 1
            size = float(np.exp(np.median(level[row:stop]) - np.median(before)))
            alarm = int(numbers[row + confirm[row] - 1])
            last = int(numbers[end]) if end >= 0 else -1
            onset = int(numbers[row])
            found.append(Finding("sensor_noise", (), "sensor", size, sure, onset, alarm, last))
            row = stop


@njit(cache=True)
def skip_quiet(
    level: FloatArray, confirm: IntArray, usual: FloatArray, count: int, row: int
) -> tuple[int, int]:
    """Return the first row from `row` on that is louder than all that is usual, N = none.

    Parameters
    ----------
    level : (N,) array
        Logarithm of the noise [1].
    confirm : (N,) int64 array
        How many cycles from each on must all be noisier [1].
    usual : (N,) array
        Gets the levels that are usual, behind the first `count` [1].
    count, row : int
        Levels known by the first row that is looked at [1]. Returned are the row and the number
        known by then.
    """
    for k in range(row, len(level)):
        before = usual[max(count - _MOST, 0) : count]
        if count >= _LEAST and level[k] > before.max():
            return k, count
        if confirm[k] == _CONFIRM:
            usual[count] = level[k]
            count += 1
    return len(level), count


def over(cycles: IntArray, noise: FloatArray, finding: Finding, judged: int) -> int:
    """Return the cycle at which noise that was found long ago is over, -1 = it lasts.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    noise : (N,) array
        As for `noisier`.
    finding : Finding
        What was found.
    judged : int
        Number of a cycle up to which it lasted.
    """
    known = np.isfinite(noise) & (noise > 0.0) & (cycles >= finding.onset)
    numbers, level = cycles[known], np.log(noise[known])
    noisy = level[numbers <= judged]
    if not len(noisy):
        return -1
    end = _over(level, 0, float(np.median(noisy)) - 0.5 * float(np.log(finding.severity)))
    return int(numbers[end]) if end >= 0 else -1


def _confirms(product: IntArray) -> IntArray:
    """Return by row how many cycles from it on must all be noisier, (N,)."""
    confirm = np.full(len(product), _CONFIRM)
    confirm[product < 0] = _CONFIRM_ANEW
    for number in present(product):
        own = np.flatnonzero(product == number)
        if own[0]:
            early = own[: _CONFIRM_ANEW - _CONFIRM]
            confirm[early] = np.maximum(_CONFIRM_ANEW - (early - own[0]), _CONFIRM)
    return confirm


def _rise(usual: FloatArray, newest: FloatArray) -> tuple[float, float]:
    """Return the least rise of the newest cycles, and that in standard deviations; 0 = none."""
    if len(usual) < _LEAST:
        return 0.0, 0.0
    if not newest.min() > usual.max():
        return 0.0, 0.0
    off = usual - np.median(usual)
    spread = max(robust_sigma(off), float(np.quantile(np.abs(off), _TAIL)) / _TAIL_DEVIATIONS)
    rise = float(newest.min() - np.median(usual))
    sure = rise / max(spread, _RISE / _SURE)
    return (rise, sure) if sure > _SURE else (0.0, 0.0)


def _over(level: FloatArray, onset: int, half: float) -> int:
    """Return the first row that ends `_HEAL` rows of less than half the rise, or -1."""
    run = 0
    for row in range(onset, len(level)):
        run = run + 1 if level[row] < half else 0
        if run == _HEAL:
            return row
    return -1
