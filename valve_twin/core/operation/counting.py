# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled passes of the counters: ways between levels, and how long the valve was open."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray


@njit(cache=True)
def walk(
    levels: FloatArray,
    level: float,
    direction: int,
    begin: float,
    edges: FloatArray,
    spans: FloatArray,
    found: IntArray,
) -> tuple[int, int, float, float]:
    """Move on from the level reached to others, one after the other.

    Parameters
    ----------
    levels : (M,) array
        Where the movements end [unit of the position].
    level, begin : float
        Where the movement under way has come to, and where it began [unit of the position].
    direction : int
        Of the movement under way, 1 or -1; 0 = none yet.
    edges : (B,) array
        Lower edges of the bins of spans [unit of the position]; the last bin has no end.
    spans : (M,) array
        Gets the spans of the movements that were completed [unit of the position].
    found : (B,) int64 array
        Gets how many these are by bin, added to what it holds.

    Returns
    -------
    int, int, float, float
        Movements completed; direction, begin and level of the one that is under way now.
    """
    count = 0
    for i in range(len(levels)):
        if levels[i] == level:
            continue
        way = 1 if levels[i] > level else -1
        if direction == -way:
            span = abs(level - begin)
            k = len(edges) - 1
            while k > 0 and not edges[k] <= span:
                k -= 1
            found[k] += 1
            spans[count] = span
            begin, count = level, count + 1
        direction, level = way, levels[i]
    return count, direction, begin, level


@njit(cache=True)
def open_times(
    position: FloatArray, held: IntArray, ends: tuple[float, float], limits: tuple[float, float]
) -> tuple[int, int, int]:
    """Return how long a valve was anywhere, closed, and near closed [ns].

    Parameters
    ----------
    position, held : (N,) array, (N,) int64 array
        Position [its unit], and how long each was held [ns].
    ends : tuple of float
        The closed end, and the way to the open one [unit of the position].
    limits : tuple of float
        Up to which share of that way it is closed, and below which it is near [1].
    """
    total = shut = low = 0
    for i in range(len(position)):
        share = abs(position[i] - ends[0]) / ends[1]  # opens either way, perhaps
        total += held[i]
        if share <= limits[0]:
            shut += held[i]
        if share < limits[1]:
            low += held[i]
    return total, shut, low


@njit(cache=True)
def believed(
    position: FloatArray,
    valid: BoolArray,
    stamp_ns: IntArray,
    limit_ns: float,
    good: BoolArray,
    held: IntArray,
) -> int:
    """Tell which positions can be believed and how long each was held; return how many can.

    Parameters
    ----------
    position, valid, stamp_ns : (N,) array, (N,) bool array, (N,) int64 array
        Position [its unit], whether its frame is complete, its stamp [ns].
    limit_ns : float
        Step between stamps above which samples are missing [ns].
    good : (N,) bool array
        Overwritten: valid and finite.
    held : (N,) int64 array
        Overwritten: how long each was held; 0 before a gap, and at the end [ns].
    """
    count = 0
    for i in range(len(position)):
        good[i] = valid[i] and np.isfinite(position[i])
        count += good[i]
        step = stamp_ns[i + 1] - stamp_ns[i] if i + 1 < len(position) else 0
        held[i] = 0 if step > limit_ns else step
    return count
