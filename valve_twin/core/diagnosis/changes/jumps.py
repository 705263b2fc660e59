# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far a valve has jumped by itself: what wanders or moves in steps does so before a change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

BEYOND = 1.5
"""Times the largest jump made before that a change must be; set on strangers [1]."""

BESIDE = 3
"""Cycles on either side of a jump."""


def jumps_made(along: FloatArray, window: int) -> FloatArray:
    """Return the largest jump, either way, that a valve made just before each cycle.

    Parameters
    ----------
    along : (N, S) array
        How far its cycles lie along each signature, without outliers [standard deviations].
    window : int
        Most jumps that count [1].

    Returns
    -------
    (N, S) array
        Means of three cycles less those of the three before [standard deviations], 0 where there
        was none yet; the cycle itself and those behind it have no part in it.
    """
    made = np.zeros_like(along)
    if len(along) <= 2 * BESIDE:
        return made
    last = np.arange(2 * BESIDE, len(along))
    total = np.concatenate((np.zeros((1, along.shape[1])), np.cumsum(along, axis=0)))
    before, middle, after = total[last - 2 * BESIDE], total[last - BESIDE], total[last]
    jump = np.abs(after - 2.0 * middle + before) / BESIDE
    begun = np.concatenate((np.zeros((window - 1, jump.shape[1])), jump))
    made[last] = sliding_window_view(begun, window, axis=0).max(axis=-1)
    return made
