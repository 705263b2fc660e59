# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A sensor that repeats values while the position moves on: no past is needed to see that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import Finding

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

MISSED, DUE = "missed", "due"
"""Names of the counts of a cycle: values that the sensor repeated in motion, and those it owed."""

_RECENT = 8
"""Cycles whose counts are added up."""

_LEAST = 2
"""Values left out in these cycles that are no chance: one in 8 cycles may be."""

_HEAL = 5
"""Cycles without any after which it is over: it must be twice what the share makes likely."""

_FEW = 3.0
"""Values that would have been left out by now, if it lasted, before it counts as over."""


def freezing(cycles: IntArray, missed: FloatArray, due: FloatArray) -> list[Finding]:
    """Find the times in which a sensor froze for single values.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    missed, due : (N,) arrays
        Values that it repeated in motion, and values that it owed [1]; NaN where unknown.

    Returns
    -------
    list of Finding
        Oldest first; the size is the share of the values.
    """
    lost, owed = np.nan_to_num(missed), np.nan_to_num(due)
    found: list[Finding] = []
    some = np.append(np.flatnonzero(lost), len(cycles))  # rows that may be the alarm
    row = int(some[0])
    while row < len(cycles):
        since = max(row - _RECENT + 1, 0 if not found else _row_of(cycles, found[-1].end))
        recent = slice(since, row + 1)
        if lost[recent].sum() < _LEAST or not lost[row]:
            row = int(some[np.searchsorted(some, row + 1)])
            continue
        onset = since + int(np.flatnonzero(lost[recent])[0])
        share = lost[onset : row + 1].sum() / max(owed[onset : row + 1].sum(), 1.0)
        end = _over(lost, owed, float(share), row)
        stop = len(lost) if end < 0 else end - _HEAL + 1
        share = float(lost[onset:stop].sum() / max(owed[onset:stop].sum(), 1.0))
        last = int(cycles[end]) if end >= 0 else -1
        sure = float(np.sqrt(lost[onset:stop].sum() / max(np.count_nonzero(lost[onset:stop]), 1)))
        found.append(
            Finding(
                "sensor_freeze",
                (),
                "sensor",
                share,
                sure,
                int(cycles[onset]),
                int(cycles[row]),
                last,
            )
        )
        row = len(cycles) if end < 0 else end + 1
    return found


def over(cycles: IntArray, missed: FloatArray, due: FloatArray, finding: Finding) -> int:
    """Return the cycle at which freezing that was found long ago is over, -1 = it lasts.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising; those before the alarm do not count.
    missed, due : (N,) arrays
        As for `freezing`.
    finding : Finding
        What was found.
    """
    later = cycles > finding.alarm
    lost, owed = np.nan_to_num(missed[later]), np.nan_to_num(due[later])
    end = _over(lost, owed, finding.severity, -1)
    return int(cycles[later][end]) if end >= 0 else -1


def _row_of(cycles: IntArray, cycle: int) -> int:
    return int(np.searchsorted(cycles, cycle)) + 1


def _over(lost: FloatArray, owed: FloatArray, share: float, alarm: int) -> int:
    """Return the first row behind enough cycles and values without one left out, or -1."""
    last, due = alarm, 0.0
    for row in range(alarm + 1, len(lost)):
        if lost[row]:
            last, due = row, 0.0
            continue
        due += owed[row]
        if row - last >= _HEAL and share * due > _FEW:
            return row
    return -1
