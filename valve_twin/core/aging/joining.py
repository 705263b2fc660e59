# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Join straight pieces that one law of aging, or a law under a repeating wave, explains as well.

Straight pieces are found first (`core.aging.changepoint`). A trend that bends is then several of
them, and so is a line under teeth. For every tail of the pieces, up to the present, one law of
`core.aging.laws` is tried in their place, alone and with a wave (`core.aging.wave`), by the same
score as the pieces: n log(S (1 - rho^2)) plus penalties. What wins is one segment.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.changepoint import log_left, penalty
from valve_twin.core.aging.laws.fit import law_shape
from valve_twin.core.aging.laws.shapes import condense
from valve_twin.core.aging.trend import RESOLUTION, TINY, residuals
from valve_twin.core.aging.wave import Wave, find_waves
from valve_twin.core.estimation.data.one_thread import dot, rows_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray, IntArray

BEND = 0.5
"""Penalty of a law instead of a line, in those of one more piece [1], assumed."""

WAVE = 1.0
"""Penalty of a wave, in those of one more piece [1], assumed."""

EDGE = 2.0
"""Penalty of each edge of a tooth, which may move [twice the log-likelihood], assumed."""

LARGEST = 0.025
"""Largest wave, peak to peak, as a share of the level [1], assumed; larger steps are changes."""

_FEWEST_TEETH = 3  # pieces that a wave may explain
_MOST = 500  # values that a wave is sought in


@dataclass(frozen=True, slots=True)
class Joined:
    """How many of the first pieces stay as they are; the rest is one segment.

    Attributes
    ----------
    kept : int
        Pieces that stay, the last of them included where nothing was joined.
    wave : (N,) array
        What a wave adds to the values, zero outside the joined segment [unit].
    period : float
        Mean period of the wave [axis unit]; NaN where there is none.
    """

    kept: int
    wave: FloatArray
    period: float = float("nan")


def join(
    x: FloatArray,
    y: FloatArray,
    bounds: IntArray,
    *,
    laws: Sequence[str] = (),
    penalty_scale: float = 1.0,
) -> Joined:
    """Return which of the last pieces are one.

    Parameters
    ----------
    x, y : (N,) arrays
        Axis positions [axis unit] and values [unit] of one undisturbed stretch, no outliers.
    bounds : (K + 1,) int64 array
        Bounds of its straight pieces [1].
    laws : sequence of str
        Laws that are allowed; empty = all.
    penalty_scale : float
        Factor on `penalty` [1].
    """
    pieces = len(bounds) - 1
    none = np.zeros(len(x))
    if pieces < 2:
        return Joined(pieces, none)
    floor = len(x) * (RESOLUTION * float(np.abs(y).max())) ** 2 + TINY
    cost = penalty_scale * penalty(len(x))
    parts = [residuals(x[a:b], y[a:b]) for a, b in itertools.pairwise(bounds)]
    best = _score(np.concatenate(parts), floor) + (pieces - 1) * cost
    chosen = Joined(pieces, none)
    for kept in range(pieces - 1):
        tail = slice(bounds[kept], len(x))
        head = parts[:kept]
        shape, bent = law_shape(x[tail], y[tail], laws)
        extra = (kept + BEND * bent) * cost
        off = residuals(shape, y[tail])
        score = _score(np.concatenate([*head, off]), floor) + extra
        if score < best:
            best, chosen = score, Joined(kept, none)
        if pieces - kept < _FEWEST_TEETH:
            continue
        for wave, found in _waves(x[tail], y[tail], shape):
            shape, bent = law_shape(x[tail], y[tail] - wave, laws)
            off = residuals(shape, y[tail] - wave)
            extra = (kept + BEND * bent + WAVE) * cost + EDGE * len(found.turns) * found.toothed
            score = _score(np.concatenate([*head, off]), floor) + extra
            if score < best:
                whole = none.copy()
                whole[tail] = wave
                length = float(x[-1] - x[bounds[kept]])
                best, chosen = score, Joined(kept, whole, found.period * length)
    return chosen


def _waves(x: FloatArray, y: FloatArray, shape: FloatArray) -> list[tuple[FloatArray, Wave]]:
    """Return what each wave found adds to every value, (N,), and the wave itself."""
    length = float(x[-1] - x[0])
    place, values = condense(x, y, _MOST)
    shape_there = np.interp(place, x, shape)
    found = find_waves((place - x[0]) / length, values, shape_there)
    u = (x - x[0]) / length
    most = LARGEST * abs(float(y.mean()))
    waves = [(rows_times(wave.columns(u), size[:, None])[:, 0], wave) for wave, size in found]
    return [(added, wave) for added, wave in waves if np.ptp(added) <= most]


def _score(rest: FloatArray, floor: float) -> float:
    power = dot(rest, rest)
    return len(rest) * log_left(power, dot(rest[1:], rest[:-1]), floor)
