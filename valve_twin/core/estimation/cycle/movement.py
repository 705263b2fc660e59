# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How often and how far a valve moved in a cycle: the counters of positioners, cycle by cycle.

Positioners count reversals beyond a dead band, and the travel they make. Here the dead band comes
from the measured noise. What adds up over cycles is `core.operation.counters`.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.data.masks import contiguous
from valve_twin.core.estimation.data.robust import difference_sigma
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

MOVES, TRAVEL = "moves", "travel"
"""Names of the conditions of an estimate that hold the two counters."""

TURN = 10.0
"""Way back that is a reversal [standard deviations of the noise], assumed: a position at rest for
10^5 samples of white noise spans nine."""

NEAR = 6.0
"""How near to an extreme samples count as of the rest there [standard deviations], assumed."""

_EXTREMES = np.array([NormalDist().inv_cdf((m - 0.375) / (m + 0.25)) for m in np.exp2(range(33))])
"""Mean extreme of 2^k normal values, by k [standard deviations] (Blom, 1958)."""

LEAST_TURN = 1e-4
"""Least way back that is a reversal [share of the cycle's range], assumed: rounding."""

STEPS = 4.0
"""Least way back that is a reversal [least steps of the sensor], assumed: a value that flickers
between steps, with too little noise to measure it, is at rest."""


REST_SAMPLES = 5
"""Least length of a rest [samples], assumed."""

REST_BAND = 2.0
"""How far a movement that starts leaves its rest [dead bands], assumed."""

REST_SHARE = 0.2
"""Largest scatter of a rest [shares of its band], assumed: noise has a twentieth, a ramp through
the band and a smooth turn have 0.29 at least."""


class Moves(NamedTuple):
    """Movements of a cycle.

    Attributes
    ----------
    levels : (M + 1,) array
        Where the first begins, where the direction turns, and where the last ends, without the
        extremes of the noise [unit of the position]; empty where nothing moves.
    turn : float
        Dead band: way back that is a turn [unit of the position].
    starts : int
        Movements that begin from a rest [1].
    early : bool
        Whether the first movement is under way before a rest is seen.
    rests : bool
        Whether the cycle ends at rest.
    """

    levels: FloatArray
    turn: float = 0.0
    starts: int = 0
    early: bool = False
    rests: bool = True

    @property
    def number(self) -> int:
        """Movements in one direction [1]; their number less one is that of the reversals."""
        return max(len(self.levels) - 1, 0)

    @property
    def travel(self) -> float:
        """Way of all of them [unit of the position]."""
        return float(np.abs(np.diff(self.levels)).sum())


def count_movement(position: FloatArray) -> tuple[int, float]:
    """Return the movements in one direction, and their way [unit of the position].

    Parameters
    ----------
    position : (N,) array
        Believed positions, finite.
    """
    found = find_moves(position)
    return found.number, found.travel


def find_moves(position: FloatArray) -> Moves:
    """Return the movements in one direction between the turns of a cycle.

    Parameters
    ----------
    position : (N,) array
        Believed positions, finite.
    """
    still = Moves(np.empty(0))
    if len(position) < 3:
        return still
    position = contiguous(position)
    bends = np.empty(len(position) - 2)
    step, span = _steps(position, bends)
    if not np.isfinite(step):
        return still
    sigma = difference_sigma(bends, 2)
    turn = max(TURN * sigma, LEAST_TURN * span, STEPS * step)
    levels = np.empty(len(position) + 1)
    count, starts, early, rests = _moves(position, turn, sigma, levels)
    return Moves(levels[:count], turn, starts, early, rests)


@njit(cache=True)
def _steps(position: FloatArray, bends: FloatArray) -> tuple[float, float]:
    """Return the least step other than 0, infinite without one, and the range; fill the bends.

    These are the second differences.
    """
    least = np.inf
    low = high = position[0]
    for i in range(1, len(position)):
        step = position[i] - position[i - 1]
        if abs(step) > 0.0:
            least = min(least, abs(step))
        low, high = min(low, position[i]), max(high, position[i])
        if i > 1:
            bends[i - 2] = step - (position[i - 1] - position[i - 2])
    return least, high - low


@njit(cache=True)
def _extreme(samples: int, sigma: float) -> float:
    """Return how far the extreme of a rest of so many samples lies from its level."""
    k = np.log2(samples)
    i = min(int(k), len(_EXTREMES) - 2)
    mean: float = _EXTREMES[i] + (k - i) * (_EXTREMES[i + 1] - _EXTREMES[i])
    return sigma * mean


@njit(cache=True)
def _moves(
    position: FloatArray, turn: float, sigma: float, levels: FloatArray
) -> tuple[int, int, bool, bool]:
    """Fill the levels between which the position moves; return how many, and as `_starts`."""
    starts, early, rests = _starts(position, REST_BAND * turn)
    return _turns(position, turn, sigma, levels), starts, early, rests


@njit(cache=True)
def _turns(position: FloatArray, turn: float, sigma: float, levels: FloatArray) -> int:
    """Fill the levels between which the position moves; return how many, below two where not."""
    moves, direction = 0, 0
    low = high = extreme = position[0]
    near = 0
    for i in range(len(position)):
        y = position[i]
        if direction == 0:
            low, high = min(low, y), max(high, y)
            if high - low > turn:
                direction = 1 if y == high else -1
                begin = low if direction > 0 else high
                levels[0] = begin + direction * _extreme(max(i, 1), sigma)
                extreme, near, moves = y, 1, 1
            continue
        near += abs(y - extreme) <= NEAR * sigma
        if direction * (y - extreme) > NEAR * sigma:
            near = 1
        if direction * (y - extreme) > 0.0:
            extreme = y
        elif direction * (extreme - y) > turn:
            levels[moves] = extreme - direction * _extreme(max(near, 1), sigma)
            direction, extreme, near, moves = -direction, y, 1, moves + 1
    if moves:
        levels[moves] = extreme - direction * _extreme(max(near, 1), sigma)
        moves += 1
    return moves


@njit(cache=True)
def _starts(position: FloatArray, band: float) -> tuple[int, bool, bool]:
    """Return starts from rest, whether the first move began before a rest, and if it ends at rest.

    A rest lies within `band` with little scatter, so that a slow move is none, nor is a turn.
    """
    starts, at, early = 0, 0, False
    total, square, anchor = 0.0, 0.0, position[0]
    moved = False
    for i in range(len(position)):
        away = position[i] - anchor
        if abs(away) <= band:
            total, square = total + away, square + away * away
            continue
        n = i - at
        middle = total / max(n, 1)
        if n >= REST_SAMPLES and abs(away - middle) * REST_BAND <= band:
            # still with the others, which lie at the rim of the band: shift it to their mean
            anchor, square, total = anchor + middle, square - n * middle * middle, 0.0
            away -= middle
            total, square = total + away, square + away * away
            continue
        rested = _rested(n, total, square, band)
        starts += rested
        if not moved:
            moved, early = True, not rested
        at, anchor, total, square = i, position[i], 0.0, 0.0
    return starts, early, _rested(len(position) - at, total, square, band)


@njit(cache=True)
def _rested(samples: int, total: float, square: float, band: float) -> bool:
    """Return whether so many samples, of this sum and sum of squares, are a rest."""
    scatter = square / samples - (total / samples) ** 2
    return bool(samples >= REST_SAMPLES and scatter < (REST_SHARE * band) ** 2)
