# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Closed cycles that wait for their estimation, in their order."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from valve_twin.core.types import Cycle

    QueuedJob = tuple[int, Cycle | None]


class JobQueue:
    """Jobs by ordinal; a cycle that was dropped keeps its place as None.

    Parameters
    ----------
    jobs : iterable of (int, Cycle or None)
        What waits from the beginning.
    """

    def __init__(self, jobs: Iterable[QueuedJob] = ()) -> None:
        self._jobs: deque[QueuedJob] = deque(jobs)

    def __len__(self) -> int:
        """Return how many wait [1]."""
        return len(self._jobs)

    def __iter__(self) -> Iterator[QueuedJob]:
        """Go through all without taking any."""
        return iter(tuple(self._jobs))

    @property
    def begins_dropped(self) -> bool:
        """Whether the next one was dropped; False where none waits."""
        return bool(self._jobs) and self._jobs[0][1] is None

    def append(self, ordinal: int, cycle: Cycle | None) -> None:
        """Add the newest.

        Parameters
        ----------
        ordinal : int
            Count of the cycle [1].
        cycle : Cycle or None
            None = it was dropped.
        """
        self._jobs.append((ordinal, cycle))

    def popleft(self) -> QueuedJob:
        """Take the next."""
        return self._jobs.popleft()
