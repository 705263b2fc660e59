# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which cycle of a record raises the first alarm, while the record grows.

Each cycle is judged by what was known when it came: by lines through the cycles before it and by
the scatter of the first ones. A row that was judged is not judged again when more come, and what
a record says does not depend on how many of its rows came at a time, to the last bit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from valve_twin.core.diagnosis.changes.alone import Alone, departs
from valve_twin.core.diagnosis.changes.beyond import first_beyond, wandered
from valve_twin.core.diagnosis.changes.jumps import BESIDE, BEYOND, jumps_made
from valve_twin.core.diagnosis.changes.kept import kept
from valve_twin.core.diagnosis.watch.growing import begins
from valve_twin.core.diagnosis.watch.straight import follow
from valve_twin.core.diagnosis.watch.whitened import Whitened, known_by

if TYPE_CHECKING:
    from valve_twin.core.diagnosis.changes.finding import Finding
    from valve_twin.core.diagnosis.changes.match import Match
    from valve_twin.core.diagnosis.config import DetectionConfig
    from valve_twin.core.diagnosis.lines import Rays
    from valve_twin.core.diagnosis.table import SignatureTable
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

ABRUPT = 0.5
"""Share of a change by which the cycles behind its onset must lie off those just before it, since
what wanders away is no sudden change; and off the mean of few cycles: they are no line yet [1]."""

_OF_LARGEST = 0.3
"""Share of the largest deviation that another cycle must show: one outlier is no fault [1]."""

_TOLD = 1e-9
"""Least variance that is divided by, where no cycle shows anything of a signature [1]."""

_AT_A_TIME = 256  # rows that are judged together at first, before it is asked for an alarm

Alarm: TypeAlias = "tuple[int, int]"
"""Row that raised an alarm, and that of its onset."""


class Watch:
    """Judges rows as they come.

    Parameters
    ----------
    rays : Rays
        Whitened signatures.
    config : DetectionConfig
        When to speak.
    """

    def __init__(self, rays: Rays, config: DetectionConfig) -> None:
        self._config, self._along = config, np.ascontiguousarray(rays.rays.T)
        self._lengths = range(config.confirm, config.recent + 1)
        shape = (len(self._lengths), config.recent, len(rays.rays))
        self._squares = np.zeros(shape)  # sums up to each of the newest rows, by row modulo
        self._alone = Alone(config)
        self._next = 0

    def alarm(self, seen: Whitened, first: int) -> Alarm | None:
        """Return the first row that raises an alarm, of those not judged before and from `first`.

        Parameters
        ----------
        seen : Whitened
            All rows up to now.
        first : int
            First row that may raise one.
        """
        step = _AT_A_TIME
        while self._next < len(seen):
            found = self._alarm(seen, first, min(self._next + step, len(seen)))
            if found is not None:
                return found
            step *= 2  # what comes behind an alarm is judged by nobody
        return None

    def _alarm(self, seen: Whitened, first: int, last: int) -> Alarm | None:
        """Return that of the rows before `last`; where it is found, no row behind is judged."""
        rays, config = seen.rays, self._config
        best: tuple[int, float, int] | None = None
        made: FloatArray | None = None
        since = max(self._next - config.recent - config.window - 2 * BESIDE, 0)
        least = float(np.sqrt(config.threshold))
        wide = np.empty((2, max(last - self._next, 0), len(rays.rays)))
        for m, squares in zip(self._lengths, self._squares, strict=True):
            begin = max(config.least + m - 1, self._next)
            ratio, stray = wide[:, : max(last - begin, 0)]
            number = begin - (config.least + m - 1)
            rule = (m, config.window, config.threshold)
            sums = (seen.total, seen.past.total, seen.past.moment)
            if not follow(*sums, self._along, begin, number, rule, squares, ratio, stray):
                continue  # as in nearly all histories of a sound valve
            end = np.arange(begin, last)
            shown = ratio > least * stray
            far = np.flatnonzero(shown.any(axis=1) & (end >= first))
            if not len(far):
                continue
            if made is None:
                made = jumps_made(rays.along(seen.view[1][since:last]), config.window)
                measured = seen.measured
            shown = shown[far] & _lasts(seen, config, end[far], m, made[end[far] - m + 1 - since])
            for k in np.flatnonzero(shown.any(axis=1)):
                much = wandered(measured, int(end[far[k]]) - m + 1, config)
                shown[k] &= ratio[far[k]] > much * least * stray[far[k]]
            hits = np.flatnonzero(shown.any(axis=1))
            if not len(hits):
                continue
            score = float(np.where(shown, ratio[far], 0.0)[hits[0]].max())
            row = int(end[far[hits[0]]])
            if best is None or (row, -score) < (best[0], -best[1]):
                best = (row, score, m)
            last = best[0] + 1
        alone = self._alone.first(seen.view[0][:last], seen.past, rays, first=first)
        self._next = last
        if alone >= 0 and (best is None or alone < best[0]):
            return alone, alone
        return None if best is None else (best[0], best[0] - best[2] + 1)


