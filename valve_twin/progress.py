# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A progress bar on standard error; where that is no terminal, a line a minute."""

from __future__ import annotations

import sys
import time
from collections import deque
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.progress import Progress, TaskID

_EVERY_S = 60.0  # a line where no bar can be shown
_RECENT = 32  # steps whose pace tells the time that remains


class Steps:
    """What is done of what; call it once a step.

    Parameters
    ----------
    what : str
        What is being done.
    total : int or None
        Steps, None where nobody knows.
    """

    def __init__(self, what: str, total: int | None) -> None:
        self.what, self.total, self.done = what, total, 0
        self._ends = deque([time.monotonic()], _RECENT)

    def __call__(self) -> None:
        """Count a step."""
        self.done += 1
        self._ends.append(time.monotonic())

    def more(self, count: int) -> None:
        """Expect further steps.

        Parameters
        ----------
        count : int
            How many [1].
        """
        self.total = (self.total or 0) + count

    def line(self) -> str:
        """Return where the work stands, in one line."""
        if self.total is None:
            return f"{self.what}: {self.done} done"
        said = f"{self.what}: {self.done} of {self.total} done"
        if not self.done:
            return said
        pace = (self._ends[-1] - self._ends[0]) / (len(self._ends) - 1)
        left = pace * (self.total - self.done)
        return f"{said}, about {left / 60.0:.1f} min left"


@contextmanager
def progress(what: str, total: int | None, every_s: float = _EVERY_S) -> Iterator[Steps]:
    """Show a bar while the block runs, or a line now and then; the block calls the result.

    Parameters
    ----------
    what : str
        What is being done.
    total : int or None
        Steps, None where nobody knows: the bar then counts only.
    every_s : float
        Time between lines where standard error is no terminal [s].
    """
    steps, ended = Steps(what, total), Event()
    to = sys.stderr
    if to is None or to.closed or not to.isatty():  # none of a service of Windows or with 2>&-

        def tell() -> None:
            while not ended.wait(every_s):
                with suppress(OSError, ValueError, AttributeError):  # nobody can be told
                    to.write(f"{steps.line()}\n")
                    to.flush()

        told = Thread(target=tell, daemon=True)
        told.start()
        try:
            yield steps
        finally:
            ended.set()
            told.join()
        return
    from rich.console import Console  # with what it needs 70 ms of CPU
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    with bar:
        task = bar.add_task(what, total=total)
        yield _Shown(what, total, bar, task)


class _Shown(Steps):
    """Steps on a bar."""

    def __init__(self, what: str, total: int | None, bar: Progress, task: TaskID) -> None:
        super().__init__(what, total)
        self._bar, self._task = bar, task

    def __call__(self) -> None:
        super().__call__()
        self._bar.advance(self._task)

    def more(self, count: int) -> None:
        super().more(count)
        self._bar.update(self._task, total=self.total)
