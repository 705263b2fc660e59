# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Give memory back to the system after the start, after a backlog, and now and then.

While estimations wait, so do their cycles and the samples behind them, about 110 kB a cycle of
850 samples. Afterwards all of it is free, but glibc keeps most: it lets go only of the top of its
heap, where something small lives on. The imports of a start leave some, too.

What is too short for a backlog leaves some as well: an estimation that comes 3 s late five times,
or a process that stands still for 0.8 s, raised what the heap of a twin at 10 kHz holds by 5 MB
while what it uses stayed as it was, each in a step. Nothing tells of those, so memory is given
back every minute.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

BEHIND_S = 1.0
"""A sample that was on its way for this long tells of a backlog [s]."""

PAUSE_S = 10.0
"""Least time between two attempts: one takes about 0.1 ms a MB that is free [s]."""

EVERY_S = 60.0
"""Longest time between two attempts while nothing waits [s]."""


def trim_memory() -> bool:
    """Return free pages to the system; whether there were any, False without glibc."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim is not None and bool(trim(0))


class MemoryTrimmer:
    """Gives memory back when the start or a backlog has passed, and every minute without one.

    Parameters
    ----------
    most : int
        Estimations that may wait without being a backlog [1].
    act : callable
        Gives the memory back.
    """

    def __init__(self, most: int, act: Callable[[], object] = trim_memory) -> None:
        self._most, self._act = most, act
        self._owed = True
        self._last_s = -float("inf")

    def look(self, waiting: int, late_s: float, now_s: float) -> None:
        """Look at the backlog, about once a second.

        Parameters
        ----------
        waiting : int
            Estimations that wait [1].
        late_s : float
            Longest way of a sample since the last look [s].
        now_s : float
            The steady clock [s].
        """
        if waiting > self._most or late_s > BEHIND_S:
            self._owed = True
        elif now_s - self._last_s >= (PAUSE_S if self._owed else EVERY_S):
            self._owed, self._last_s = False, now_s
            self._act()
