# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Samples of a tag in the messages that carry them: one each, or runs on the grid of a period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from valve_twin.nodes.opcua_source.tags import Sample

SHARE = 0.1
"""A stamp so far off the grid, as share of the period, begins another run, assumed [1]."""

JUMP_NS = 60_000_000_000
"""Stamps that go on by so much more than our clock since the batch before are those of a clock
that was set, not of samples that are missing, assumed [ns]."""


class Grid:
    """Counts and groups the samples of one tag.

    Parameters
    ----------
    period_s : float
        Sampling time of the tag [s]; 0 = not known: every sample for itself.

    Attributes
    ----------
    samples, masked, repeated : int
        Samples that came, those of them without a good value, and those that came again with the
        last stamp [1].
    missing, unheard : int
        Samples whose stamps are missing while connected, and those between two connections; not
        what a clock that was set jumps over [1].
    late : int
        Samples with an older stamp than the one before, but for the first of a connection [1].
    """

    def __init__(self, period_s: float) -> None:
        self._period_ns = period_s * 1e9
        self._last_ns = self._came_ns = 0
        self._connections = 0
        self._begins = False
        self.samples = self.masked = self.missing = self.unheard = self.repeated = 0
        self.late = 0

    def sorted(self, samples: Iterable[Sample], now_ns: int) -> Iterator[tuple[int, list[float]]]:
        """Yield runs: the stamp of the first sample [ns since 1970] and all values.

        A sample with the stamp of the one before is the same one: a server repeats the last value
        to whoever connects anew.

        Parameters
        ----------
        samples : iterable of Sample
            In the order in which they came.
        now_ns : int
            When they came; the stamp of a sample that has none [ns since 1970].
        """
        start_ns, values = 0, list[float]()
        most_ns = max(now_ns - (self._came_ns or now_ns), 0) + JUMP_NS
        for sample in samples:
            stamp_ns = sample.stamp_ns or now_ns
            self._connections += sample.first
            if sample.stamp_ns and stamp_ns == self._last_ns:
                self.repeated += 1
                self._begins = sample.first
                continue
            self._count(stamp_ns, sample, most_ns)
            self._came_ns = now_ns
            off_ns = stamp_ns - (start_ns + len(values) * self._period_ns)
            if values and (not self._period_ns or abs(off_ns) > SHARE * self._period_ns):
                yield start_ns, values
                values = []
            if not values:
                start_ns = stamp_ns
            values.append(sample.value)
        if values:
            yield start_ns, values

    def _count(self, stamp_ns: int, sample: Sample, most_ns: int) -> None:
        self.samples += 1
        self.masked += math.isnan(sample.value)
        self.late += stamp_ns < self._last_ns and not sample.first
        if self._period_ns and 0 < self._last_ns < stamp_ns <= self._last_ns + most_ns:
            gap = max(round((stamp_ns - self._last_ns) / self._period_ns) - 1, 0)
            if not (sample.first or self._begins):
                self.missing += gap
            elif self._connections > 1:
                self.unheard += gap
        self._begins = sample.first
        self._last_ns = stamp_ns
