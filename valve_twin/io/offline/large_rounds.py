# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Hand on a recorded stream in large blocks where that changes nothing, else in short rounds.

The twin releases a sample once every signal was seen at its stamp, or after `hold_back_s`. Where
each signal's stamps rise and no sample was recorded later than that against the others, the frames
depend on the samples only, not on the rounds in which they come: one large round then does the
work of many. A stretch that fails this, or has no stamps of its own, goes on in the short rounds
in which a live twin would have met it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.core.gaps import delays
from valve_twin.core.types import cut_block, join_blocks
from valve_twin.io.bags.signals import cut_rounds

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from valve_twin.io.cdr.signals import SignalBlock

LARGE_S = 1e6
"""Log time in one large round [s]: whatever a bag hands on at once."""

LARGE_SAMPLES = 30_000
"""Samples of all signals that make a round large enough: it still fits into a cache."""


def in_large_rounds(
    blocks: Iterable[SignalBlock], order: Sequence[str], *, hold_back_s: float, slice_s: float
) -> Iterator[list[SignalBlock]]:
    """Return the rounds of a record, large ones where that gives the same frames.

    Parameters
    ----------
    blocks : iterable of SignalBlock
        Rounds of at most one block a signal, in the order of `order`.
    order : sequence of str
        Names of the signals.
    hold_back_s : float
        Longest time by which a silent signal delays the others [s].
    slice_s : float
        Log time in a short round [s].

    Yields
    ------
    list of SignalBlock
        Blocks to be taken together; each block of a short round comes alone.
    """
    place = {name: i for i, name in enumerate(order)}
    stretch = _Stretch(round((hold_back_s - slice_s) * 1e9))
    slice_ns = max(1, round(slice_s * 1e9))
    for found in _gathered(_rounds(blocks, place)):
        large = _joined(found, order)
        if stretch.keeps_order(large):
            yield large
        else:
            for one in found:
                yield from ([block] for block in _short_rounds(one, slice_ns))


def _rounds(blocks: Iterable[SignalBlock], place: dict[str, int]) -> Iterator[list[SignalBlock]]:
    """Collect the blocks of one round: the order of signals starts again with the next."""
    found: list[SignalBlock] = []
    for block in blocks:
        if found and place[block.signal] <= place[found[-1].signal]:
            yield found
            found = []
        found.append(block)
    if found:
        yield found


def _gathered(rounds: Iterable[list[SignalBlock]]) -> Iterator[list[list[SignalBlock]]]:
    """Collect consecutive rounds up to `LARGE_SAMPLES`: a bag hands on one chunk after another."""
    found: list[list[SignalBlock]] = []
    samples = 0
    for blocks in rounds:
        found.append(blocks)
        samples += sum(len(block.stamp_ns) for block in blocks)
        if samples >= LARGE_SAMPLES:
            yield found
            found, samples = [], 0
    if found:
        yield found


def _joined(rounds: list[list[SignalBlock]], order: Sequence[str]) -> list[SignalBlock]:
    """Join consecutive rounds into one."""
    if len(rounds) == 1:
        return rounds[0]
    parts: dict[str, list[SignalBlock]] = {name: [] for name in order}
    for blocks in rounds:
        for block in blocks:
            parts[block.signal].append(block)
    return [join_blocks(blocks) for blocks in parts.values() if blocks]


class _Stretch:
    """Watches whether the stamps rise and how far they lie from the time of recording."""

    def __init__(self, patience_ns: int) -> None:
        self._patience_ns = patience_ns
        self._last_ns: dict[str, int] = {}
        self._least_delay: int | None = None

    def keeps_order(self, blocks: Sequence[SignalBlock]) -> bool:
        """Tell whether these blocks give the same frames in any rounds."""
        plain, greatest = True, None
        for block in blocks:
            stamps = block.stamp_ns
            if not len(stamps):
                continue
            if block.log_ns is None or not block.has_header:
                plain = False
                continue
            low, high, rises = delays(block.log_ns, stamps)
            self._least_delay = low if self._least_delay is None else min(self._least_delay, low)
            greatest = high if greatest is None else max(greatest, high)
            last = self._last_ns.get(block.signal)
            plain = plain and rises and (last is None or int(stamps[0]) > last)
            newest = int(stamps[-1]) if rises else int(stamps.max())
            self._last_ns[block.signal] = newest if last is None else max(newest, last)
        if not plain or greatest is None or self._least_delay is None:
            return False
        return greatest - self._least_delay < self._patience_ns


def _short_rounds(blocks: Sequence[SignalBlock], slice_ns: int) -> Iterator[SignalBlock]:
    """Cut one large round into short ones of equal log time."""
    if any(block.log_ns is None for block in blocks):
        yield from blocks
        return
    logs = [block.log_ns for block in blocks if block.log_ns is not None]
    for place, part in cut_rounds(logs, slice_ns):
        yield cut_block(blocks[place], part)
