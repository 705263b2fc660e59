# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Give memory back to the system after the start and after a backlog.

While estimations wait, so do their cycles and the samples behind them, about 110 kB a cycle of
850 samples. Afterwards all of it is free, but glibc keeps most: it lets go only of the top of its
heap, where something small lives on. The imports of a start leave some, too.
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


def trim_memory() -> bool:
    """Return free pages to the system; whether there were any, False without glibc."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim is not None and bool(trim(0))


class MemoryTrimmer:
    """Gives memory back once, when the start or a backlog has passed.

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
        elif self._owed and now_s - self._last_s >= PAUSE_S:
            self._owed, self._last_s = False, now_s
            self._act()
