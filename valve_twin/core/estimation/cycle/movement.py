# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How often and how far a valve moved in a cycle: the counters of positioners, cycle by cycle.

Positioners count reversals beyond a dead band, and the travel they make. Here the dead band comes
from the measured noise. Sums over a history are `total_movement`.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from valve_twin.core.estimation.data.robust import difference_sigma

if TYPE_CHECKING:
    from collections.abc import Iterable

    from valve_twin.core.types import Estimate, FloatArray

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


class Movement(NamedTuple):
    """Movement of one or many cycles.

    Attributes
    ----------
    moves : int
        Movements in one direction; their number less one is that of the reversals.
    travel : float
        Way of all of them [unit of the position].
    cycles : int
        Cycles that were counted.
    seconds : float
        Their length [s].
    """

    moves: int = 0
    travel: float = 0.0
    cycles: int = 0
    seconds: float = 0.0


def count_movement(position: FloatArray) -> tuple[int, float]:
    """Return the movements in one direction, and their way [unit of the position].

    Parameters
    ----------
    position : (N,) array
        Believed positions, finite.
    """
    if len(position) < 3:
        return 0, 0.0
    sigma = difference_sigma(np.diff(position, 2), 2)
    steps = np.abs(np.diff(position))
    step = float(steps[steps > 0.0].min(initial=np.inf))
    if not np.isfinite(step):
        return 0, 0.0
    turn = max(TURN * sigma, LEAST_TURN * float(np.ptp(position)), STEPS * step)
    moves, travel = _count(position, turn, sigma)
    return int(moves), float(max(travel, 0.0))


def total_movement(estimates: Iterable[Estimate]) -> Movement:
    """Return the movement of all cycles whose estimates tell it; each cycle counts once.

    Parameters
    ----------
    estimates : iterable of Estimate
        Of one valve, any order, any estimators.
    """
    told = {}
    for e in estimates:
        found = {c.name: c.value for c in e.conditions}
        if MOVES in found and TRAVEL in found:
            told[e.cycle, e.end_ns] = (found[MOVES], found[TRAVEL], e.end_ns - e.start_ns)
    if not told:
        return Movement()
    moves, travel, length_ns = map(sum, zip(*told.values(), strict=True))
    return Movement(round(moves), travel, len(told), 1e-9 * length_ns)


@njit(cache=True)
def _extreme(samples: int, sigma: float) -> float:
    """Return how far the extreme of a rest of so many samples lies from its level."""
    k = np.log2(samples)
    i = min(int(k), len(_EXTREMES) - 2)
    mean: float = _EXTREMES[i] + (k - i) * (_EXTREMES[i + 1] - _EXTREMES[i])
    return sigma * mean


@njit(cache=True)
def _count(position: FloatArray, turn: float, sigma: float) -> tuple[int, float]:
    """Return how often the direction holds until a way back above `turn`, and the whole way."""
    moves, way, direction = 0, 0.0, 0
    low = high = begin = extreme = position[0]
    near = 0
    for i in range(len(position)):
        y = position[i]
        if direction == 0:
            low, high = min(low, y), max(high, y)
            if high - low > turn:
                direction = 1 if y == high else -1
                begin = low if direction > 0 else high
                begin += direction * _extreme(max(i, 1), sigma)
                extreme, near, moves = y, 1, 1
            continue
        near += abs(y - extreme) <= NEAR * sigma
        if direction * (y - extreme) > NEAR * sigma:
            near = 1
        if direction * (y - extreme) > 0.0:
            extreme = y
        elif direction * (extreme - y) > turn:
            level = extreme - direction * _extreme(max(near, 1), sigma)
            way += abs(level - begin)
            direction, begin, extreme, near, moves = -direction, level, y, 1, moves + 1
    if moves:
        way += abs(extreme - direction * _extreme(max(near, 1), sigma) - begin)
    return moves, way
