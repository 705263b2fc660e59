# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The past of one valve while estimates come, held within a bound however long the valve lives.

Up to 24 575 estimates nothing is left out. Beyond that the newest 8192 to 16 384 are kept in
full, and of the older ones every 2nd, 4th, 8th ..., so that they are 4096 to 8192 spread evenly
over the whole life: values themselves, not means, so that scatter and outliers are what they
were. Kept as well are the first estimates of the life and behind each maintenance event, which
make the reference, and those at which the count of cycles jumps.

Of features the newest 2048 to 4096 cycles are kept, and the first ones aside, for a stored
reference. What was found in the others is found for
good (`Settled`); the scatter of the kept ones is the measure from there on. What is let go of
depends only on what came and in which order: a history read anew gives the same bits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from valve_twin.core.diagnosis.changes.finding import CLOCK
from valve_twin.core.diagnosis.config import DetectionConfig
from valve_twin.core.diagnosis.features import ESTIMATOR
from valve_twin.core.diagnosis.history import search
from valve_twin.core.past.columns import Past, Rows, Settled, Table
from valve_twin.core.refusal import RefusalCode

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from valve_twin.core.past.block import Block
    from valve_twin.core.types import BoolArray, Estimate, Maintenance

RECENT = 8192
"""Newest estimates that are kept in full [1]; of the older ones at most as many."""

RECENT_FEATURES = 2048
"""Newest cycles whose features are kept in full [1]."""

FINDINGS = 256
"""Newest of the faults that are over which are kept [1]."""

FIRST = 64
"""Estimates kept at the start of the life and behind each maintenance event [1]."""

FIRST_FEATURES = 32
"""Cycles at the start of the life and behind each maintenance event whose features are kept [1]: a
stored reference judges the first ones, and what it says then stays said."""

_WAIT = 128  # cycles after which features are looked at again where a fault may still heal
_APART = 8  # cycles kept whose signals do not belong together, in those kept in full
_AROUND = 16  # cycles about a fault in which those count
_UNKNOWN = -1


