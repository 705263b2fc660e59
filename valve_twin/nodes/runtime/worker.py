# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Work that must not hold up the data path: a process for computations, a thread for the database.

Both take jobs in order, drop none and hand the results to a callback on their own thread;
`ValveNode.post` brings them back to the node's loop.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import queue
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from valve_twin.compat.interpreter import load_kernels_alone
from valve_twin.io.errors import ValveTwinError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Work = Callable[..., Any]
Deliver = Callable[["Outcome"], None]

ATTEMPTS = 3
"""How often a job is tried that takes its process down."""

START_S = 1.0
"""How long the end of a node waits for a process that is just being started [s]."""

START_METHOD = "spawn"
"""How `multiprocessing` makes the process: forking one that holds DDS threads is not safe."""

NICENESS = 5
"""Priority below the data path's, so that an estimation does not delay a prediction."""

LAST = 5
"""Further below, of work that no estimation waits for. With 14 two cores that four programs keep
busy left it a hundredth of one: an error budget of two realisations took four minutes."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a job gave: its result or one line of error, and the computing time [s]."""

    result: Any
    error: str
    wall_s: float


@dataclass(frozen=True, slots=True)
class _Order:
    work: Work
    arguments: tuple[Any, ...]
    deliver: Deliver


class WorkerProcess:
    """Process that runs module-level functions in order; restarted when it dies, job repeated.

    Not an executor of `concurrent.futures` (tried on 3.11): its process outlives a twin that is
    killed (python/cpython#111873), and one that dies fails all jobs, to be kept here all the same.
    """

    def __init__(self, warm_up: Work | None = None) -> None:
        self._orders: queue.SimpleQueue[_Order | None] = queue.SimpleQueue()
        self._warm_up = warm_up
        self._process: Any = None
        self._pipe: Connection | None = None
        self._closing = False
        self._begun = threading.Event()
        self.restarts = -1
        self._thread = threading.Thread(target=self._serve, name="worker", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int | None:
        """Process id, None while there is no process."""
        return self._process.pid if self._process is not None else None

    def begin(self) -> None:
        """Start the process ahead of the first job, once what is more urgent is done."""
        self._begun.set()

    def submit(self, work: Work, arguments: tuple[Any, ...], deliver: Deliver) -> None:
        """Run `work(*arguments)` in the process after all earlier jobs.

        Parameters
        ----------
        work : callable
            Function of a module, found there by its name.
        arguments : tuple
            What it gets, sent to the process by pickle as is its result.
        deliver : callable
            Gets the outcome, on the thread that waits for the process.
        """
        self._orders.put(_Order(work, arguments, deliver))
        self._begun.set()

    def close(self) -> None:
        """End the process now; what runs in it is lost."""
        self._closing = True
        self._orders.put(None)
        self._begun.set()
        if self._process is not None:
            self._process.kill()
        self._thread.join(timeout=START_S)

    def _serve(self) -> None:
        self._begun.wait()
        with suppress(Exception):  # tried again, and told, with the first job
            if not self._closing:
                self._start()
        while not self._closing:
            order = self._orders.get()
            if order is None or self._closing:
                return
            outcome = self._try(order)
            if not self._closing:
                order.deliver(outcome)

    def _try(self, order: _Order) -> Outcome:
        for _ in range(ATTEMPTS):
            try:
                if self._pipe is None:
                    self._start()
                assert self._pipe is not None
                self._pipe.send((order.work, order.arguments))
                outcome: Outcome = self._pipe.recv()
            except (OSError, EOFError):
                self._pipe = None
                if self._closing:
                    break
            except Exception as err:
                self._pipe = None
                return Outcome(None, f"the worker cannot run: {type(err).__name__}: {err}", 0.0)
            else:
                return outcome
        return Outcome(None, f"the worker process died {ATTEMPTS} times on this job", 0.0)

    def _start(self) -> None:
        context: Any = multiprocessing.get_context(START_METHOD)
        self._pipe, theirs = context.Pipe()
        warm_up = pickle.dumps(self._warm_up)  # whose modules wait until the child is ready
        process = context.Process(target=_child, args=(theirs, warm_up), daemon=True)
        process.start()
        self._process = process  # only now can it be killed
        theirs.close()
        self.restarts += 1
        if self._closing:
            process.kill()


def _child(pipe: Connection, packed: bytes) -> None:
    """Serve jobs until the parent closes the pipe, by whatever death."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    os.nice(NICENESS)
    gc.disable()  # imports make hardly any garbage
    load_kernels_alone(of_arrays=True)
    with suppress(Exception):
        warm_up: Work | None = pickle.loads(packed)
        if warm_up is not None:
            warm_up()
    gc.freeze()
    gc.enable()
    with suppress(EOFError, OSError):
        while True:
            work, arguments = pipe.recv()
            pipe.send(_execute(work, arguments))


def _execute(work: Work, arguments: tuple[Any, ...]) -> Outcome:
    begin = time.perf_counter()
    try:
        result = work(*arguments)
    except Exception as err:
        text = str(err) if isinstance(err, ValveTwinError) else f"{type(err).__name__}: {err}"
        return Outcome(None, text, time.perf_counter() - begin)
    return Outcome(result, "", time.perf_counter() - begin)


class WorkerThread:
    """One thread that runs closures in order, for the database and for files."""

    def __init__(self, name: str) -> None:
        self._orders: queue.SimpleQueue[_Order | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._serve, name=name, daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Jobs not begun."""
        return self._orders.qsize()

    def submit(self, work: Work, deliver: Deliver) -> None:
        """Run `work()` after all earlier jobs; `deliver` gets the outcome on this thread."""
        self._orders.put(_Order(work, (), deliver))

    def close(self, timeout_s: float = 1.0) -> bool:
        """Finish what is queued within the time given; return whether it was enough."""
        self._orders.put(None)
        self._thread.join(timeout=timeout_s)
        return not self._thread.is_alive()

    def _serve(self) -> None:
        while (order := self._orders.get()) is not None:
            order.deliver(_execute(order.work, order.arguments))
