# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A fault that lasts and is nothing beside what begins later: the greater one is told."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.lines import filled

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.diagnosis.changes.finding import Diagnosis
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray, IntArray

_TIMES = 10.0
"""By how many times a later change must exceed that of the fault, and what cycles scatter, root
mean square over the features, assumed [1]."""


def outgrown(
    found: Diagnosis,
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig,
    searched: Callable[[IntArray, FloatArray, SignatureTable, DetectionConfig], Diagnosis],
) -> Diagnosis:
    """Return what was found, its lasting fault over where a far greater change begins.

    A fault that lasts is the level for what comes after it, and nothing more was looked for: a
    doubtful one of three standard deviations hid another of three hundred for good.

    Parameters
    ----------
    found : Diagnosis
        As `searched` returns it for the same cycles.
    cycles : (N,) int64 array
        Cycle numbers, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature]; NaN where a cycle does not show one.
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        When to speak.
    searched : callable
        `detect`, with what else it is given.
    """
    if not found.findings or found.findings[-1].end >= 0:
        return found
    *others, last = found.findings
    onset = int(np.searchsorted(cycles, last.onset))
    leap = _leap(vectors, onset, table, config)
    if leap < 0:
        return found
    rest = np.r_[0:onset, leap : len(cycles)]
    again = searched(cycles[rest], vectors[rest], table, config)
    begun = int(cycles[leap])
    later = [f for f in again.findings if f.onset >= begun]
    if not later:
        return found
    return replace(found, findings=(*others, replace(last, end=begun), *later))


def _leap(vectors: FloatArray, onset: int, table: SignatureTable, config: DetectionConfig) -> int:
    """Return the first row behind a fault's first ones that lies far off those before it, or -1.

    So must those that confirm it. `vectors` (N, F), the fault since row `onset`.
    """
    first = onset + 1 + config.isolate
    if onset < config.least or first + config.confirm > len(vectors):
        return -1
    rows = filled(vectors, onset)
    before = rows[max(onset - config.learn, 0) : onset]
    scale = np.maximum(before.std(axis=0, ddof=1), table.least())
    rows = rows[:, scale > 0.0] / scale[scale > 0.0]
    middle = np.median(rows[onset + 1 : first], axis=0) - np.median(rows[:onset], axis=0)
    least = _TIMES * max(_rms(middle), 1.0)
    moved = np.sqrt(np.mean(np.diff(rows, axis=0) ** 2, axis=1))  # a leap is one from row to row
    for k in np.flatnonzero(moved > 0.5 * least) + 1:
        if not first <= k <= len(rows) - config.confirm:
            continue
        base = np.median(rows[max(k - config.recent, onset + 1) : k], axis=0)
        if all(_rms(row - base) > least for row in rows[k : k + config.confirm]):
            return int(k)
    return -1


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
