# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Merge signals by stamp behind a watermark: samples in, frames at the position's stamps out.

A position sample is released once every other signal has been seen at or after its stamp, so that
the frame does not depend on the order in which the network delivered the topics. A signal that
falls silent holds the others back by at most `hold_back_s` of data time; what arrives later than
that is counted as late, and the running cycle is told of it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.state import AlignerState, TrackState
from valve_twin.core.types import CONDITIONS, BoolArray, FloatArray, Frames, IntArray
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Iterable

POSITION = 0
"""Index of the position among the signals; commands follow, then counter and reference."""

_JUMP_CONFIRMATIONS = 3


@dataclass(frozen=True, slots=True)
class SignalRange:
    """A signal by name with the values that are believed [unit of the signal]."""

    name: str
    lower: float = -np.inf
    upper: float = np.inf


@dataclass(slots=True)
class SignalCounts:
    """What happened to the samples of one signal since the start."""

    received: int = 0
    duplicate: int = 0
    late: int = 0
    bad: int = 0


@dataclass(slots=True)
class _Track:
    """Samples of one signal that may still be needed."""

    signal: SignalRange
    stamps: deque[IntArray] = field(default_factory=deque)
    values: deque[FloatArray] = field(default_factory=deque)
    last_ns: int | None = None
    held_value: float = np.nan
    begun: bool = False
    older: list[int] = field(default_factory=list)
    counts: SignalCounts = field(default_factory=SignalCounts)


