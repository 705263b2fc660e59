# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What one cycle alone says: a fault beyond what the past could give, or that one more is due."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.lines import Rays
    from valve_twin.core.diagnosis.watch.straight import Lines, Sums
    from valve_twin.core.types import FloatArray, IntArray

_TAIL = 3.0
"""Power by which the chance of a large deviation falls, assumed: less than that no variance is."""

_LEAST_PAST = 8
"""Fewest cycles before, each held against its own line, whose largest deviation says something."""

_LASTS = 0.5
"""Share of a change that the cycles behind must show for it to last [1]."""


class Alone:
    """Finds rows that are a fault by themselves, as they come.

    Of n healthy cycles the largest deviation is passed by one more with a chance of about 1 / n;
    a deviation x times as large has one less by x to the power of the tail.

    Parameters
    ----------
    config : DetectionConfig
        When to speak: `alone` is the chance.
    """

    def __init__(self, config: DetectionConfig) -> None:
        self._config, self._next, self._largest = config, config.least, -np.inf

    def first(self, w: FloatArray, past: Sums, rays: Rays, *, first: int) -> int:
        """Return the first row that is one, of those not looked at before, -1 = none.

        Parameters
        ----------
        w : (N, F) array
            Whitened features [standard deviations].
        past : Sums
            Of the same without outliers.
        rays : Rays
            Whitened signatures.
        first : int
            First row that may be one.
        """
        config = self._config
        rows = np.arange(self._next, len(w))
        if not config.alone or not len(rows):
            return -1
        off = _off(w, past, rays, config, rows)
        largest = np.maximum.accumulate(np.append(self._largest, off))
        self._next, self._largest = len(w), float(largest[-1])
        before = rows - config.least
        limit = largest[:-1] * np.maximum(before * config.alone, 1e-12) ** (-1.0 / _TAIL)
        beyond = off > np.maximum(limit, np.sqrt(config.threshold))
        found = rows[beyond & (rows >= first) & (before >= _LEAST_PAST)]
        return int(found[0]) if len(found) else -1


def departs(w: FloatArray, past: Sums, rays: Rays, config: DetectionConfig) -> float:
    """Return how far the newest cycle lies off those before it, 0 = not so far that it counts.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    past : Sums
        Of the same without outliers.
    rays : Rays
        Whitened signatures.
    config : DetectionConfig
        When to speak: `departs` is the least.
    """
    if not config.departs:
        return 0.0
    far = float(_off(w, past, rays, config, np.array([len(w) - 1]))[0])
    return far if far > config.departs else 0.0


def _off(
    w: FloatArray, past: Sums, rays: Rays, config: DetectionConfig, rows: IntArray
) -> FloatArray:
    """Return how far each of some rows lies off the line before it, along any signature."""
    line, variance = past.lines(rows - 1, config.window).at(rows.astype(np.float64))
    along = rays.along((w[rows] - line) / np.sqrt(1.0 + variance)[:, None])
    return np.asarray(along.max(axis=1), dtype=np.float64)


def passed(w: FloatArray, rays: Rays, before: Lines, onset: int, rows: IntArray) -> bool:
    """Return whether the cycles behind one that raised an alarm do not show what it showed.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    rays : Rays
        Whitened signatures.
    before : Lines
        The line before it.
    onset : int
        Its row.
    rows : (K,) int array
        Those behind it.
    """
    line = before.at(np.array([onset, rows.mean()], dtype=np.float64))[0]
    alone, behind = rays.along(np.stack((w[onset], w[rows].mean(axis=0))) - line)
    shown = int(np.argmax(alone))
    return bool(behind[shown] < _LASTS * alone[shown])
