# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sync files on a thread of their own: a slow disk does not hold up what still can be written.

What was written is the kernel's and survives the death of the process at once; the sync makes it
survive a power cut too.
"""

from __future__ import annotations

import os
import queue
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_Key = tuple[int, int]


class BackgroundSync:
    """Stands for `os.fsync`; the error of one call is raised by the next.

    Parameters
    ----------
    sync : callable
        `os.fsync`, or what stands for it in a test.
    """

    def __init__(self, sync: Callable[[int], object] = os.fsync) -> None:
        self._sync = sync
        self._orders: queue.SimpleQueue[tuple[int, _Key] | None] = queue.SimpleQueue()
        self._waiting: set[_Key] = set()
        self._lock = threading.Lock()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._serve, name="sync", daemon=True)
        self._thread.start()

    def __call__(self, number: int) -> None:
        """Have a file synced soon; a sync of it that waits already serves both.

        Raises
        ------
        OSError
            What an earlier sync met.
        """
        error, self._error = self._error, None
        if error is not None:
            raise error
        status = os.fstat(number)
        key = (status.st_dev, status.st_ino)
        with self._lock:
            if key in self._waiting:
                return
            self._waiting.add(key)
        self._orders.put((os.dup(number), key))

    def close(self, timeout_s: float) -> bool:
        """Finish what was ordered; return whether the time was enough."""
        self._orders.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _serve(self) -> None:
        while (order := self._orders.get()) is not None:
            number, key = order
            with self._lock:
                self._waiting.discard(key)
            try:
                self._sync(number)
            except OSError as err:
                self._error = err
            finally:
                with suppress(OSError):
                    os.close(number)
