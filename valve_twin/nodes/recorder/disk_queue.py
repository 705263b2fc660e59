# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Messages on their way to the disk: bounded, handed over in batches, never waited for."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from valve_twin.nodes.runtime.worker import Outcome, WorkerThread

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.io.recording.recorder import Recording
    from valve_twin.io.recording.ring_buffer import RecordedMessage
    from valve_twin.nodes.runtime.node import ValveNode

PERIOD_S = 0.05
"""Pause between two batches: a message a batch would cost two switches of thread [s]."""

EARLY = 2000
"""Messages that are handed over before that [1]."""


class DiskQueue:
    """Queue before a recording and the thread that serves it.

    Parameters
    ----------
    node : ValveNode
        The recorder; results come back on its thread.
    recording : Recording
        What is written; touched by this thread only.
    limit, limit_bytes : int
        Messages and bytes that may wait [1], [B].
    """

    def __init__(
        self, node: ValveNode, recording: Recording, *, limit: int, limit_bytes: int
    ) -> None:
        self._node, self._recording = node, recording
        self._limit, self._limit_bytes = limit, limit_bytes
        self._thread = WorkerThread("bag")
        self._waiting: list[RecordedMessage] = []
        self._waiting_bytes = self._handed = self._handed_bytes = 0
        self._busy = False
        self._next_s = 0.0

    def push(self, message: RecordedMessage) -> bool:
        """Append a message; return whether there was room."""
        size = len(message.data)
        taken = self._waiting_bytes + self._handed_bytes
        if len(self) >= self._limit or taken + size > self._limit_bytes:
            return False
        self._waiting.append(message)
        self._waiting_bytes += size
        return True

    def __len__(self) -> int:
        """Return the number of messages that are not written yet."""
        return len(self._waiting) + self._handed

    def work(self) -> None:
        """Hand over what waits, one batch at a time; the disk looks after itself between."""
        now = time.monotonic()
        if self._busy or (now < self._next_s and len(self._waiting) < EARLY):
            return
        self._busy, self._next_s = True, now + PERIOD_S
        self._handed_bytes = self._waiting_bytes
        batch = self._take()
        self._handed = len(batch)
        action = partial(self._recording.write, batch) if batch else self._recording.tick
        self._thread.submit(action, self._back(self._on_written))

    def do(self, action: Callable[[], Any], done: Callable[[Outcome], None] | None = None) -> None:
        """Write what waits, then run an action there.

        Parameters
        ----------
        action : callable
            Touches the recording.
        done : callable, optional
            Gets the outcome on the node's thread; without it an error is logged.
        """
        self._thread.submit(
            partial(self._then, self._take(), action), self._back(done or self._log)
        )

    def _then(self, batch: list[RecordedMessage], action: Callable[[], Any]) -> Any:
        if batch:
            self._recording.write(batch)
        return action()

    def _take(self) -> list[RecordedMessage]:
        batch, self._waiting, self._waiting_bytes = self._waiting, [], 0
        return batch

    def _back(self, deliver: Callable[[Outcome], None]) -> Callable[[Outcome], None]:
        return lambda outcome: self._node.post(partial(deliver, outcome))

    def close(self, timeout_s: float) -> bool:
        """Write the rest and finish the bag; return whether the time was enough."""
        batch = self._take()

        def finish() -> None:
            try:
                self._recording.write(batch)
            finally:
                self._recording.close()

        self._thread.submit(finish, self._log)
        return self._thread.close(timeout_s)

    def _on_written(self, outcome: Outcome) -> None:
        self._busy = False
        self._handed = self._handed_bytes = 0
        self._log(outcome)

    def _log(self, outcome: Outcome) -> None:
        if outcome.error:
            self._node.get_logger().error(f"not recorded: {outcome.error}")