class Aligner:
    """Deterministic merger of one valve's signals.

    Parameters
    ----------
    signals : tuple of SignalRange
        The position first, then the commands in the model's order.
    counter, reference : SignalRange or None
        The optional signals.
    conditions : tuple of SignalRange
        Those of the signals `CONDITIONS` that are mapped, in any order.
    hold_back_s : float
        Longest time, on the data's clock, by which a silent signal delays the others [s].
    jump_s : float
        A signal whose stamps stay older than its newest one by more than this was set back: a
        clock jump [s].

    Attributes
    ----------
    jumps : int
        Times the clock was set back [1].
    late : set of str
        Signals of which samples came after their frame, which guessed; emptied by who is told.
    """

    def __init__(
        self,
        signals: tuple[SignalRange, ...],
        *,
        counter: SignalRange | None = None,
        reference: SignalRange | None = None,
        conditions: tuple[SignalRange, ...] = (),
        hold_back_s: float = 2.0,
        jump_s: float = 1.0,
    ) -> None:
        self._n_inputs = len(signals) - 1
        extra = [s for s in (counter, reference, *conditions) if s is not None]
        self._tracks = [_Track(s) for s in (*signals, *extra)]
        self._names = {t.signal.name: i for i, t in enumerate(self._tracks)}
        self._counter = self._names[counter.name] if counter is not None else -1
        self._reference = self._names[reference.name] if reference is not None else -1
        self._conditions = [(self._names[s.name], CONDITIONS.index(s.name)) for s in conditions]
        self._hold_back_ns = round(hold_back_s * 1e9)
        self._jump_ns = round(jump_s * 1e9)
        self._released_ns: int | None = None
        self.jumps = 0
        self.late: set[str] = set()

    def snapshot(self) -> AlignerState:
        """Return the whole state; `restore` in an aligner of equal configuration goes on."""
        tracks = tuple(
            TrackState(
                name=t.signal.name,
                stamp_ns=np.concatenate([_NO_STAMPS, *t.stamps]),
                values=np.concatenate([_NO_VALUES, *t.values]),
                last_ns=t.last_ns,
                held_value=t.held_value,
                older_ns=tuple(t.older),
                counts=(t.counts.received, t.counts.duplicate, t.counts.late, t.counts.bad),
            )
            for t in self._tracks
        )
        return AlignerState(tracks, self._released_ns, self.jumps, tuple(sorted(self.late)))

    def restore(self, state: AlignerState) -> None:
        """Go on from a snapshot with the same bits.

        Raises
        ------
        ValueError
            If it was taken of other signals.
        """
        names = [t.name for t in state.tracks]
        if names != list(self._names):
            msg = f"the state is of the signals {', '.join(names)}, not {', '.join(self._names)}"
            raise ValueError(msg)
        for track, then in zip(self._tracks, state.tracks, strict=True):
            some = len(then.stamp_ns) > 0
            track.stamps = deque([then.stamp_ns] if some else [])
            track.values = deque([then.values] if some else [])
            track.last_ns, track.held_value = then.last_ns, then.held_value
            track.begun = then.last_ns is not None
            track.older, track.counts = list(then.older_ns), SignalCounts(*then.counts)
        self._released_ns, self.jumps, self.late = state.released_ns, state.jumps, set(state.late)

    def counts(self) -> dict[str, SignalCounts]:
        """Return the counters of every signal by name."""
        return {name: self._tracks[i].counts for name, i in self._names.items()}

    def push(self, name: str, stamp_ns: IntArray, values: FloatArray) -> Frames | None:
        """Add samples of one signal and release what has become complete.

        Parameters
        ----------
        name : str
            Signal name.
        stamp_ns : (N,) int64 array
            Stamps [ns].
        values : (N,) array
            Values [unit of the signal]; anything but a finite number in range marks its
            frames as not valid.

        Returns
        -------
        Frames or None
            Newly complete frames, oldest first.

        Raises
        ------
        KeyError
            If the signal is unknown.
        """
        self._add(name, stamp_ns, values)
        return self._release(self._watermark())

    def push_round(self, parts: Iterable[tuple[str, IntArray, FloatArray]]) -> Frames | None:
        """Add samples of several signals at once, then release what has become complete.

        Parameters
        ----------
        parts : iterable of (str, (N,) int64 array, (N,) array)
            Signal name, stamps [ns] and values, as for `push`.

        Returns
        -------
        Frames or None
            Newly complete frames, oldest first.
        """
        for name, stamp_ns, values in parts:
            self._add(name, stamp_ns, values)
        return self._release(self._watermark())

    def _add(self, name: str, stamp_ns: IntArray, values: FloatArray) -> None:
        track = self._tracks[self._names[name]]
        stamp_ns, values = self._fresh(track, stamp_ns, values)
        if len(stamp_ns):
            self._look_whether_late(track, stamp_ns)
            track.stamps.append(stamp_ns)
            track.values.append(values)
            track.last_ns = int(stamp_ns[-1])

    def flush(self) -> Frames | None:
        """Release everything that is left, at the end of a record."""
        last = self._tracks[POSITION].last_ns
        return None if last is None else self._release(last)

    def reset(self) -> None:
        """Forget all samples (clock jump); the counters stay."""
        for track in self._tracks:
            track.stamps.clear()
            track.values.clear()
            track.older.clear()
            track.last_ns = None
            track.held_value, track.begun = np.nan, False
        self.late.clear()
        self._released_ns = None

    def _fresh(
        self, track: _Track, stamp_ns: IntArray, values: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Drop duplicate and late samples, watch for a clock that was set back."""
        track.counts.received += len(stamp_ns)
        newest = track.last_ns
        if newest is None:
            newest = int(stamp_ns[0]) - 1 if len(stamp_ns) else 0
        if len(stamp_ns) and stamp_ns[0] > newest and bool(np.all(stamp_ns[1:] > stamp_ns[:-1])):
            track.older.clear()
            return stamp_ns, values
        running = np.maximum.accumulate(np.concatenate(([newest], stamp_ns)))[:-1]
        keep = stamp_ns > running
        track.counts.duplicate += int(np.count_nonzero(stamp_ns == running))
        track.counts.late += int(np.count_nonzero(stamp_ns < running))
        older = [int(s) for s, r in zip(stamp_ns, running, strict=True) if r - s > self._jump_ns]
        if older and not keep.any():
            return self._jumped(track, older, stamp_ns, values)
        return stamp_ns[keep], values[keep]

    def _look_whether_late(self, track: _Track, stamp_ns: IntArray) -> None:
        """Count samples that a released frame should have held: the frame guessed."""
        if self._released_ns is None or track is self._tracks[POSITION]:
            return
        late = int(np.count_nonzero(stamp_ns <= self._released_ns))
        if late:
            track.counts.late += late
            self.late.add(track.signal.name)

    def _jumped(
        self, track: _Track, older: list[int], stamp_ns: IntArray, values: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Confirm a backward jump by older stamps in rising order; start over with this block."""
        if track.older and older[0] <= track.older[-1]:
            track.older.clear()
        track.older += older
        if len(track.older) < _JUMP_CONFIRMATIONS:
            return stamp_ns[:0], values[:0]
        self.jumps += 1
        self.reset()
        falls = np.flatnonzero(np.diff(stamp_ns) <= 0)
        first = int(falls[-1]) + 1 if len(falls) else 0
        return stamp_ns[first:], values[first:]

    def _watermark(self) -> int | None:
        """Stamp up to which every signal is known, or given up waiting for."""
        lasts = [t.last_ns for t in self._tracks]
        known = [t for t in lasts if t is not None]
        if lasts[POSITION] is None or not known:
            return None
        patience = max(known) - self._hold_back_ns
        others = [patience if t is None else t for t in lasts[1:]]
        return max(min(others, default=max(known)), patience)

    def _release(self, watermark: int | None) -> Frames | None:
        position = self._tracks[POSITION]
        if watermark is None or not position.stamps or position.stamps[0][0] > watermark:
            return None
        stamps, values = _take(position, watermark)
        count = len(stamps)
        if count == 0:
            return None
        self._released_ns = int(stamps[-1])
        position_values = np.empty(count)
        valid = np.empty(count, dtype=np.bool_)
        limits = position.signal
        position.counts.bad += _believe(values, limits.lower, limits.upper, position_values, valid)
        inputs = np.empty((count, self._n_inputs))
        for i, track in enumerate(self._tracks[1 : self._n_inputs + 1]):
            _hold(track, stamps, inputs, i, valid, judge=True)
        nothing = np.full(count, np.nan)
        return Frames(
            stamp_ns=stamps,
            position=position_values,
            inputs=inputs,
            counter=self._optional(self._counter, stamps, valid, nothing),
            reference=self._optional(self._reference, stamps, valid, nothing),
            valid=valid,
            conditions=self._held_conditions(stamps, valid),
        )

    def _held_conditions(self, stamps: IntArray, valid: BoolArray) -> FloatArray | None:
        """Return the (N, 3) conditions, NaN where a value is not believed; they spoil no frame."""
        if not self._conditions:
            return None
        held = np.full((len(stamps), len(CONDITIONS)), np.nan)
        for index, column in self._conditions:
            track = self._tracks[index]
            _hold(track, stamps, held, column, valid, judge=False)
            limits, values = track.signal, held[:, column]
            values[~((values >= limits.lower) & (values <= limits.upper))] = np.nan
        return held

    def _optional(
        self, index: int, stamps: IntArray, valid: BoolArray, nothing: FloatArray
    ) -> FloatArray:
        """Return the column of a signal; that of nothing where there is no such signal."""
        if index < 0:
            return nothing
        column = np.empty((len(stamps), 1))
        _hold(self._tracks[index], stamps, column, 0, valid, judge=False)
        return column[:, 0]


@njit(cache=True)
def _believe(
    values: FloatArray, lower: float, upper: float, position: FloatArray, valid: BoolArray
) -> int:
    """Keep finite values, mark those in range as valid; return how many are not."""
    bad = 0
    for n in range(len(values)):
        value = values[n]
        finite = np.isfinite(value)
        position[n] = value if finite else np.nan
        valid[n] = finite and lower <= value <= upper
        bad += not valid[n]
    return bad


@njit(cache=True)
def _hold_into(
    at_ns: IntArray,
    stamps: IntArray,
    values: FloatArray,
    before: float,
    column: int,
    held: FloatArray,
) -> None:
    """Write the last value at or before each stamp; `before` is the one before all of them."""
    k, value = 0, before
    for n in range(len(at_ns)):
        while k < len(stamps) and stamps[k] <= at_ns[n]:
            value = values[k]
            k += 1
        held[n, column] = value


@njit(cache=True)
def _judge(held: FloatArray, column: int, lower: float, upper: float, valid: BoolArray) -> int:
    """Mark frames whose held value is not believed; return how many are not."""
    bad = 0
    for n in range(len(valid)):
        value = held[n, column]
        if not (np.isfinite(value) and lower <= value <= upper):
            valid[n] = False
            bad += 1
    return bad


def _take(track: _Track, watermark: int) -> tuple[IntArray, FloatArray]:
    """Remove and return the samples up to the watermark."""
    stamps: list[IntArray] = []
    values: list[FloatArray] = []
    while track.stamps and track.stamps[0][0] <= watermark:
        block, data = track.stamps.popleft(), track.values.popleft()
        n = (
            len(block)
            if block[-1] <= watermark
            else int(np.searchsorted(block, watermark, side="right"))
        )
        if n < len(block):
            track.stamps.appendleft(block[n:])
            track.values.appendleft(data[n:])
        stamps.append(block[:n])
        values.append(data[:n])
        if n < len(block):
            break
    if len(stamps) == 1:
        return stamps[0], values[0]
    return np.concatenate(stamps), np.concatenate(values)


_NO_STAMPS = np.empty(0, dtype=np.int64)
_NO_VALUES = np.empty(0)


def _hold(
    track: _Track,
    at_ns: IntArray,
    held: FloatArray,
    column: int,
    valid: BoolArray,
    *,
    judge: bool,
) -> None:
    """Write the last value at or before each stamp, NaN before the first; forget the older.

    A frame before the first value has none to judge: it is not valid, but no bad value either.
    """
    stamps, values = _NO_STAMPS, _NO_VALUES
    if track.stamps and track.stamps[0][0] <= at_ns[-1]:
        stamps, values = _take(track, int(at_ns[-1]))
    _hold_into(at_ns, stamps, values, track.held_value, column, held)
    before_all = 0
    if not track.begun:
        before_all = int(np.searchsorted(at_ns, stamps[0])) if len(stamps) else len(at_ns)
    if len(stamps):
        track.held_value, track.begun = float(values[-1]), True
    if judge:
        limits = track.signal
        bad = _judge(held, column, limits.lower, limits.upper, valid)
        track.counts.bad += bad - before_all
