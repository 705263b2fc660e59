# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a damaged file still holds and what it has lost: place, topics, time and messages."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.io.mcap.summary import Summary

_SECOND_NS = 1_000_000_000
_SHOWN = 6


@dataclass(slots=True)
class Loss:
    """One damaged place of a file.

    Attributes
    ----------
    file : Path
        The file.
    offset, length : int
        Where the damage begins and how many bytes cannot be used [B].
    what, reason : str
        Which part of the file and why it cannot be used.
    topics : tuple of str
        Topics that lost messages; empty = unknown, or none where `count` is 0.
    start_ns, end_ns : int or None
        Log times between which the lost messages lie [ns]; None = unknown.
    count : int or None
        Lost messages; None = unknown.
    counts : dict
        Lost messages by topic, as far as known.
    """

    file: Path
    offset: int
    length: int
    what: str
    reason: str
    topics: tuple[str, ...] = ()
    start_ns: int | None = None
    end_ns: int | None = None
    count: int | None = 0
    counts: Mapping[str, int] = field(default_factory=dict)

    def line(self) -> str:
        """Say it in one line."""
        where = f"{self.file}: byte {self.offset}"
        size = f", {self.length} bytes" if self.length else ""
        return f"{where}{size}: {self.what}: {self.reason}; {self._lost()}"

    def as_map(self) -> dict[str, object]:
        """Return it as plain values; what is unknown is None."""
        return {**asdict(self), "file": self.file.name, "topics": list(self.topics)}

    def _lost(self) -> str:
        if self.count == 0:
            return "no message is lost"
        many = "an unknown number of messages" if self.count is None else _messages(self.count)
        return f"lost: {many} of {self._topics()}, {self._time()}"

    def _topics(self) -> str:
        if not self.topics:
            return "unknown topics"
        shown = [
            f"{name} ({self.counts[name]})" if name in self.counts else name
            for name in self.topics[:_SHOWN]
        ]
        more = len(self.topics) - _SHOWN
        return ", ".join(shown) + (f" and {more} more" if more > 0 else "")

    def _time(self) -> str:
        if self.start_ns is None and self.end_ns is None:
            return "time unknown"
        begin = "unknown" if self.start_ns is None else time_text(self.start_ns)
        end = "unknown" if self.end_ns is None else time_text(self.end_ns)
        return f"from {begin} to {end}"


@dataclass(frozen=True, slots=True)
class Salvage:
    """What a damaged file still holds.

    Attributes
    ----------
    path : Path
        The file.
    summary : Summary
        Definitions, chunks and counts of what is readable.
    rescued : dict
        Records of those chunks that cannot be read as they stand, by their offset.
    losses : tuple of Loss
        Damaged places in the order of the file.
    unverified : dict
        Messages of those chunks for which no check sum stands, by offset.
    suspects : int
        Unverified messages with values that are not finite.
    lost : dict or None
        Lost messages by topic, None = unknown.
    lost_count : int or None
        Lost messages, None = unknown.
    """

    path: Path
    summary: Summary
    rescued: dict[int, bytes]
    losses: tuple[Loss, ...]
    unverified: dict[int, int]
    suspects: int
    lost: dict[str, int] | None
    lost_count: int | None

    @property
    def unverified_count(self) -> int:
        """Messages for whose values no check sum stands."""
        return sum(self.unverified.values())


def total_lost(losses: Sequence[Loss]) -> int | None:
    """Return how many messages are lost in all, None = unknown."""
    counts = [loss.count for loss in losses]
    return None if None in counts else sum(c for c in counts if c is not None)


def time_text(time_ns: int) -> str:
    """Return a time in UTC with its nanoseconds."""
    seconds, rest = divmod(time_ns, _SECOND_NS)
    try:
        day = datetime.fromtimestamp(seconds, tz=timezone.utc)
    except (ValueError, OverflowError, OSError):
        return f"{time_ns} ns"
    return f"{day:%Y-%m-%dT%H:%M:%S}.{rest:09d}Z"


def _messages(count: int) -> str:
    return "1 message" if count == 1 else f"{count} messages"
