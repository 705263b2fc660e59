# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a valve's own past is a reference: enough cycles, and its first ones like those since.

What was wrong from the first cycle on does not show in any comparison with the own past. What
began or ended in the first few cycles does, when these are compared with those that follow; but
not which of the two are right.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.detection import first_alarm, whitened

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import FloatArray, IntArray

_STEP = 8
"""Cycles after which the first ones are compared again: each look may err by chance."""


def doubt_of(
    cycles: IntArray,
    vectors: FloatArray,
    table: SignatureTable,
    config: DetectionConfig | None = None,
) -> str:
    """Return why the cycles of one product are no reference, empty where they are.

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

    Returns
    -------
    str
        One line. Once the first cycles were found to differ, they do in every longer history.
    """
    config = config or DetectionConfig()
    if len(cycles) < config.settled:
        return (
            f"no reference yet: {len(cycles)} of {config.settled} cycles of this product, "
            "from which on a fault would show"
        )
    most = config.learn + config.recent
    for count in range(config.settled, min(len(cycles), most) + 1, _STEP):
        last = _last_unlike(vectors[:count], table, config)
        if last:
            return (
                f"no reference: cycles {cycles[0]} to {cycles[last - 1]} differ from those since, "
                "and only a record from commissioning or a sister valve tells which are right"
            )
    return ""


def _last_unlike(vectors: FloatArray, table: SignatureTable, config: DetectionConfig) -> int:
    """Return how many of the first cycles lie off the line through those that follow, 0 = none."""
    known = min(config.learn, max(len(vectors) - config.recent, config.least))
    back = vectors[::-1].copy()
    view = whitened(back, known, len(back), table, config)
    alarm = first_alarm(*view, config, first=len(back) - config.recent)
    return len(back) - alarm[1] if alarm is not None else 0
