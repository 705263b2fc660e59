# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a fault is over: the features are back where they were before it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.watch.straight import Lines
    from valve_twin.core.types import BoolArray, FloatArray

_LEAST_BEFORE = 2
"""Fewest first cycles that say what was before, assumed."""

_LEAST_SINCE = 2
_MOST_SINCE = 8
"""Cycles behind the change that must be like the first ones, assumed."""

_LAST = 3
"""Cycles just before the change that it is measured against, assumed."""

_FAR = 5.0
"""Distance between the two states below which single cycles do not tell them [deviations]."""

_LEAST_FAR = 2.0
"""The same in deviations that hold the fault itself, assumed."""

_BETWEEN = 0.8
"""Share of the cycles in between that must be in the other state, assumed [1]."""

_NEAR = 0.3
"""Share of that distance by which first and last may differ, along it, assumed [1]."""

_BESIDE = 0.5
"""The same in all other directions, beside chance [1]."""


def healed(
    w: FloatArray,
    ray: FloatArray,
    before: Lines,
    config: DetectionConfig,
    alarm: int,
    near: BoolArray | None = None,
) -> int:
    """Return the first row at which `heal` cycles since the alarm are back on the line, or -1.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    ray : (F,) array
        Whitened signature of the fault, of length 1 [1].
    before : Lines
        The line before it.
    config : DetectionConfig
        How many cycles, and for how long the line is a measure.
    alarm : int
        Row of the alarm.
    near : (N,) bool array, optional
        Which rows may be back: few cycles before let a valve seem to scatter as much as the fault
        shows, see `changes.beyond.nearer_before`.
    """
    rows = np.arange(alarm + 1, min(alarm + 1 + config.extrapolate, len(w)))
    if len(rows) < config.heal:
        return -1
    line, variance = before.at(rows.astype(np.float64))
    if before.count[0] < config.settled:  # the slope of few cycles leads anywhere
        line, variance = before.level, 1.0 / before.count
    each = np.abs((w[rows] - line) @ ray) / np.sqrt(1.0 + variance)
    back = ((each < config.each) & (near is None or near[rows])).astype(np.int64)
    run = np.convolve(back, np.ones(config.heal, dtype=np.int64), mode="valid")
    hits = np.flatnonzero(run == config.heal)
    return int(rows[hits[0] + config.heal - 1]) if len(hits) else -1


def jumped_back(w: FloatArray, onset: int, alarm: int, config: DetectionConfig) -> int:
    """Return the first row at which `heal` cycles have jumped back by what a change was, or -1.

    Aging goes on beside a fault: its end is a jump back, though not to where it began.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    onset, alarm : int
        First row of the change, and that of its alarm.
    config : DetectionConfig
        How many cycles, and for how long a fault may end so.
    """
    last = min(alarm + config.extrapolate, len(w) - config.heal)
    before = w[max(onset - _LAST, 0) : onset].mean(axis=0)
    for row in range(max(alarm, onset + _LEAST_SINCE) + 1, last + 1):
        since = w[onset + 1 : row][:_LAST] - before
        way = since.mean(axis=0)
        far = float(np.linalg.norm(way))
        if far < _FAR:
            continue
        lately = w[row - _LAST : row]
        middle = lately.mean(axis=0)
        each = w[row : row + config.heal] - middle
        along = each @ way / far**2  # -1 = back by as much
        if along.max() >= -0.5 or along.mean() >= _NEAR - 1.0:  # as in nearly all rows
            continue
        between = (w[onset + 1 : row] - before) @ way > 0.5 * far**2
        outlier = (middle - np.median(lately, axis=0)) @ way / far**2  # one is no end
        left = each.mean(axis=0) + way
        chance = w.shape[1] * (2.0 / _LAST + 1.0 / len(since) + 1.0 / config.heal)
        like = float(left @ left) < (_BESIDE * far) ** 2 + 2.0 * chance
        like &= bool(between.mean() >= _BETWEEN)
        if like and along.max() + max(outlier, 0.0) < -0.5:
            return row + config.heal - 1
    return -1


def over(stale: BoolArray, alarm: int, config: DetectionConfig) -> int:
    """Return the first row after the alarm that ends `heal` rows without, or -1.

    Parameters
    ----------
    stale : (N,) array
        Whether a row shows the fault.
    alarm : int
        Row of the alarm.
    config : DetectionConfig
        How many cycles.
    """
    run = 0
    for row in range(alarm + 1, len(stale)):
        run = 0 if stale[row] else run + 1
        if run == config.heal:
            return row
    return -1


def first_alike(w: FloatArray, onset: int) -> int:
    """Return how many of the first cycles are like those since a change, 0 = they are not.

    A fault of the first few cycles is part of what later ones are compared with, and its end
    looks like a change. It is the end where the very first cycles are like those that follow,
    and those in between are not.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    onset : int
        First row of the change.
    """
    since = w[onset + 1 : onset + 1 + _MOST_SINCE]
    if onset < 2 * _LEAST_BEFORE or len(since) < _LEAST_SINCE:
        return 0
    now = since.mean(axis=0)
    way = now - w[max(onset - _LAST, _LEAST_BEFORE) : onset].mean(axis=0)
    far = float(np.linalg.norm(way))
    if far < _LEAST_FAR:
        return 0
    along = (w[:onset] - now) @ way / far**2  # 0 = like those since, -1 = like those between
    first = int(np.argmax(np.append(np.abs(along) >= 0.5, True)))
    between = along[first + 1 :]
    if first < _LEAST_BEFORE or len(between) < 1 or np.mean(between < -0.5) < _BETWEEN:
        return 0
    parts = (along[:first], between, (since - now) @ way / far**2)
    scatter = float(np.sqrt(np.mean(np.concatenate([p - p.mean() for p in parts]) ** 2)))
    if _FAR * scatter > 1.0:  # the scatter that `w` is told in holds the fault itself
        return 0
    left = w[:first].mean(axis=0) - now
    chance = w.shape[1] * (1.0 / first + 1.0 / len(since))
    near = abs(float(along[:first].mean())) < _NEAR
    return first if near and float(left @ left) < (_BESIDE * far) ** 2 + 2.0 * chance else 0


def first_unlike(w: FloatArray, onset: int) -> int:
    """Return how many of the first cycles differ from all others up to now, 0 = none.

    What the first few cycles do bends the line that the next ones are compared with: these seem
    to change some cycles later, though all of them are alike.

    Parameters
    ----------
    w : (N, F) array
        Whitened features [standard deviations].
    onset : int
        First row of what seems to be a change.
    """
    since = w[onset + 1 : onset + 1 + _MOST_SINCE]
    best = (0.0, 0)
    for k in range(_LEAST_BEFORE, onset - _LAST if len(since) >= _LEAST_SINCE else 0):
        between = w[k:onset]
        gap = since.mean(axis=0) - between.mean(axis=0)
        same = float(gap @ gap) / (1.0 / len(since) + 1.0 / len(between))
        now = np.vstack((between, since)).mean(axis=0)
        way = w[:k].mean(axis=0) - now
        far = float(np.linalg.norm(way))
        if far < _FAR or same > w.shape[1] + 3.0 * np.sqrt(2.0 * w.shape[1]):
            continue
        apart = (w[:k] - now) @ way > 0.5 * far**2
        alike = (between - now) @ way < 0.5 * far**2
        if apart.all() and np.mean(alike) >= _BETWEEN:
            best = max(best, (far**2 * k * len(between) / (k + len(between)), k))
    return best[1]
