# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Missing samples: where they are and how many."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, IntArray

GAP_PERIODS = 1.5
"""A step between two stamps above this many periods is a gap: at least one sample is missing."""

PAUSE_S, PAUSE_PERIODS = 1.0, 20.0
"""A silence of at least both is a pause of the recording, not a loss of samples (assumed)."""

PERIOD_TOLERANCE = 0.1
"""How far the median step of the stamps may be off the sampling time, relative (assumed)."""


def gap_ns(period_s: float) -> float:
    """Return the step between two stamps above which a sample is missing [ns]."""
    return GAP_PERIODS * period_s * 1e9


def find_gaps(stamp_ns: IntArray, period_s: float) -> BoolArray:
    """Return (N,) bool: a sample is missing before this one, or its stamp does not advance.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    period_s : float
        Nominal sampling time [s].
    """
    gap = np.zeros(len(stamp_ns), np.bool_)
    mark_gaps(np.ascontiguousarray(stamp_ns), gap_ns(period_s), gap)
    return gap


def extreme_steps(stamp_ns: IntArray) -> tuple[int, int]:
    """Return the least and the greatest step between N stamps [ns]; (0, 0) for fewer than two."""
    if len(stamp_ns) < 2:
        return 0, 0
    least, most = _extremes(np.ascontiguousarray(stamp_ns))
    return int(least), int(most)


@njit(cache=True)
def mark_gaps(stamp_ns: IntArray, limit_ns: float, gap: BoolArray) -> None:
    """Set flags where the step to a stamp is too long, or is none forward.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    limit_ns : float
        Longest step without a gap [ns].
    gap : (N,) bool array
        Set but for the first.
    """
    for i in range(1, len(stamp_ns)):
        step = stamp_ns[i] - stamp_ns[i - 1]
        gap[i] = step > limit_ns or step <= 0


@njit(cache=True)
def _extremes(stamp_ns: IntArray) -> tuple[int, int]:
    least = most = stamp_ns[1] - stamp_ns[0]
    for i in range(2, len(stamp_ns)):
        step = stamp_ns[i] - stamp_ns[i - 1]
        least, most = min(least, step), max(most, step)
    return least, most


@njit(cache=True)
def delays(log_ns: IntArray, stamp_ns: IntArray) -> tuple[int, int, bool]:
    """Return the least and the greatest delay of N > 0 samples [ns], and whether stamps rise.

    Parameters
    ----------
    log_ns, stamp_ns : (N,) int64 arrays
        When each was recorded, and its stamp [ns].
    """
    least = most = log_ns[0] - stamp_ns[0]
    rises = True
    for i in range(1, len(stamp_ns)):
        delay = log_ns[i] - stamp_ns[i]
        least, most = min(least, delay), max(most, delay)
        rises = rises and stamp_ns[i] > stamp_ns[i - 1]
    return least, most, rises


class GapCounter:
    """Counts the samples that are missing in a stream of stamps that comes in blocks.

    Parameters
    ----------
    period_s : float
        Nominal sampling time [s].
    """

    def __init__(self, period_s: float) -> None:
        self._period_ns = period_s * 1e9
        self._limit_ns = round(gap_ns(period_s))
        self._last_ns: int | None = None
        self.missing = 0
        self.longest_s = 0.0

    def push(self, stamp_ns: IntArray) -> None:
        """Take the next stamps.

        Parameters
        ----------
        stamp_ns : (N,) int64 array
            Stamps, N > 0 [ns].
        """
        first, last = int(stamp_ns[0]), int(stamp_ns[-1])
        if self._last_ns is not None and first - self._last_ns > self._limit_ns:
            self._count(first - self._last_ns)
        if last - first > self._limit_ns:
            steps = np.diff(stamp_ns)
            for step in steps[steps > self._limit_ns]:
                self._count(int(step))
        self._last_ns = last

    def restart(self) -> None:
        """Begin anew after the clock was set back; the counts stay."""
        self._last_ns = None

    def _count(self, step_ns: int) -> None:
        self.missing += max(round(step_ns / self._period_ns) - 1, 1)
        self.longest_s = max(self.longest_s, 1e-9 * step_ns)


def count_lost(stamp_ns: IntArray, period_s: float) -> int:
    """Return how many samples are missing in the gaps between N stamps.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps, increasing [ns].
    period_s : float
        Nominal sampling time [s].
    """
    if extreme_steps(stamp_ns)[1] <= gap_ns(period_s):
        return 0
    steps = np.diff(stamp_ns) / (period_s * 1e9)
    return int(np.rint(steps[steps > GAP_PERIODS] - 1.0).sum())


def count_paused(stamp_ns: IntArray, period_s: float) -> int:
    """Return how many of the samples that `count_lost` counts are missing in pauses.

    A pause is a silence of at least `PAUSE_S` and `PAUSE_PERIODS`, as between two files.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps, increasing [ns].
    period_s : float
        Nominal sampling time [s].
    """
    least_ns = 1e9 * max(PAUSE_S, PAUSE_PERIODS * period_s)
    if extreme_steps(stamp_ns)[1] < least_ns:
        return 0
    steps = np.diff(stamp_ns)
    return int(np.rint(steps[steps >= least_ns] / (period_s * 1e9) - 1.0).sum())
