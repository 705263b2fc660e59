# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Keep cycles that wait for their estimation within a budget of memory, the rest on disk.

The order stays, and what comes back from the disk has the same bits. Where the disk takes no more
either, the oldest cycles are dropped and counted. At a clean stop the cycles stay on disk, and a
snapshot of the twin names them instead of holding them: the next process takes them over.
"""

from __future__ import annotations

import shutil
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from valve_twin.core.job_queue import JobQueue
from valve_twin.io.history.snapshot import load_cycle, save_cycle
from valve_twin.io.sealed import flush, flush_folder

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from valve_twin.core.job_queue import QueuedJob
    from valve_twin.core.types import Cycle

SAMPLE_BYTES = 130
"""Memory of a sample of a waiting cycle, measured: 110 kB for 850 samples [B]."""

FREE_BYTES = 256 * 2**20
"""Space on the disk that is left to others [B]."""


@dataclass(slots=True)
class MemoryBudget:
    """Memory that all queues of a process share.

    Attributes
    ----------
    limit, used : int
        What may be used and what is [B].
    """

    limit: int
    used: int = 0

    def has_room(self, size: int) -> bool:
        """Return whether so many bytes more are within the limit [B]."""
        return self.used + size <= self.limit


@dataclass(slots=True)
class _Entry:
    """A job: its cycle in memory, on disk, or dropped; small, for there may be many."""

    ordinal: int
    cycle: Cycle | None = None
    is_spooled: bool = False
    size: int = 0


class CycleSpool(JobQueue):
    """The waiting cycles of one valve.

    Parameters
    ----------
    budget : MemoryBudget
        Shared with the other valves.
    folder : Path or None
        Where cycles beyond the budget are kept; None = nowhere.
    jobs : iterable of (int, Cycle or None)
        What waits from the beginning; one without a cycle is taken from the folder if it is there.
    floor : int
        Space on the disk that is left to others [B].
    makes_parents : bool
        Whether the folders above are made, too; not where they go with a disk.

    Attributes
    ----------
    spooled, written, dropped : int
        Cycles that are on disk now, that were put there, and that were dropped [1].
    left : int
        Cycles in the folder that no job names, deleted now: their process was killed [1].
    trouble : str
        Where and why the disk did not take or give back the last cycle that was dropped.
    """

    def __init__(
        self,
        budget: MemoryBudget,
        folder: Path | None,
        jobs: Iterable[QueuedJob] = (),
        *,
        floor: int = FREE_BYTES,
        makes_parents: bool = False,
    ) -> None:
        super().__init__()
        self._budget, self._folder, self._floor = budget, folder, floor
        self._makes_parents = makes_parents
        self._entries: deque[_Entry] = deque()
        self.written = self.spooled = self.dropped = 0
        self._stays, self.trouble = False, ""
        jobs = tuple(jobs)
        self.left = self._clear(jobs)
        for ordinal, cycle in jobs:
            path = self._path(ordinal)
            if cycle is None and path is not None and path.exists():
                self._entries.append(_Entry(ordinal, is_spooled=True))
                self.spooled += 1
            else:
                self.append(ordinal, cycle)

    def __len__(self) -> int:
        """Return how many wait [1]."""
        return len(self._entries)

    def __iter__(self) -> Iterator[QueuedJob]:
        """Go through all without taking any; what is on disk is read.

        Of what stays there only the first and the last: a restart has to know when they were.
        """
        for place, entry in enumerate(tuple(self._entries)):
            inside = 0 < place < len(self._entries) - 1
            known = not (self._stays and inside and entry.is_spooled)
            yield entry.ordinal, self._cycle_of(entry) if known else None

    @property
    def held(self) -> int:
        """Memory of the cycles that are not on disk [B]."""
        return sum(entry.size for entry in self._entries if entry.cycle is not None)

    @property
    def begins_dropped(self) -> bool:
        """Whether the next one was dropped; False where none waits."""
        first = self._entries[0] if self._entries else None
        return first is not None and first.cycle is None and not first.is_spooled

    def append(self, ordinal: int, cycle: Cycle | None) -> None:
        """Add the newest: in memory, else on disk, else in place of the oldest.

        Parameters
        ----------
        ordinal : int
            Count of the cycle [1].
        cycle : Cycle or None
            None = it was dropped.
        """
        entry = _Entry(ordinal, cycle)
        if cycle is not None:
            entry.size = SAMPLE_BYTES * len(cycle.frames.stamp_ns)
            while not (self._budget.has_room(entry.size) or self._put_on_disk(entry)):
                if not self._drop_oldest():
                    break  # the only one stays, whatever it takes
            if not entry.is_spooled:
                self._budget.used += entry.size
        self._entries.append(entry)

    def popleft(self) -> QueuedJob:
        """Take the next; one that the disk does not give back counts as dropped."""
        entry = self._entries.popleft()
        cycle = self._cycle_of(entry)
        if cycle is None and entry.is_spooled:
            self.dropped += 1
            self.trouble = f"{self._path(entry.ordinal)} is gone or damaged"
        self._release(entry)
        return entry.ordinal, cycle

    def stay(self) -> None:
        """Put all on disk and leave it there for the next process."""
        self._stays = True
        for entry in self._entries:
            size = entry.size
            if entry.cycle is not None and self._put_on_disk(entry):
                self._budget.used -= size

    def flush(self) -> None:
        """Have the disk keep over a power cut what stays."""
        if self._folder is not None and self._stays:
            flush(self._folder / f"{e.ordinal}.cycle" for e in self._entries if e.is_spooled)
            flush_folder(self._folder.parent)

    def close(self) -> None:
        """Forget everything, also on disk unless it stays."""
        while self._entries:
            entry = self._entries.popleft()
            if self._stays and entry.is_spooled:
                continue
            self._release(entry)
        if self._folder is not None and not self._stays:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _cycle_of(self, entry: _Entry) -> Cycle | None:
        path = self._path(entry.ordinal)
        return load_cycle(path) if entry.is_spooled and path is not None else entry.cycle

    def _put_on_disk(self, entry: _Entry) -> bool:
        path = self._path(entry.ordinal)
        if self._folder is None or path is None or entry.cycle is None:
            self.trouble = "there is no state_folder"
            return False
        self.written += 1
        try:
            self._folder.mkdir(parents=self._makes_parents, exist_ok=True)
            free = shutil.disk_usage(self._folder).free
            if free < self._floor + entry.size:
                self.trouble = f"{self._folder}: {free / 2**20:.0f} MB are free"
                return False
            save_cycle(path, entry.cycle)
        except OSError as err:
            self.trouble = f"{self._folder}: {err.strerror}"
            _unlink(path)
            return False
        entry.cycle, entry.is_spooled = None, True
        self.spooled += 1
        return True

    def _path(self, ordinal: int) -> Path | None:
        return None if self._folder is None else self._folder / f"{ordinal}.cycle"

    def _clear(self, jobs: Sequence[QueuedJob]) -> int:
        """Remove what another process left and no job names; return how many cycles that was."""
        if self._folder is None or not self._folder.is_dir():
            return 0
        named = {self._path(ordinal) for ordinal, _ in jobs}
        taken = {self._path(ordinal) for ordinal, cycle in jobs if cycle is None}
        found = set(self._folder.glob("*.cycle"))
        for path in found - taken:
            _unlink(path)
        if not found & taken:
            shutil.rmtree(self._folder, ignore_errors=True)
        return len(found - named)

    def _drop_oldest(self) -> bool:
        """Drop the oldest cycle; it keeps its place, so that what was learnt before goes on."""
        for entry in self._entries:
            if entry.cycle is not None or entry.is_spooled:
                self._release(entry)
                self.dropped += 1
                return True
        return False

    def _release(self, entry: _Entry) -> None:
        path = self._path(entry.ordinal)
        if entry.is_spooled and path is not None:
            _unlink(path)
            self.spooled -= 1
        elif entry.cycle is not None:
            self._budget.used -= entry.size
        entry.cycle, entry.is_spooled = None, False


def _unlink(path: Path) -> None:
    with suppress(OSError):  # read only, or gone: what is left is removed at the next start
        path.unlink(missing_ok=True)