def first_alarm(seen: Whitened, config: DetectionConfig, *, first: int) -> Alarm | None:
    """Return the row from `first` on that raises an alarm and that of its onset, None = none.

    Parameters
    ----------
    seen : Whitened
        All rows.
    config : DetectionConfig
        When to speak.
    first : int
        First row that is judged.
    """
    return Watch(seen.rays, config).alarm(seen, first)


def _lasts(
    seen: Whitened, config: DetectionConfig, end: IntArray, m: int, made: FloatArray
) -> BoolArray:
    """Return along which signatures a change is sudden and shown by more than one cycle, (K, S).

    Only what a cycle shows counts, not what is carried on from an earlier one.

    Parameters
    ----------
    seen : Whitened
        All rows.
    config : DetectionConfig
        When to speak.
    end : (K,) int array
        Last rows of the changes.
    m : int
        Cycles that show each [1].
    made : (K, S) array
        Largest jumps made before each, see `jumps_made` [standard deviations].
    """
    w, base, rays = seen.view
    begun = end - m + 1
    lines = seen.past.lines(end - m, config.window)
    line = lines.at(end.astype(np.float64) - 0.5 * (m - 1))[0]
    mean = (seen.total[end + 1] - seen.total[begun]) / m - line
    off = ABRUPT * rays.along(mean)
    jump = rays.along(_jumps(w, base, begun, m))
    shown = (jump > off) & (jump > BEYOND * made)
    young = lines.count < config.settled
    shown &= ~young[:, None] | (rays.along(mean + line - lines.level) > off)
    cycles, share, scatter = np.empty((3, m, *shown.shape))
    for back in range(m):
        before, variance = lines.at((end - back).astype(np.float64))
        each = (w[end - back] - before) / np.sqrt(1.0 + variance)[:, None]
        cycles[back], share[back], scatter[back] = seen.shown_along(each, end - back)
    least = np.maximum(config.each, _OF_LARGEST * cycles.max(axis=0))
    shown &= np.count_nonzero(cycles > least, axis=0) >= config.confirm
    weight = share / np.maximum(scatter, _TOLD)
    together = np.sum(weight * cycles, axis=0)
    together /= np.sqrt(np.maximum(np.sum(weight * share, axis=0), _TOLD))
    whole = (share == 1.0).all(axis=0)
    shown &= whole | (together > np.sqrt(config.threshold))
    return np.asarray(shown, dtype=np.bool_)


def _jumps(w: FloatArray, base: FloatArray, first: IntArray, cycles: int) -> FloatArray:
    """Return by how much the first of some cycles lie off those just before them, (K, F)."""
    after = min(cycles, BESIDE)
    begun = np.stack([w[first + k] for k in range(after)]).mean(axis=0)
    before = np.stack([base[np.maximum(first - 1 - k, 0)] for k in range(BESIDE)]).mean(axis=0)
    return np.asarray(begun - before, dtype=np.float64)


class Named(NamedTuple):
    """Row of the onset of a change, how it fits faults, and how it does the other way round."""

    onset: int
    found: Match
    ended: Match


class Step(NamedTuple):
    """A fault that was found, its first row, and the first behind it; None = it lasts.

    Behind it the next one is sought from row `start` on, of those that are left.
    """

    finding: Finding
    first: int
    last: int | None
    start: int


