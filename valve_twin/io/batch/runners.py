# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Run many tasks: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Generic, TypeVar
from weakref import finalize

from valve_twin import __version__
from valve_twin.compat.interpreter import end_processes, load_kernels_alone
from valve_twin.io.errors import ValveTwinError
from valve_twin.io.uncollected import collect_rarely

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from concurrent.futures import Future

T = TypeVar("T")
R = TypeVar("R")

CONNECT_S = 10.0
"""How long to wait for the scheduler of a cluster [s]."""


def core_count() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS and Windows do not tell


class LocalRunner(Generic[T, R]):
    """Runs tasks in processes of this machine.

    Parameters
    ----------
    jobs : int
        Processes at the same time.
    work : callable
        Does a task; a function that can be pickled.
    lost : callable
        Returns the result of a task that was not done, and why.
    keep : bool
        Whether processes live on for the next call, with what they remember.
    """

    def __init__(
        self, jobs: int, work: Callable[[T], R], lost: Callable[[T, str], R], *, keep: bool = False
    ) -> None:
        self._jobs, self._work, self._lost, self._keep = jobs, work, lost, keep
        self._pool: ProcessPoolExecutor | None = None

    def __call__(self, tasks: Sequence[T]) -> Iterator[R]:
        """Yield results as they are done; a task that takes its process down is named.

        Where a process dies, all tasks that ran then are tried again, each alone, so that the one
        that did it is found and the others are not lost.
        """
        left, suspects = list(tasks), list[T]()
        while left:
            yield from self._until_broken(left, suspects, min(self._jobs, len(left)))
            while suspects:
                alone = [suspects.pop()]
                died: list[T] = []
                yield from self._until_broken(alone, died, 1)
                for task in (*died, *alone):
                    yield self._lost(
                        task,
                        "its process was killed twice, by the system or by a fault; is there "
                        "enough memory?",
                    )

    def _until_broken(self, left: list[T], suspects: list[T], jobs: int) -> Iterator[R]:
        """Take tasks from `left` until none is left or a process died: those are `suspects`."""
        pool, self._pool = self._pool, None
        if pool is None:
            pool = _opened(self._jobs if self._keep else jobs)
            finalize(self, pool.shutdown, wait=False)
        running: dict[Future[R], T] = {}
        try:
            while left or running:
                while left and len(running) < jobs:
                    running[pool.submit(self._work, left[0])] = left[0]
                    left.pop(0)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    running.pop(future)
                    yield result
        except BrokenProcessPool:  # a process died: any that ran may have done it
            suspects += running.values()
        except BaseException:
            end_processes(pool)  # an interrupted batch does not wait for a long bag
            raise
        else:
            if self._keep:
                self._pool = pool
        finally:
            if self._pool is not pool:
                pool.shutdown(wait=False, cancel_futures=True)


def _opened(jobs: int) -> ProcessPoolExecutor:
    """Return processes that start when there is work for them."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # inherited: one core a process
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(jobs, mp_context=context, initializer=_make_ready)


def _make_ready() -> None:
    """Leave Ctrl-C to the process that hands out the tasks; load what a task takes, no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_rarely()
    load_kernels_alone(of_arrays=True)


class ClusterRunner(Generic[T, R]):
    """Runs tasks on the workers of a Dask scheduler, which must see files at the same paths.

    Parameters
    ----------
    address : str
        Of the scheduler, such as tcp://plant-server:8786.
    work, lost : callable
        As of `LocalRunner`.

    Raises
    ------
    ValveTwinError
        If distributed is not installed, the scheduler does not answer, it has no workers, or a
        worker has another version of valve_twin, whose results could differ.
    """

    def __init__(self, address: str, work: Callable[[T], R], lost: Callable[[T, str], R]) -> None:
        self._work, self._lost = work, lost
        try:
            from distributed import Client
        except ImportError as err:
            msg = (
                "--scheduler: the package 'distributed' is not installed; "
                "python -m pip install 'valve_twin[dask]', or leave --scheduler out"
            )
            raise ValveTwinError(msg) from err
        try:
            self._client = Client(address, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
        except (OSError, ValueError, TimeoutError) as err:
            msg = (
                f"--scheduler {address}: does not answer ({_line(err)}); start it with "
                "'dask scheduler' and give its address"
            )
            raise ValveTwinError(msg) from err
        try:
            self._check_workers(address)
        except BaseException:
            self._client.close()  # type: ignore[no-untyped-call]
            raise

    def _check_workers(self, address: str) -> None:
        versions = self._client.run(_version)
        if not versions:
            msg = f"--scheduler {address}: has no workers; start some with 'dask worker {address}'"
            raise ValveTwinError(msg)
        for worker, version in sorted(versions.items()):
            if version != __version__:
                msg = (
                    f"--scheduler {address}: worker {worker} has valve_twin {version}, this is "
                    f"{__version__}; install the same version everywhere"
                )
                raise ValveTwinError(msg)

    def __call__(self, tasks: Sequence[T]) -> Iterator[R]:
        """Yield results as they are done; a task whose workers die is named."""
        from distributed import as_completed

        try:
            futures = {self._client.submit(self._work, t, pure=False): t for t in tasks}
            done = as_completed(list(futures))  # type: ignore[no-untyped-call]
            for future in done:
                task = futures.pop(future)
                error = future.exception()
                if error is None:
                    yield future.result()
                else:
                    yield self._lost(task, _line(error))
                future.release()
        finally:
            self._client.close()  # type: ignore[no-untyped-call]


def _version() -> str:
    return __version__


def _line(err: BaseException) -> str:
    return " ".join(f"{type(err).__name__}: {err}".split())
