# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Write and flush the files of cycles that wait for a server, so that a power cut leaves them.

To write a file costs the data path a fraction of a millisecond, to flush it as long as the disk
likes: that is done on a thread of its own, for all files that came meanwhile in one go.
"""

from __future__ import annotations

import threading
from functools import partial
from typing import TYPE_CHECKING, Generic, TypeVar

from valve_twin.io.errors import unwritable
from valve_twin.nodes.runtime.worker import WorkerThread

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from valve_twin.io.history.unsaved import UnsavedCycle, UnsavedCycles
    from valve_twin.nodes.runtime.node import ValveNode
    from valve_twin.nodes.runtime.worker import Outcome

Kept = TypeVar("Kept")


class Flusher(Generic[Kept]):
    """Flushes what is kept of waiting cycles.

    Parameters
    ----------
    node : ValveNode
        On whose loop it is told.
    unsaved : UnsavedCycles
        Keeps the files.
    tell : callable
        Told what was to be flushed, and whether the disk has it now.
    """

    def __init__(
        self,
        node: ValveNode,
        unsaved: UnsavedCycles,
        tell: Callable[[list[tuple[Kept, bool]]], None],
    ) -> None:
        self._node, self._unsaved, self._tell = node, unsaved, tell
        self._thread = WorkerThread("flush")
        self._gathered: list[tuple[Kept, Path]] = []
        self._lock = threading.Lock()
        self._unkept = ""
        try:
            unsaved.prepare()
        except OSError as err:
            self._tell_unkept(err)

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return self._unsaved.folder

    def put(self, kept: Kept, valve: str, cycle: UnsavedCycle) -> Path | None:
        """Write the file of what is kept; None where the disk does not take it, which is told.

        Parameters
        ----------
        kept : object
            What is told once it is flushed.
        valve : str
            Whose it is.
        cycle : UnsavedCycle
            What is written.
        """
        try:
            file = self._unsaved.put(valve, cycle)
        except OSError as err:
            self._tell_unkept(err)
            return None
        if self._unkept:
            self._node.get_logger().warning(f"{self.folder}: is written again")
        self._unkept = ""
        self._add(kept, file)
        return file

    def _tell_unkept(self, err: OSError) -> None:
        """Say once that cycles are in memory only while the history does not take them."""
        why = unwritable(self.folder, err)
        if why != self._unkept:
            self._node.get_logger().error(
                f"state_folder {why}; cycles that wait for the history are kept in memory, up to "
                "unsaved_limit"
            )
        self._unkept = why

    def _add(self, kept: Kept, file: Path) -> None:
        """Flush the file of what is kept soon."""
        with self._lock:
            self._gathered.append((kept, file))
            first = len(self._gathered) == 1
        if first:
            self._thread.submit(self._flush, self._deliver)

    def close(self, timeout_s: float) -> bool:
        """Flush what was added; return whether the time was enough [s]."""
        return self._thread.close(timeout_s)

    def _flush(self) -> list[tuple[Kept, bool]]:
        with self._lock:
            gathered, self._gathered = self._gathered, []
        done = self._unsaved.flush([path for _, path in gathered])
        return [(kept, path in done) for kept, path in gathered]

    def _deliver(self, outcome: Outcome) -> None:
        self._node.post(partial(self._tell, outcome.result or []))