class AgingState:
    """What is known of one valve.

    Parameters
    ----------
    recent, recent_features : int
        Newest estimates and cycles of features that are kept in full [1].
    """

    def __init__(self, recent: int = RECENT, recent_features: int = RECENT_FEATURES) -> None:
        self._recent, self._recent_features = recent, recent_features
        self._trend, self._features = Table(), Table()
        self._old, self._stride = 0, 1
        self._aside = 0  # rows of features before those that faults are sought in
        self._look_at = 2 * recent_features
        self._apart: dict[int, None] = {}
        self._settled: Settled | None = None
        self._taken: Past | None = None
        self.maintenance: Sequence[Maintenance] = ()

    def add(self, estimate: Estimate) -> None:
        """Add an estimate of any estimator; `maintenance` are the events known by then."""
        self._taken = None
        if estimate.reason_code == RefusalCode.IMPLAUSIBLE:
            self._apart[estimate.cycle] = None
            if len(self._apart) >= 2 * _APART * self._recent:
                self._apart = dict.fromkeys(sorted(self._apart)[-_APART * self._recent :])
        if estimate.used_by_trend:
            self._trend.add(estimate)
            if len(self._trend) - self._old >= 2 * self._recent:
                self._thin()
        if estimate.estimator == ESTIMATOR:
            self._features.add(estimate)
            if len(self._features) >= self._look_at:
                self._settle()

    def extend(self, block: Block) -> None:
        """Add many estimates of one estimator as `add` does, to the same bits.

        What is let go of on the way is let go of behind the same estimate. Of features the trend
        has to be there first.
        """
        self._taken, at = None, 0
        while at < len(block):
            if block.is_trend:
                room = 2 * self._recent - (len(self._trend) - self._old)
                self._trend.extend(block.part(at, at + room))
                if room <= len(block) - at:
                    self._thin()
            else:
                room = self._look_at - len(self._features)
                self._features.extend(block.part(at, at + room))
                if room <= len(block) - at:
                    self._settle()
            at += room

    def past(self) -> Past:
        """Return what is known now; it stays as it is when more comes."""
        if self._taken is None:
            trend, features = self._trend.rows(), self._features.rows()
            judged = features.since(self._aside) if self._aside else features
            whole = features if self._aside else None
            self._taken = Past(trend, judged, self._newest_apart(), self._settled, whole)
        return self._taken

    def freeze(self, arrays: list[NDArray[Any]]) -> dict[str, Any]:
        """Return all but the columns as plain values; the columns are added to `arrays`."""
        return {
            "recent": self._recent,
            "recent_features": self._recent_features,
            "old": self._old,
            "aside": self._aside,
            "stride": self._stride,
            "look_at": self._look_at,
            "apart": list(self._apart),
            "settled": self._settled,
            "tables": [table.freeze(arrays) for table in (self._trend, self._features)],
        }

    @classmethod
    def thaw(cls, head: Mapping[str, Any], arrays: list[NDArray[Any]]) -> AgingState:
        """Return the state that was frozen; its columns are taken from the front of `arrays`."""
        state = cls(head["recent"], head["recent_features"])
        state._old, state._stride, state._look_at = head["old"], head["stride"], head["look_at"]
        state._aside = head.get("aside", 0)
        state._apart = dict.fromkeys(head["apart"])
        state._settled = head["settled"]
        state._trend, state._features = (Table.thaw(t, arrays) for t in head["tables"])
        return state

    def cycles(self) -> tuple[set[int], set[int]]:
        """Return the cycles whose estimates for the trend, and whose features, are still held."""
        trend, features = self._trend.rows(), self._features.rows()
        return set(trend.cycle.tolist()), set(features.cycle.tolist())

    def _newest_apart(self) -> tuple[int, ...]:
        return tuple(sorted(self._apart)[-_APART * self._recent :])

    def _events(self, cycle: int) -> list[Maintenance]:
        """Return the events in force up to a cycle."""
        return [m for m in self.maintenance if not m.withdrawn and m.cycle <= cycle]

    def _thin(self) -> None:
        """Let go of all but few of the estimates that are not the newest."""
        rows = self._trend.rows()
        newest = np.arange(len(rows)) >= len(rows) - self._recent
        kept = newest | _marked(rows, [m.cycle for m in self._events(int(rows.cycle[-1]))])
        while True:
            even = rows.key % self._stride == 0
            if np.count_nonzero(even & ~newest) <= self._recent:
                break
            self._stride *= 2
        index = np.flatnonzero(kept | even)
        self._trend.keep(index)
        self._old = len(index) - self._recent

    def _settle(self) -> None:
        """Let go of the features that are not the newest, unless a fault may still heal."""
        events = self._events(int(self._features.rows().cycle[-1]))
        past = self.past()
        found, stopped, direct = search(past, events)
        cycles = past.features.cycle
        open_for = DetectionConfig().extrapolate + _WAIT
        near = int(cycles[max(len(cycles) - open_for, 0)])
        self._look_at = len(self._features) + _WAIT
        young = [f for f in found.findings if f.end < 0 and f.alarm >= near and f.fault != CLOCK]
        recent = max(self._recent_features, 2 * open_for if young else 0)
        if young and len(cycles) < 2 * recent:
            return
        judged = min((f.onset - 1 for f in young), default=int(cycles.max()))
        told = [f for f in found.findings if f.alarm <= judged or f.fault == CLOCK]
        kept = np.arange(len(cycles)) >= len(cycles) - recent
        for fault in told:
            if fault.end >= 0:  # what a fault did is no measure
                kept &= (cycles < fault.onset) | (cycles > fault.end)
        gone = int(np.count_nonzero(~kept))
        before = self._settled.cycles if self._settled else 0
        begun = cycles[cycles >= max((m.cycle for m in events), default=0)].min()
        settled = [f for f in told if f.fault != CLOCK or f.onset <= begun]
        over = [f for f in settled if f.end >= 0]
        for old in over[: max(len(over) - FINDINGS, 0)]:
            settled.remove(old)
        if young:  # and what they are is told later
            lasts = (f for f in settled if f.end < 0 and f.fault != CLOCK)
            stopped = any(f not in direct for f in lasts)
        self._settled = Settled(
            tuple(settled), before + gone, judged, found.doubt, stopped, direct
        )
        first = _begun(self._features.rows(), [m.cycle for m in events])
        self._let_go(kept, first[self._aside :])
        known = int(cycles[kept].min(initial=int(cycles.max()))) - _AROUND
        self._apart = {cycle: None for cycle in self._apart if cycle >= known}
        self._look_at = len(self._features) + self._recent_features
        self._taken = None

    def _let_go(self, kept: BoolArray, begun: BoolArray) -> None:
        """Let go of features that faults are sought in but some, (N,); put first ones aside."""
        before = self._aside
        aside = before + np.flatnonzero(begun & ~kept)
        index = np.concatenate((np.arange(before), aside, before + np.flatnonzero(kept)))
        self._features.keep(index)
        self._aside = before + len(aside)


def _begun(rows: Rows, events: Iterable[int]) -> BoolArray:
    """Return which cycles are the first of the life, or behind an event, (N,)."""
    found = rows.key < FIRST_FEATURES
    order = np.argsort(rows.cycle, kind="stable")
    for cycle in events:
        found[order[rows.cycle[order] >= cycle][:FIRST_FEATURES]] = True
    return np.asarray(found)


def _marked(rows: Rows, events: Iterable[int]) -> BoolArray:
    """Return which rows are kept for ever: behind a start, and where the count jumps, (N,)."""
    step = np.diff(rows.cycle, prepend=rows.cycle[:1] - 1)
    jump = (rows.missed == _UNKNOWN) | (step < 1) | (rows.missed >= step)
    kept = jump | np.append(jump[1:], False) | (rows.key < FIRST)
    order = np.argsort(rows.cycle, kind="stable")
    again = (np.diff(rows.cycle[order]) == 0) & (np.diff(rows.end_ns[order]) != 0)
    if again.any():  # one pair says that time, not the number, gives the order
        pair = int(np.argmax(again))
        kept[order[pair : pair + 2]] = True
    for cycle in events:
        kept[np.flatnonzero(rows.cycle >= cycle)[:FIRST]] = True
    return np.asarray(kept)


def state_of(history: Iterable[Estimate] | Past, maintenance: Sequence[Maintenance] = ()) -> Past:
    """Return what a state knows that got one estimate after the other.

    Parameters
    ----------
    history : iterable of Estimate, or Past
        Estimates of all estimators in the order in which they came; a past is returned as it is.
    maintenance : sequence of Maintenance
        Events of the valve.
    """
    if isinstance(history, Past):
        return history
    state = AgingState()
    state.maintenance = maintenance
    for estimate in history:
        state.add(estimate)
    return state.past()
