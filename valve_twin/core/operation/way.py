# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The way of a valve after a command: what stroke tests and production steps have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

HELD = 0.02
"""Share of a command's range within which it counts as held [1], assumed."""

LEAST_SAMPLES = 10
"""Least samples of a rest [1], assumed."""

LEFT_SIGMAS = 5.0
"""Least way that has left a rest [standard deviations of the noise], assumed."""

WINDOW = 5
"""Length of the moving median [samples]."""

END = 0.2
"""Share of a rest, at its end, that tells its level [1], assumed."""


def end_of(way: FloatArray, least: int = WINDOW) -> FloatArray:
    """Return the samples that tell the level at which a rest ends, a view.

    Parameters
    ----------
    way : (N,) array
        Positions of the rest [any unit].
    least : int
        How many they are at least, where there are as many.
    """
    return way[-max(round(END * len(way)), least) :]


def smooth_way(way: FloatArray) -> FloatArray:
    """Return the moving median, (N,): no single sample is a movement."""
    half = WINDOW // 2
    padded = np.concatenate([np.repeat(way[0], half), way, np.repeat(way[-1], half)])
    return np.asarray(np.median(sliding_window_view(padded, WINDOW), axis=1))
