# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Merge signals by stamp behind a watermark: samples in, frames at the position's stamps out.

A position sample is released once every other signal has been seen at or after its stamp, so that
the frame does not depend on the order in which the network delivered the topics. A signal that
falls silent holds the others back by at most `hold_back_s` of data time; what arrives later than
that is counted as late and the running cycle is marked as not reproducible.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import BoolArray, FloatArray, Frames, IntArray

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
    held_ns: int | None = None
    held_value: float = np.nan
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
    hold_back_s : float
        Longest time, on the data's clock, by which a silent signal delays the others [s].
    jump_s : float
        A signal whose stamps stay older than its newest one by more than this was set back: a
        clock jump [s].
    """

    def __init__(
        self,
        signals: tuple[SignalRange, ...],
        *,
        counter: SignalRange | None = None,
        reference: SignalRange | None = None,
        hold_back_s: float = 2.0,
        jump_s: float = 1.0,
    ) -> None:
        self._n_inputs = len(signals) - 1
        extra = [s for s in (counter, reference) if s is not None]
        self._tracks = [_Track(s) for s in (*signals, *extra)]
        self._names = {t.signal.name: i for i, t in enumerate(self._tracks)}
        self._counter = self._names[counter.name] if counter is not None else -1
        self._reference = self._names[reference.name] if reference is not None else -1
        self._hold_back_ns = round(hold_back_s * 1e9)
        self._jump_ns = round(jump_s * 1e9)
        self._released_ns: int | None = None
        self.jumps = 0
        self.guessed = 0

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
            Values in the unit of the signal; anything but a finite number in range marks its
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
            self.guessed += self._too_late(track, stamp_ns)
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
            track.last_ns = track.held_ns = None
            track.held_value = np.nan
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

    def _too_late(self, track: _Track, stamp_ns: IntArray) -> int:
        """Count samples that a released frame should have held: the frame guessed."""
        if self._released_ns is None or track is self._tracks[POSITION]:
            return 0
        late = int(np.count_nonzero(stamp_ns <= self._released_ns))
        track.counts.late += late
        return late

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
        if len(stamps) == 0:
            return None
        self._released_ns = int(stamps[-1])
        held = np.empty((len(stamps), len(self._tracks) - 1))
        valid = _believed(position, values)
        for i, track in enumerate(self._tracks[1:]):
            held[:, i] = _hold(track, stamps)
            if i < self._n_inputs:
                valid &= _believed(track, held[:, i])
        nothing = np.full(len(stamps), np.nan)
        return Frames(
            stamp_ns=stamps,
            position=np.where(np.isfinite(values), values, np.nan),
            inputs=np.ascontiguousarray(held[:, : self._n_inputs]),
            counter=held[:, self._counter - 1].copy() if self._counter >= 0 else nothing,
            reference=held[:, self._reference - 1].copy() if self._reference >= 0 else nothing,
            valid=valid,
        )


def _believed(track: _Track, values: FloatArray) -> BoolArray:
    good: BoolArray = (
        (values >= track.signal.lower) & (values <= track.signal.upper) & np.isfinite(values)
    )
    track.counts.bad += int(np.count_nonzero(~good))
    return good


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


def _hold(track: _Track, at_ns: IntArray) -> FloatArray:
    """Return the last value at or before each stamp, NaN before the first; forget the older."""
    known = [np.array([track.held_ns], dtype=np.int64)] if track.held_ns is not None else []
    data = [np.array([track.held_value])] if track.held_ns is not None else []
    if track.stamps and track.stamps[0][0] <= at_ns[-1]:
        taken_stamps, taken_values = _take(track, int(at_ns[-1]))
        known.append(taken_stamps)
        data.append(taken_values)
    if not known:
        return np.full(len(at_ns), np.nan)
    stamps, values = np.concatenate(known), np.concatenate(data)
    index = np.searchsorted(stamps, at_ns, side="right") - 1
    track.held_ns, track.held_value = int(stamps[-1]), float(values[-1])
    return np.where(index >= 0, values[np.maximum(index, 0)], np.nan)
