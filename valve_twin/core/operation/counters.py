# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Counters of a valve that go on over all its cycles: movements, travel, hours, spans.

A cycle gives a `Duty`, which the counters take up. The movement that was under way when a cycle
ended goes on in the next one, so that where the stream is cut counts for nothing; what moved
unseen between two cycles counts with the net way. As positioners do, a cycle of movement is what
lies between two reversals beyond a dead band, here from the measured noise: its way is its span.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.cycle.movement import REST_BAND, Moves, find_moves
from valve_twin.core.estimation.data.masks import contiguous
from valve_twin.core.gaps import gap_ns
from valve_twin.core.operation.counting import believed, open_times, walk

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle, FloatArray, IntArray

SPAN_SHARES = (0.0, 0.01, 0.02, 0.05, *(k / 10 for k in range(1, 11)))
"""Lower edges of the bins of spans [shares of the stroke], assumed; the last bin has no end."""

CLOSED = 0.01
"""Closed is within this of the closed end [share of the stroke], assumed."""

NEAR_CLOSED = 0.1
"""Near closed is open by less than this [share of the stroke]: as the counters of positioners."""

BELIEVED = 0.9
"""A cycle counts where so many of its positions at least are believed [1], assumed."""

_HOUR_NS = 3.6e12
_SHARES = np.array(SPAN_SHARES)


class Duty(NamedTuple):
    """What one cycle adds to the counters.

    Attributes
    ----------
    cycle, start_ns, end_ns : int
        Number of the cycle, its first and last stamp [ns].
    moves : Moves
        Its movements.
    position : (N,) array
        Believed positions [unit of the position].
    held_ns : (N,) int64 array
        How long each was held; 0 before a gap and at the end [ns].
    stroke : (float, float)
        Closed and open end where they are known, else NaN [unit of the position].
    """

    cycle: int
    start_ns: int
    end_ns: int
    moves: Moves
    position: FloatArray
    held_ns: IntArray
    stroke: tuple[float, float] = (math.nan, math.nan)


class _Moved(NamedTuple):
    """The counters of `Counters` that movements change."""

    rests: bool
    starts: int
    reversals: int
    done: float
    spans: tuple[int, ...]
    direction: int
    begin: float
    level: float


class _Held(NamedTuple):
    """The times of `Counters` that positions change."""

    open_ns: int
    closed_ns: int
    near_ns: int


