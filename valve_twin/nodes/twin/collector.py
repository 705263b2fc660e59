# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Gather the blocks of a valve's signals and hand them on in step.

The core waits for a silent signal by the data's clock. When data arrives faster than real time, or
the middleware has to send some of it again, a signal that is only on its way looks silent by that
clock. So samples are held here while a signal lags by more data time than it has been quiet by the
steady clock, seconds at most. At the pace of a plant nothing is held.

A signal that stood back while the others ran ahead faster than that, and by more than the core
waits for, is given the whole of those seconds, whether more data comes or not: else the end of a
rush would be handed on before the middleware has asked for what it lost of it.

After a pause of all signals, by either clock, one of them comes first, and the others lag by the
whole pause or have been quiet for as long. They count from there on, and are given half a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import cut_block, join_blocks

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from valve_twin.io.cdr.signals import SignalBlock

MOST_WAIT_S = 7.0
"""Longest wait for a signal; the middleware asks for what it lost every 3 s, and once may be lost,
too [s]."""

SHARE = 0.5
"""A signal that has been quiet for this share of the data time by which it lags is silent [1]."""

REJOIN_S = 0.5
"""After a pause of all signals each is given at least so long, if the core waits that long [s]."""

SLICE_SHARE = 0.5
"""Data time handed on at once, as a share of the time by which the core waits for a signal [1]:
after a stall no signal runs ahead of the others."""

_FAR = 2**62


class Collector:
    """Samples on their way to the core.

    Parameters
    ----------
    signals : iterable of str
        Names of all signals.
    hold_back_ns : int
        Data time by which the core waits for a signal [ns].
    """

    def __init__(self, signals: Iterable[str], hold_back_ns: int) -> None:
        self._hold_back_ns = hold_back_ns
        self._slice_ns = max(round(SLICE_SHARE * hold_back_ns), 1)
        self._signals = tuple(signals)
        self._blocks: dict[str, list[SignalBlock]] = {}
        self._last_ns: dict[str, int] = {}
        self._heard_s: dict[str, float] = {}
        self._rejoin_s = min(REJOIN_S, 1e-9 * hold_back_ns)
        self._newest_ns, self._newest_s = _FAR, 0.0
        self._resumed_ns, self._resumed_s = -_FAR, 0.0
        self.oldest_ns = 0

    def __bool__(self) -> bool:
        """Return whether something waits."""
        return bool(self._blocks)

    def add(self, block: SignalBlock, received_ns: int, now_s: float) -> None:
        """Take a block.

        Parameters
        ----------
        block : SignalBlock
            Samples of one signal.
        received_ns : int
            When the middleware received it; of the oldest that waits it is `oldest_ns` [ns].
        now_s : float
            The steady clock [s].
        """
        if not self._blocks:
            self.oldest_ns = received_ns
        first, last = int(block.stamp_ns[0]), int(block.stamp_ns[-1])
        if not self._last_ns or first < self._last_ns[block.signal]:
            self._last_ns = dict.fromkeys(self._signals, first - 1)
            self._heard_s = dict.fromkeys(self._signals, now_s)
            self._newest_ns, self._newest_s, self._resumed_ns = first, now_s, -_FAR
        pause_ns = max(first - self._newest_ns, 1e9 * (now_s - self._newest_s))
        if pause_ns > self._hold_back_ns:
            self._resumed_ns, self._resumed_s = first, now_s
        self._newest_ns, self._newest_s = max(self._newest_ns, last), now_s
        self._blocks.setdefault(block.signal, []).append(block)
        self._last_ns[block.signal], self._heard_s[block.signal] = last, now_s

    def take(self, now_s: float) -> Iterator[list[SignalBlock]]:
        """Yield what can be handed on, a round of all signals for every slice, and forget it."""
        limit = self._limit(now_s)
        if any(blocks[0].stamp_ns[0] <= limit for blocks in self._blocks.values()):
            yield from self._slices(self._up_to(limit))

    def take_all(self) -> Iterator[list[SignalBlock]]:
        """Yield everything."""
        yield from self._slices(self._up_to(_FAR))

    def _limit(self, now_s: float) -> int:
        """Return the stamp up to which no signal is waited for."""
        if not self._last_ns:
            return _FAR
        leading = max(self._last_ns, key=self._last_ns.__getitem__)
        newest, newest_s = self._last_ns[leading], self._heard_s[leading]
        limit = _FAR
        for signal, last in self._last_ns.items():
            lag_ns, heard_s, least_s = newest - last, self._heard_s[signal], 0.0
            if last < self._resumed_ns:
                lag_ns, least_s = newest - self._resumed_ns, self._rejoin_s
                heard_s = max(heard_s, self._resumed_s)
            wait_s = max(SHARE * 1e-9 * lag_ns, least_s)
            if lag_ns > self._hold_back_ns and newest_s - heard_s < wait_s:
                wait_s = MOST_WAIT_S
            if now_s - heard_s < min(wait_s, MOST_WAIT_S):
                limit = min(limit, last)
        return limit

    def _up_to(self, limit: int) -> list[SignalBlock]:
        """Remove and return the samples up to a stamp, joined by signal."""
        if limit >= _FAR:
            whole = [join_blocks(parts) for parts in self._blocks.values()]
            self._blocks = {}
            return whole
        taken, left = [], {}
        for signal, parts in self._blocks.items():
            block = join_blocks(parts)
            n = int(np.searchsorted(block.stamp_ns, limit, side="right"))
            if n:
                taken.append(cut_block(block, slice(n)))
            if n < len(block.stamp_ns):
                left[signal] = [cut_block(block, slice(n, None))]
        self._blocks = left
        return taken

    def _slices(self, blocks: list[SignalBlock]) -> Iterator[list[SignalBlock]]:
        """Yield the blocks cut at multiples of the slice after their beginning.

        A sample waits for all before it in its block. What takes time is the number of samples,
        not the time between them: a clock may be set on by years.
        """
        if not blocks:
            return
        begin = min(int(b.stamp_ns[0]) for b in blocks)
        span = max(int(b.stamp_ns[-1]) for b in blocks) - begin
        if span <= self._slice_ns:
            yield blocks
            return
        numbers = [
            np.maximum.accumulate(np.maximum(-((begin - b.stamp_ns) // self._slice_ns), 1))
            for b in blocks
        ]
        for k in np.unique(np.concatenate(numbers)):
            parts = []
            for block, number in zip(blocks, numbers, strict=True):
                first, end = np.searchsorted(number, [k, k + 1])
                if end > first:
                    parts.append(cut_block(block, slice(int(first), int(end))))
            yield parts
