# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Nodes as forks of a process that has imported them: 0.4 s of CPU to an active twin, not 0.9.

Run as a program this is that process, the mother. It has no context of ROS and no thread that
computes, and each fork goes the way of `python -m valve_twin.nodes.runtime.executables` from its
first line on, with an environment of its own. A fork becomes a child of the test's process, as one
that it started itself: the mother forks a second time and lets the one between end, and orphans go
to the nearest process that wants them. Tests of imports, memory or compiling begin afresh.
"""

from __future__ import annotations

import ctypes
import functools
import gc
import json
import multiprocessing
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
import warnings
from importlib import import_module
from multiprocessing import forkserver
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
MODULE = "valve_twin.nodes.runtime.executables"
ROOMS = {
    "twin": "twin",
    "simulated_valve": "simulator",
    "aging_monitor": "aging",
    "bag_player": "player",
    "bag_recorder": "recorder",
}
"""Nodes that the mother has loaded, and their rooms."""

_PATH = os.environ.get("PYTHONPATH")
TASKS = Path("/proc/self/task")
_WANT_ORPHANS = 36  # PR_SET_CHILD_SUBREAPER
_ANSWER_S = 120.0


class Order(NamedTuple):
    """What a fork gets of its own."""

    arguments: list[str]
    environment: dict[str, str]
    folder: str
    log: str


class Forked:
    """A fork, with what the tests use of `subprocess.Popen`."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, None while it runs."""
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            if ended:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code once it has ended."""
        end = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if end is not None and time.monotonic() > end:
                raise subprocess.TimeoutExpired([MODULE], timeout or 0.0)
            time.sleep(0.002)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal while it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


class Mother:
    """The process that forks, as the test's process sees it; it ends with the latter."""

    def __init__(self) -> None:
        self._line, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._line.settimeout(_ANSWER_S)
        command = [sys.executable, "-u", __file__, str(theirs.fileno())]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment, pass_fds=[theirs.fileno()]
        )
        theirs.close()

    def fork(self, command: list[str], environment: dict[str, str], log: Path) -> Forked:
        """Return a process that does what the command would, its output in a file."""
        arguments = command[command.index(MODULE) + 1 :]
        order = Order(arguments, environment, os.getcwd(), str(log))
        _want_orphans(1)
        try:
            self._line.send(json.dumps(order).encode())
            return Forked(int(self._line.recv(64)))
        finally:
            _want_orphans(0)


@functools.cache
def mother() -> Mother:
    """Return the mother of this process, begun with the first call."""
    return Mother()


def can_fork(name: str) -> bool:
    """Return whether a fork is what a fresh process would be: with a path of its own it is not."""
    return name in ROOMS and os.environ.get("PYTHONPATH") == _PATH


def warm_worker() -> None:
    """Let twins fork the process that estimates from one that is warm and has no threads.

    A fresh interpreter takes 1 s of CPU until it estimates, a fork of this one 0.1 s. It ends when
    a twin is killed while it asks (EOFError in `multiprocessing.forkserver`), and is begun anew.
    """
    worker: Any = import_module("valve_twin.nodes.runtime.worker")
    worker.START_METHOD = "forkserver"
    multiprocessing.set_forkserver_preload(["warmed"])
    before = os.environ.get("PYTHONPATH")  # no path but this one reaches what is preloaded
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), before or ""])
    try:
        forkserver.ensure_running()
    finally:
        os.environ.pop("PYTHONPATH")
        os.environ |= {} if before is None else {"PYTHONPATH": before}


def _want_orphans(wanted: int) -> None:
    """Let orphaned descendants become children of this process."""
    if ctypes.CDLL(None, use_errno=True).prctl(_WANT_ORPHANS, wanted, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")


def _load() -> None:
    gc.disable()  # as a node does until it has started
    sys.path[0] = str(ROOT)  # as `python -m` has it
    import_module("valve_twin.one_thread")
    interpreter = import_module("valve_twin.compat.interpreter")
    interpreter.spare_imports()
    import_module("valve_twin.compat.ros").load_types_alone()
    interpreter.load_kernels_alone()
    import_module("rclpy")  # LTTng in it begins two threads, which wait for a tracer
    threads = len(list(TASKS.iterdir()))
    for room in ("runtime", *ROOMS.values()):
        import_module(f"valve_twin.nodes.{room}.node")
    warm_worker()
    gc.freeze()
    assert len(list(TASKS.iterdir())) == threads, "a fork would lose a thread that computes"


def _next(line: socket.socket) -> Order | None:
    """Return in a fork what it is to be, and None where no more are wanted."""
    while message := line.recv(2**20):
        warm_worker()
        receive, send = os.pipe()
        between = _fork()
        if not between:
            child = _fork()
            if child:
                os.write(send, b"%d" % child)
                os._exit(0)
            os.close(receive)
            os.close(send)
            line.close()
            return Order(*json.loads(message))
        os.close(send)
        os.waitpid(between, 0)
        line.send(os.read(receive, 64))
        os.close(receive)
    return None


def _fork() -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # from Python 3.12 on, of LTTng's
        return os.fork()


def _become(order: Order) -> None:
    log = os.open(order.log, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(log, number)
    os.close(log)
    os.environ.clear()
    os.environ |= order.environment
    os.chdir(order.folder)
    sys.path[0] = order.folder
    sys.argv = [MODULE, *order.arguments]
    ask: Any = forkserver.connect_to_new_process
    ask.__self__.ensure_running = lambda: None  # the mother's, no child of this process
    gc.enable()


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as requests:
        _load()
        wanted = _next(requests)
    if wanted is not None:
        _become(wanted)
        runpy.run_module(MODULE, run_name="__main__", alter_sys=True)
