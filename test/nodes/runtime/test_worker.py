# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The process that estimates, as the tests of the nodes have it: forked from a warm one."""

import math
import os
import queue
import signal
import socket
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import pytest

from test.nodes.conftest import has_ended
from test.nodes.forked import mother, warm_worker
from test.programmed import programmed
from valve_twin.nodes.runtime.worker import WorkerProcess

pytestmark = pytest.mark.ros


def warm_of(pid: int) -> list[int]:
    """Return the warm processes that a process has begun and that run."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(p) for p in found if b"forkserver" in Path(f"/proc/{p}/cmdline").read_bytes()]


def is_zombie(pid: int) -> bool:
    """Return whether a process has ended and waits for its parent to hear of it."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def end_warm(address: str) -> None:
    """Ask for a process as a twin does that is killed before it has said what for."""
    with socket.socket(socket.AF_UNIX) as asks:
        asks.connect(address)


def test_a_twin_that_is_killed_while_it_asks_leaves_the_next_ones_a_worker(graph):
    warm_worker()
    server: Any = forkserver._forkserver
    before = server._forkserver_pid
    end_warm(server._forkserver_address)
    graph.spin_until(lambda: has_ended(before), what="the end of the warm process")
    warm_worker()
    assert server._forkserver_pid != before
    outcomes = queue.SimpleQueue[Any]()
    worker = WorkerProcess()
    try:
        worker.submit(math.sqrt, (4.0,), outcomes.put)
        assert outcomes.get(timeout=60.0).result == 2.0
    finally:
        worker.close()


def test_so_does_one_that_is_forked_like_the_others(graph):
    made = mother()._process.pid
    (before,) = graph.spin_until(lambda: warm_of(made), what="the warm process")
    os.kill(before, signal.SIGKILL)
    graph.spin_until(lambda: is_zombie(before), what="its end")
    graph.start("aging_monitor")
    (now,) = graph.spin_until(lambda: warm_of(made), what="another one")
    assert now != before


def test_a_worker_that_starts_by_itself_loads_no_more_than_its_kernels():
    """A quarter of the CPU of its start, and 27 MB, were SciPy, coverage and garbage sought."""
    config = Path(__file__).resolve().parents[3] / "config" / "press_cartridge.yaml"
    code = f"""
import queue
from functools import partial
from valve_twin.io.config.valve import load_config
from valve_twin.nodes.runtime.worker import WorkerProcess
from valve_twin.nodes.twin.estimation_job import warm_up

kinds = [(c.model, c.cycles.rule, c.options) for c in load_config({str(config)!r})]
said = queue.SimpleQueue()
worker = WorkerProcess(partial(warm_up, kinds))
for asked in (
    "len(__import__('gc').get_objects()) < __import__('gc').get_freeze_count()",
    "__import__('gc').isenabled()",
    "'valve_twin.core.valves.press_cartridge.model' in __import__('sys').modules",
    "not {{'scipy.linalg', 'scipy.signal'}} & set(__import__('sys').modules)",
):
    worker.submit(eval, (asked,), said.put)
    outcome = said.get(timeout=120.0)
    assert outcome.result is True, (asked, outcome)
worker.close()
"""
    programmed(code)