@dataclass(frozen=True, slots=True)
class Counters:
    """What a valve has done since its counters began.

    Attributes
    ----------
    cycle, since_ns, end_ns : int
        Number of the last cycle counted, start of the first and end of the last one [ns].
    cycles, reversals, starts : int
        Cycles, changes of direction, starts from rest [1].
    length_ns, open_ns, closed_ns, near_ns : int
        Time in cycles, open, closed, and open by less than a tenth of the stroke [ns].
    done : float
        Way of all completed movements [unit of the position].
    closed, stroke : float
        Position of the closed end and the way from it to the open one [unit of the position],
        NaN before they are known: those of the model, else what the first cycle that moves spans.
    spans : tuple of int
        Completed movements by span, in bins of `SPAN_SHARES` [1].
    direction : int
        Of the movement that was under way last, 1 or -1; 0 = none yet.
    begin, level : float
        Where it began, and how far it has come [unit of the position].
    rests : bool
        Whether the last cycle ended at rest.
    """

    cycle: int = 0
    since_ns: int = 0
    end_ns: int = 0
    cycles: int = 0
    reversals: int = 0
    starts: int = 0
    length_ns: int = 0
    open_ns: int = 0
    closed_ns: int = 0
    near_ns: int = 0
    done: float = 0.0
    closed: float = math.nan
    stroke: float = math.nan
    spans: tuple[int, ...] = (0,) * len(SPAN_SHARES)
    direction: int = 0
    begin: float = math.nan
    level: float = math.nan
    rests: bool = False

    @property
    def movements(self) -> int:
        """Movements in one direction above the noise, the one under way included [1]."""
        return self.reversals + (self.direction != 0)

    @property
    def travel(self) -> float:
        """Way of the position [its unit]."""
        return self.done + (abs(self.level - self.begin) if self.direction else 0.0)

    @property
    def strokes(self) -> float:
        """Travel by the stroke [1]; NaN where the stroke is not known."""
        return self.travel / self.stroke

    @property
    def hours(self) -> tuple[float, float, float, float]:
        """Time in cycles, open, closed, near closed [h]."""
        times = (self.length_ns, self.open_ns, self.closed_ns, self.near_ns)
        total, opened, closed, near = (t / _HOUR_NS for t in times)
        return total, opened, closed, near

    @property
    def edges(self) -> tuple[float, ...]:
        """Edges of the bins of spans, one more than bins [unit of the position]."""
        return (*(share * self.stroke for share in SPAN_SHARES), math.inf)

    def after(self, duty: Duty) -> Counters:
        """Return the counters with one cycle more.

        Parameters
        ----------
        duty : Duty
            Of a cycle behind the last one counted.
        """
        closed, stroke = self._ends(duty)
        moved, held = self._moved(duty.moves, stroke), self._held(duty, closed, stroke)
        return Counters(
            cycle=duty.cycle,
            since_ns=self.since_ns if self.cycles else duty.start_ns,
            end_ns=duty.end_ns,
            cycles=self.cycles + 1,
            reversals=moved.reversals,
            starts=moved.starts,
            length_ns=self.length_ns + duty.end_ns - duty.start_ns,
            open_ns=held.open_ns,
            closed_ns=held.closed_ns,
            near_ns=held.near_ns,
            done=moved.done,
            closed=closed,
            stroke=stroke,
            spans=moved.spans,
            direction=moved.direction,
            begin=moved.begin,
            level=moved.level,
            rests=moved.rests,
        )

    def _ends(self, duty: Duty) -> tuple[float, float]:
        """Return the closed end and the stroke, learnt where they are not known yet."""
        if math.isfinite(self.stroke):
            return self.closed, self.stroke
        closed, opened = duty.stroke
        levels = duty.moves.levels
        if not math.isfinite(opened - closed) and len(levels):
            closed, opened = float(levels.min()), float(levels.max())
        return closed, opened - closed

    def _moved(self, moves: Moves, stroke: float) -> _Moved:
        """Return what is so when the movements of a cycle have joined the one under way."""
        if not moves.number:
            return self._unmoved()
        first = float(moves.levels[0])
        starts = self.starts + moves.starts
        gap = abs(first - self.level) / moves.turn
        follows = self.direction != 0 and gap <= 1.0
        if moves.early and self.rests and gap <= REST_BAND + 1.0:
            starts += 1
        level, origin = self.level, self.begin
        if follows and self.direction * (first - level) > 0.0:
            level = first  # the extreme lies in this cycle
        if not self.direction:
            level = origin = first
        levels = moves.levels[1:] if follows or not self.direction else moves.levels
        edges = _SHARES * stroke
        spans, found = np.empty(len(levels)), np.array(self.spans)
        count, direction, origin, level = walk(
            levels, level, self.direction, origin, edges, spans, found
        )
        return _Moved(
            rests=moves.rests,
            starts=starts,
            reversals=self.reversals + count,
            done=self.done + float(spans[:count].sum()),
            spans=tuple(found.tolist()),
            direction=direction,
            begin=origin,
            level=level,
        )

    def _unmoved(self) -> _Moved:
        return _Moved(
            rests=True,
            starts=self.starts,
            reversals=self.reversals,
            done=self.done,
            spans=self.spans,
            direction=self.direction,
            begin=self.begin,
            level=self.level,
        )

    def _held(self, duty: Duty, closed: float, stroke: float) -> _Held:
        """Return how long the valve was open and closed, with a cycle more."""
        if not stroke > 0.0:
            return _Held(self.open_ns, self.closed_ns, self.near_ns)
        total, shut, low = open_times(
            duty.position, duty.held_ns, (closed, stroke), (CLOSED, NEAR_CLOSED)
        )
        return _Held(self.open_ns + total - shut, self.closed_ns + shut, self.near_ns + low - shut)


def cycle_duty(cycle: Cycle, *, normalised: bool) -> Duty | None:
    """Return what a cycle adds to the counters; None where its position cannot be believed.

    Parameters
    ----------
    cycle : Cycle
        Accepted or refused.
    normalised : bool
        Whether positions are shares of the stroke: 0 = closed, 1 = open.
    """
    frames = cycle.frames
    position, stamp_ns = contiguous(frames.position), np.ascontiguousarray(frames.stamp_ns)
    good, held = np.empty(len(frames), np.bool_), np.empty(len(frames), np.int64)
    count = believed(position, frames.valid, stamp_ns, gap_ns(cycle.period_s), good, held)
    if not len(frames) or count / len(frames) < BELIEVED:
        return None
    if count < len(frames):
        position, held = position[good], held[good]
    stroke = (0.0, 1.0) if normalised else (math.nan, math.nan)
    moves = find_moves(position)
    return Duty(cycle.number, cycle.start_ns, cycle.end_ns, moves, position, held, stroke)
