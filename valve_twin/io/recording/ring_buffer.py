# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The last messages in memory, bounded by time and bytes, cut at cycle boundaries."""

from __future__ import annotations

import struct
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable

OVERHEAD = 200
"""Memory of a message beside its bytes [B]."""

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4
_BEFORE, _IN, _AFTER = -1, 0, 1


class RecordedMessage(NamedTuple):
    """A serialized message with its receive time and source time [ns]."""

    topic: str
    data: bytes
    log_ns: int
    publish_ns: int


@dataclass(frozen=True, slots=True)
class CycleSpan:
    """First and last stamp of one production cycle [ns]."""

    number: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What was taken out of the buffer: messages in their order, and the whole cycles in them."""

    messages: tuple[RecordedMessage, ...]
    cycles: tuple[CycleSpan, ...] = ()


class RingBuffer:
    """Ring of messages.

    Parameters
    ----------
    seconds : float
        Receive time that it spans at most [s]; 0 = any.
    size : int
        Memory that it takes at most [B].
    cycles : int
        Whole cycles that a snapshot holds; 0 = all that is there, whole or not.
    """

    def __init__(self, *, seconds: float, size: int, cycles: int = 0) -> None:
        self._span_ns, self._limit = int(seconds * 1e9), size
        self._cycles = cycles
        self._spans: deque[CycleSpan] = deque(maxlen=max(cycles, 1))
        self._ring: deque[RecordedMessage] = deque()
        self._before: dict[str, RecordedMessage] = {}
        self._stamped: set[str] = set()
        self._latched: set[str] = set()
        self.size = 0

    def describe(self, topic: str, *, stamped: bool, latched: bool) -> None:
        """Say what a topic is like.

        Parameters
        ----------
        topic : str
            Its name.
        stamped : bool
            Its messages begin with a header, whose stamp tells the cycle.
        latched : bool
            Its last message before the snapshot's begin is kept.
        """
        for known, is_so in ((self._stamped, stamped), (self._latched, latched)):
            (known.add if is_so else known.discard)(topic)

    def push(self, message: RecordedMessage) -> None:
        """Append a message; the oldest give way."""
        self._ring.append(message)
        self.size += len(message.data) + OVERHEAD
        while self.size > self._limit and len(self._ring) > 1:
            self._drop()
        if self._span_ns:
            while abs(message.log_ns - self._ring[0].log_ns) > self._span_ns:
                self._drop()

    def end_cycle(self, span: CycleSpan) -> None:
        """Note a cycle that has ended; what lies before the last ones is let go."""
        if self._spans and span.start_ns <= self._spans[-1].start_ns:
            self._spans.clear()  # the clock went back
        self._spans.append(span)
        if not self._cycles or len(self._spans) < self._cycles:
            return
        start = self._spans[0].start_ns
        while self._ring and (self._stamp(self._ring[0]) or 0) < start:
            self._drop()

    def take(self) -> Snapshot:
        """Take out the last whole cycles, or all that is there where none are asked for or seen.

        What came after the last whole cycle stays.
        """
        spans = self._whole()
        if not spans:
            found = Snapshot((*self._state(self._ring), *self._ring))
            self._keep_latched(self._ring)
            self._forget(deque())
            return found
        places = self._places(spans[0].start_ns, spans[-1].end_ns)
        parts: dict[int, deque[RecordedMessage]] = {p: deque() for p in (_BEFORE, _IN, _AFTER)}
        for message, place in zip(self._ring, places, strict=True):
            parts[place].append(message)
        self._keep_latched(parts[_BEFORE])
        found = Snapshot((*self._state(parts[_IN]), *parts[_IN]), spans)
        self._keep_latched(parts[_IN])
        self._forget(parts[_AFTER])
        return found

    def _places(self, start_ns: int, end_ns: int) -> list[int]:
        """Place every message by its stamp; one without a stamp by those around it."""
        stamps = [self._stamp(m) for m in self._ring]
        inside = [i for i, s in enumerate(stamps) if s is not None and start_ns <= s <= end_ns]
        first, last = (inside[0], inside[-1]) if inside else (0, -1)
        return [
            (i > last) - (i < first) if s is None else (s > end_ns) - (s < start_ns)
            for i, s in enumerate(stamps)
        ]

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self._ring)

    @property
    def duration_s(self) -> float:
        """Receive time from the oldest to the newest message [s]."""
        return (self._ring[-1].log_ns - self._ring[0].log_ns) * 1e-9 if self._ring else 0.0

    def _drop(self) -> None:
        message = self._ring.popleft()
        self.size -= len(message.data) + OVERHEAD
        self._keep_latched((message,))

    def _keep_latched(self, messages: Iterable[RecordedMessage]) -> None:
        for message in messages:
            if message.topic in self._latched:
                self._before[message.topic] = message

    def _whole(self) -> tuple[CycleSpan, ...]:
        """Return the last cycles of which no sample has been let go."""
        if not self._cycles:
            return ()
        passing = (m for m in self._ring if m.topic not in self._latched)
        stamps = [s for s in map(self._stamp, passing) if s is not None]
        oldest = min(stamps, default=1 << 63)
        return tuple(s for s in self._spans if s.start_ns >= oldest)

    def _state(self, taken: Iterable[RecordedMessage]) -> list[RecordedMessage]:
        """Return the latched messages that were valid at the begin, with its log time."""
        first = next(iter(taken), None)
        if first is None:
            return []
        return [m._replace(log_ns=first.log_ns) for m in self._before.values()]

    def _forget(self, left: deque[RecordedMessage]) -> None:
        self._ring = left
        self._spans.clear()
        self.size = sum(len(m.data) + OVERHEAD for m in left)

    def _stamp(self, message: RecordedMessage) -> int | None:
        """Return the header's stamp [ns], None where there is none."""
        if message.topic not in self._stamped or len(message.data) < _STAMP_AT + _STAMP.size:
            return None
        seconds, rest = _STAMP.unpack_from(message.data, _STAMP_AT)
        return int(seconds) * 1_000_000_000 + int(rest)
