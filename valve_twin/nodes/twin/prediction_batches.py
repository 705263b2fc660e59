# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Collect predictions of single samples until they fill a message.

A series holds samples of one cycle and one model without a gap, so its stamps follow from the
first one and the period. Where it begins and ends depends on the data alone, unless the stream
stops: then it leaves after a time on the steady clock.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.gaps import gap_ns
from valve_twin.core.types import cut_block, join_blocks

if TYPE_CHECKING:
    from valve_twin.core.types import Prediction


class PredictionBatches:
    """Predictions on their way out.

    Parameters
    ----------
    batch_s : float
        Data time of a full series [s]; at least one sample.
    period_s : float
        Nominal sampling time [s].
    patience_s : float
        No sample is kept longer than this by the steady clock [s].
    """

    def __init__(self, batch_s: float, period_s: float, patience_s: float) -> None:
        self._most = max(round(batch_s / period_s), 1)
        self._gap_ns = gap_ns(period_s)
        self._patience_s = patience_s
        self._parts: list[Prediction] = []
        self._count = 0
        self._since_s = math.inf

    def __bool__(self) -> bool:
        """Return whether samples wait."""
        return bool(self._parts)

    @property
    def due_s(self) -> float:
        """When what waits has to leave, on the steady clock; infinite if nothing waits [s]."""
        return self._since_s + self._patience_s

    def add(self, prediction: Prediction, now_s: float) -> list[Prediction]:
        """Take a block; return the series that it completes, in order.

        Parameters
        ----------
        prediction : Prediction
            Samples of one cycle.
        now_s : float
            The steady clock [s].
        """
        stamps, full = prediction.stamp_ns, []
        gaps = np.flatnonzero(np.diff(stamps) > self._gap_ns) + 1
        for first, end in pairwise([0, *gaps.tolist(), len(stamps)]):
            if self._parts and not self._goes_on(prediction, int(stamps[first])):
                full += self.flush()
            at = first
            while at < end:
                count = min(end - at, self._most - self._count)
                if not self._parts:
                    self._since_s = now_s
                self._parts.append(cut_block(prediction, slice(at, at + count)))
                self._count += count
                at += count
                if self._count == self._most:
                    full += self.flush()
        return full

    def flush(self) -> list[Prediction]:
        """Return what waits, as one series or none, and forget it."""
        if not self._parts:
            return []
        parts, self._parts = self._parts, []
        self._count, self._since_s = 0, math.inf
        return [join_blocks(parts)]

    def _goes_on(self, prediction: Prediction, first_ns: int) -> bool:
        """Return whether samples from this stamp on belong to the series that waits."""
        last = self._parts[-1]
        same_sigma = last.residual_sigma == prediction.residual_sigma or (
            math.isnan(last.residual_sigma) and math.isnan(prediction.residual_sigma)
        )
        step_ns = first_ns - int(last.stamp_ns[-1])
        return (
            last.cycle == prediction.cycle
            and last.reproducible == prediction.reproducible
            and same_sigma
            and 0 < step_ns <= self._gap_ns
        )


def mean_period_s(prediction: Prediction, nominal_s: float) -> float:
    """Return the time between two samples of a series as its stamps say [s]."""
    stamps = prediction.stamp_ns
    if len(stamps) < 2:
        return nominal_s
    return int(stamps[-1] - stamps[0]) / (1e9 * (len(stamps) - 1))
