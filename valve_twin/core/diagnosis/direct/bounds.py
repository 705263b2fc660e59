# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A number of a cycle that no sound valve shows: it needs no past to be compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.finding import Finding
from valve_twin.core.diagnosis.table import BY_NAME, partner

if TYPE_CHECKING:
    from valve_twin.core.past.columns import Rows
    from valve_twin.core.types import FloatArray, IntArray

OFF_SEAT = "off_seat"
"""Name of the distance from the seat at rest, 0 where the configuration allows it [1]."""

WEAK_SMALL = "weak_small"
"""Name of the share of its effect that a small command lacks against a large one [1]."""

_CONFIRM = 3
"""Cycles in a row that must show it, and that must not before it is over."""


def beyond(cycles: IntArray, excess: FloatArray, fault: str) -> list[Finding]:
    """Find the times in which cycles show what no sound valve does.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising.
    excess : (N,) array
        What is too much [unit of the fault's size]; 0 = nothing, NaN = the cycle does not tell.
    fault : str
        Name of the fault that it is.

    Returns
    -------
    list of Finding
        Oldest first.
    """
    known = np.isfinite(excess)
    numbers, value = cycles[known], excess[known]
    found: list[Finding] = []
    if not value.any():
        return found
    since, run = -1, 0
    for row, shown in enumerate(value != 0.0):
        run = run + 1 if shown == (since < 0) else 0
        if run < _CONFIRM:
            continue
        first = row - _CONFIRM + 1
        if since < 0:
            since, run = first, 0
            continue
        found.append(_found(numbers, value, fault, slice(since, first), int(numbers[row])))
        since, run = -1, 0
    if since >= 0:
        found.append(_found(numbers, value, fault, slice(since, None), -1))
    return found


def over(cycles: IntArray, excess: FloatArray, finding: Finding) -> int:
    """Return the cycle at which what `beyond` found long ago is over, -1 = it lasts.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers, rising; those before the alarm do not count.
    excess : (N,) array
        As for `beyond`.
    finding : Finding
        What was found.
    """
    run = 0
    later = np.isfinite(excess) & (cycles > finding.alarm)
    for number, value in zip(cycles[later].tolist(), excess[later].tolist(), strict=True):
        run = run + 1 if value == 0.0 else 0
        if run == _CONFIRM:
            return int(number)
    return -1


def odd(shown: Rows) -> str:
    """Return what the newest cycle shows that no sound valve does, or "".

    A single value that repeats is none such: rounding and a lost sample do that, too.

    Parameters
    ----------
    shown : Rows
        Features of the cycles, a cycle a row.
    """
    newest = shown.take(np.array([len(shown) - 1]))
    values = {"sensor_offset": OFF_SEAT, "dead_band": WEAK_SMALL}
    names = [f for f, n in values.items() if np.nan_to_num(newest.value(n)[0]) != 0.0]
    what = f"cycle {int(newest.cycle[0])} shows what no sound valve does"
    return f"{what} ({BY_NAME[names[0]].text})" if names else ""


def _found(numbers: IntArray, value: FloatArray, fault: str, rows: slice, end: int) -> Finding:
    """Return the finding of some rows."""
    return Finding(
        fault,
        tuple(filter(None, (partner(fault),))),
        BY_NAME[fault].part,
        float(np.median(value[rows])),
        float("nan"),
        int(numbers[rows.start]),
        int(numbers[rows.start + _CONFIRM - 1]),
        end,
    )
