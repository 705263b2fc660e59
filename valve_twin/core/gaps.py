# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Missing samples: where they are and how many."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, IntArray

GAP_PERIODS = 1.5
"""A step between two stamps above this many periods is a gap: at least one sample is missing."""


def find_gaps(stamp_ns: IntArray, period_s: float) -> BoolArray:
    """Return (N,) bool: a sample is missing before this one, or its stamp does not advance.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    period_s : float
        Nominal sampling time [s].
    """
    gap = np.zeros(len(stamp_ns), bool)
    step = np.diff(stamp_ns)
    gap[1:] = (step > GAP_PERIODS * period_s * 1e9) | (step <= 0)
    return gap


def count_lost(stamp_ns: IntArray, period_s: float) -> int:
    """Return how many samples are missing in the gaps between N stamps.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps, increasing [ns].
    period_s : float
        Nominal sampling time [s].
    """
    steps = np.diff(stamp_ns) / (period_s * 1e9)
    return int(np.rint(steps[steps > GAP_PERIODS] - 1.0).sum())
