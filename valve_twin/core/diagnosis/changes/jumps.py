# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How far a valve has jumped by itself: what wanders or moves in steps does so before a change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
    count = len(along) - BESIDE + 1
    total = np.sum([along[k : count + k] for k in range(BESIDE)], axis=0)  # from each row on
    jump = np.abs(total[BESIDE:-1] - total[: -BESIDE - 1]) / BESIDE
    made[2 * BESIDE :] = _newest_largest(jump, window)
    return made


def _newest_largest(rows: FloatArray, window: int) -> FloatArray:
    """Return the largest of each of (N, S) rows, none below 0, and up to `window` - 1 before."""
    found, reach = rows, 1
    while reach < window:
        back = min(reach, window - reach, len(rows))
        found = np.concatenate((found[:back], np.maximum(found[back:], found[:-back])))
        reach += back
    return found