class Seen:
    """A record without what was found in it before, and the first alarm in it; it may grow.

    Parameters
    ----------
    vectors : (N, F) array
        Features as they are followed [unit by feature].
    table : SignatureTable
        Signatures of the valve's faults.
    config : DetectionConfig
        When to speak.
    start : int
        First row that may raise an alarm.

    Attributes
    ----------
    alarm : (int, int) or None
        Row of the first alarm and of its onset; None = there is none. Each cycle is judged by
        the scatter of cycles known by then: what comes later is never taken for the valve's own,
        so that an alarm once raised is raised in every longer history.
    start : int
        First row that may raise one.
    named : Named or None
        What raised it, once no later row changes that.
    step : Step or None
        The fault and its rows, once no later row changes that.
    lasts : bool
        Whether too many rows came to see it over by what it changed.
    """

    def __init__(
        self, vectors: FloatArray, table: SignatureTable, config: DetectionConfig, start: int
    ) -> None:
        self._table, self._config, self.start = table, config, start
        self.named: Named | None = None
        self.step: Step | None = None
        self.lasts = False
        self._vectors = vectors[:0]
        self._whole: Whitened | None = None
        self._watch: Watch | None = None
        self._young: Whitened | None = None
        self.alarm: Alarm | None = None
        self.grow(vectors)

    def begins(
        self, vectors: FloatArray, table: SignatureTable, config: DetectionConfig, start: int
    ) -> bool:
        """Return whether it is made of the first rows of others, by the same rules.

        Parameters
        ----------
        vectors : (N, F) array
            Features as they are followed [unit by feature].
        table : SignatureTable
            Signatures of the valve's faults.
        config : DetectionConfig
            When to speak.
        start : int
            First row that may raise an alarm.
        """
        same = self._table is table and self.start == start and self._config == config
        return same and begins(self._vectors, vectors)

    def grow(self, vectors: FloatArray) -> None:
        """Take a record whose first rows are those known."""
        before, self._vectors = len(self._vectors), vectors
        config, count = self._config, len(vectors)
        settled = config.learn + config.recent
        if self._whole is None:
            self._look_early(before)
        if self._whole is not None:
            self._whole.grow(vectors)
        elif count >= settled:
            self._whole = Whitened(vectors, known_by(count, config), self._table, config)
            self._watch, self._young = Watch(self._whole.rays, config), None
        else:
            self._young = Whitened(vectors, known_by(count, config), self._table, config)
        if self._watch is not None and self._whole is not None and self.alarm is None:
            self.alarm = self._watch.alarm(self._whole, max(settled - 1, self.start))
            end = count if self.alarm is None else self.alarm[0]
            begin = max(settled - 1, self.start, before)
            self.alarm = self._beyond(begin, end) or self.alarm

    def _look_early(self, before: int) -> None:
        """Look whether one of the first rows raises an alarm, by the few that came before it."""
        config, vectors = self._config, self._vectors
        least = max(config.least + config.confirm, self.start + 1, before + 1)
        for end in range(least, min(len(vectors), config.learn + config.recent - 1) + 1):
            if end > config.young:
                self.alarm = _early_alarm(vectors[:end], self._table, config)
            known, scale = known_by(end, config), config
            if self.alarm is None and (beyond := self._beyond(end - 1, end)) is not None:
                self.alarm, known = beyond, beyond[1]
                scale = replace(config, learn=known)  # what is named needs no doubt of few cycles
            if self.alarm is not None:
                self._whole = Whitened(vectors, known, self._table, scale)
                self._young = None
                return

    def _beyond(self, begin: int, end: int) -> Alarm | None:
        """Return the first of some rows that raises an alarm by itself and those before it."""
        return first_beyond(self._vectors[:end], self._table, self._config, begin)

    @property
    def whitened(self) -> Whitened:
        """All rows, by the scatter that the first alarm was judged by."""
        found = self._whole or self._young
        assert found is not None
        return found

    def departs(self) -> float:
        """Return how far the newest row lies off those before it, 0 = not far enough."""
        seen = self.whitened
        return departs(seen.view[0], seen.past, seen.rays, self._config)


@kept
def _early_alarm(
    vectors: FloatArray, table: SignatureTable, config: DetectionConfig
) -> Alarm | None:
    """Return the alarm that the last of few cycles raises, see `first_alarm`."""
    count = len(vectors)
    seen = Whitened(vectors, known_by(count, config), table, config)
    return first_alarm(seen, config, first=count - 1)
