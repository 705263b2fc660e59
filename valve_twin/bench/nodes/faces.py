# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What the pages cost: the twin beside them, a core, and whoever opens them first."""

from __future__ import annotations

import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from valve_twin.bench.data.years import life
from valve_twin.bench.measure import Better, Ratio
from valve_twin.bench.nodes.live import CYCLE, PLANT_HZ, VALVES, live
from valve_twin.bench.nodes.processes import some_domain, start_node
from valve_twin.io.history.store import CycleRecord, History

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from valve_twin.bench.measure import Scale
    from valve_twin.bench.nodes.live import Live
    from valve_twin.bench.nodes.processes import NodeProcess

VIEWERS = 20
"""Who looks at the same time [1]."""

PAIRS = 6
"""Blocks with viewers, and as many without, in turn [1]."""

CYCLES = 4
"""Production cycles of a block [1]."""

SHARE = 0.08
"""Goal: share of a core [1]."""

FIRST_S = 1.0
"""Goal: time to the first content [s]."""

_PROGRAM = Path(__file__).parent / "viewers.py"


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area; a short run has none, they take two minutes."""
    if scale.quick:
        return
    yield _delay()
    yield from _fleet()


@contextmanager
def _gateway(valves: Sequence[str], cycles: int) -> Iterator[tuple[NodeProcess, str]]:
    """Serve the pages of valves of /press with a history of so many cycles each."""
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        path = Path(name) / "history.sqlite"
        with History(path) as history:
            for valve in valves:
                for estimate in life(cycles):
                    times = estimate.start_ns, estimate.end_ns
                    record = CycleRecord(estimate.cycle, *times, CYCLE)
                    history.store(f"/press/{valve}", record, (estimate,))
        parameters = {"model": "press_cartridge", "valves": list(valves), "port": 0}
        parameters["history_url"] = f"sqlite:///{path}"
        node = start_node("gateway", some_domain(), Path(name), "/press", parameters)
        stack.callback(node.end)
        end_s = time.monotonic() + 60.0
        while not (found := re.search(r"valves at http://([\d.]+:\d+)/", node.log)):
            assert node.alive, node.log
            assert time.monotonic() < end_s, node.log
            time.sleep(0.02)
        yield node, found.group(1)


@contextmanager
def _viewers(place: str, valves: Sequence[str]) -> Iterator[None]:
    """Have so many look, one at each of the valves named; they stand for other machines."""
    host, _, port = place.rpartition(":")
    paths = [f"/live/press/{valve}" for valve in valves]
    last = ["nice", "-n", "19"]
    process = subprocess.Popen([*last, sys.executable, str(_PROGRAM), host, port, *paths])
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def _delay() -> Ratio:
    """99 % of the twin's delays at 1 kHz with viewers and without, in turn in one run."""
    with _gateway(["v0"], 3) as (_, place), live(1, 1e-3) as run:
        run.plant.run(2e-3 * CYCLE, 1000.0)  # a model is in force
        alone, watched = [], []
        for pair in range(PAIRS):
            for looked in (False, True) if pair % 2 else (True, False):
                if looked:
                    with _viewers(place, ["v0"] * VIEWERS):
                        watched += _delays(run)
                else:
                    alone += _delays(run)
    with_s, without_s = (1e-9 * statistics.median(found) for found in (watched, alone))
    what = f"one-way delay of the twin at 1 kHz beside {VIEWERS} viewers, 99 %"
    return Ratio(what, "the same without viewers", with_s, without_s, 1.1, better=Better.LOWER)


def _delays(run: Live) -> list[float]:
    """Return 99 % of the delays of each production cycle of a block [ns]."""
    run.plant.run(1.5, 1000.0)  # who has come or gone is known by then
    (taken,) = run.predictions
    run.settle(run.plant.sent, 0)
    taken.delay_ns.clear()
    run.plant.run(1e-3 * CYCLE * CYCLES, 1000.0)
    run.settle(run.plant.sent, 0)
    values = taken.delay_ns
    cycles = (sorted(values[k : k + CYCLE]) for k in range(0, len(values) - CYCLE + 1, CYCLE))
    return [float(cycle[int(0.99 * (CYCLE - 1))]) for cycle in cycles]


def _fleet() -> Iterator[Ratio]:
    """50 valves at 33 Hz, twenty of them looked at: first content, and share of a core."""
    names = [f"v{n}" for n in range(VALVES)]
    with _gateway(names, 60) as (node, place), live(VALVES, 1.0 / PLANT_HZ) as run:
        first_s = _page(place)
        with _viewers(place, names[:VIEWERS]):
            run.plant.run(4.0, PLANT_HZ)
            before, begin = node.cpu_s(), time.perf_counter()
            run.plant.run(20.0, PLANT_HZ)
            used, seconds = node.cpu_s() - before, time.perf_counter() - begin
    what = f"first content of {VALVES} valves"
    yield Ratio(what, "the goal", first_s, FIRST_S, 1.0, better=Better.LOWER)
    what = f"{VALVES} valves, {VIEWERS} viewers of {VIEWERS} of them, CPU of 1 s"
    yield Ratio(what, "the goal", used / seconds, SHARE, 1.0, better=Better.LOWER)


def _page(place: str) -> float:
    """Return how long who is first waits for the page of all valves [s]."""
    begin = time.perf_counter()
    with urllib.request.urlopen(f"http://{place}/", timeout=60) as answer:
        page = answer.read()
    elapsed = time.perf_counter() - begin
    assert page.count(b"/press/v") >= VALVES
    return elapsed
