# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a valve's own past is a reference: enough cycles, and its first ones like those since.

What was wrong from the first cycle on does not show in any comparison with the own past. What
began or ended in the first few cycles does, when these are compared with those that follow; but
not which of the two are right.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.lines import filled, rays_of_steps
from valve_twin.core.diagnosis.watch.alarm import Whitened, first_alarm, known_by

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.diagnosis.lines import Rays
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray, IntArray

YET = "no reference yet"
"""With what the reason begins where more cycles are needed."""

_STEP = 8
"""Cycles after which the first ones are compared again: each look may err by chance."""

_FEW = 10
"""Fewest cycles that may be a reference: as many as a trend needs."""

_FEW_BESIDE = 8
"""The same where the scatter is known from other products."""

_LEAST_FIRST = 2
"""Fewest first cycles that are held against the rest."""

_STEP_SHOWN = 4.5
"""Standard deviations of a step that withholds the reference; set on strangers [1]."""

_STEP_WITHDRAWS = 8.0
"""Standard deviations of a step that withdraws it again; set on strangers [1]."""

_SUDDEN = 0.7
"""Share of a step by which the cycles on its either side must differ: aging is none [1]."""

_BESIDE = 3
"""Cycles on either side of a step that show it."""


def doubt_of(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig | None = None,
    *,
    others: Sequence[FloatArray] | None = None,
) -> str:
    """Return why the cycles of one product are no reference, empty where they are.

    Where `others` are given, fewer than `settled` cycles are enough if none of them, first or
    last, differ from the rest by a sudden step: a change of all states that the cycles are
    compared with would show as one.

    Parameters
    ----------
    cycles : (N,) int64 array
        Cycle numbers since start or maintenance, rising.
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig, optional
        When to speak.
    others : sequence of (M, F) arrays, optional
        Features of the cycles of all other products: from step to step they scatter alike.

    Returns
    -------
    str
        One line. Once the first cycles were found to differ, they do in every longer history.
    """
    config = config or DetectionConfig()
    if len(cycles) < config.settled:
        if others is not None and _is_steady(vectors, others, table, config):
            return ""
        return (
            f"{YET}: {len(cycles)} of {config.settled} cycles of this product, "
            "from which on a fault would show"
        )
    most = config.learn + config.recent
    for count in range(config.settled, min(len(cycles), most) + 1, _STEP):
        last = _last_unlike(vectors[:count], table, config)
        if last:
            return (
                f"no reference: cycles {cycles[0]} to {cycles[last - 1]} differ from those since, "
                "and nothing tells which are right: look at the valve, then mark maintenance"
            )
    return ""


def _is_steady(
    vectors: FloatArray,
    others: Sequence[FloatArray],
    table: SignatureTable,
    config: DetectionConfig,
) -> bool:
    """Return whether few cycles of a product show no sudden step.

    Once that is said, it takes a larger one to withdraw it: each look may err by chance.
    """
    known = sum(len(o) for o in others)
    beside = [o for o in others if len(o) > 1]
    steady = False
    for count in range(_FEW_BESIDE if known >= config.settled else _FEW, len(vectors) + 1):
        rays = rays_of_steps([vectors[:count], *beside], table, config)
        step = _largest_step(rays.along(rays.whitened(filled(vectors[:count], config.least))))
        steady = step < (_STEP_WITHDRAWS if steady else _STEP_SHOWN)
        steady = steady and _would_show(rays, table, count)
    return steady


def _would_show(rays: Rays, table: SignatureTable, count: int) -> bool:
    """Return whether medium faults of at least half of the kinds would show in two cycles."""
    length = np.linalg.norm(rays.changes, axis=1) * np.sqrt(2.0 * (count - 2) / count)
    medium = [
        np.median([length[k] for k, s in enumerate(table.signatures) if s.fault == fault])
        for fault in table.faults
    ]
    return float(np.median(medium)) > _STEP_SHOWN


def _largest_step(shown: FloatArray) -> float:
    """Return the largest sudden step between some first of (N, S) cycles and the rest [1].

    Any number of first cycles is held against the rest along every signature.
    """
    count, largest = len(shown), 0.0
    total = np.cumsum(shown, axis=0)
    for k in range(_LEAST_FIRST, count):
        gap = (total[-1] - total[k - 1]) / (count - k) - total[k - 1] / k
        beside = shown[k : k + _BESIDE].mean(axis=0) - shown[max(k - _BESIDE, 0) : k].mean(axis=0)
        sudden = beside * np.sign(gap) > _SUDDEN * np.abs(gap)
        far = np.where(sudden, np.abs(gap), 0.0).max() * np.sqrt(k * (count - k) / count)
        largest = max(largest, float(far))
    return largest


@kept
def _last_unlike(vectors: FloatArray, table: SignatureTable, config: DetectionConfig) -> int:
    """Return how many of the first cycles lie off the line through those that follow, 0 = none."""
    back = vectors[::-1].copy()
    seen = Whitened(back, known_by(len(back), config), table, config)
    alarm = first_alarm(seen, config, first=len(back) - config.recent)
    return len(back) - alarm[1] if alarm is not None else 0
