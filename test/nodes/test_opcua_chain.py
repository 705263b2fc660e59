# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From a PLC by opcua_source and twin to a client of the OPC UA server, each killed in turn.

Every link is a process of its own and dies by SIGKILL while the PLC writes on: what was told as
stored stays, no cycle is stored or shown twice, whole cycles are missing only where a link before
the history was gone, and the client that stays reads the newest one again.
"""

from __future__ import annotations

import random
import threading
import time
from contextlib import suppress
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from valve_twin_msgs.msg import CycleSummary, Estimate

pytest.importorskip("asyncua", reason="needs the extra gateway")

from test.gateway.opcua.test_server import Follower, Server
from test.nodes.conftest import NS
from test.nodes.feeding import REARM
from test.nodes.opcua_source.plc import Plc
from test.nodes.test_kill import LATCHED, check_numbers, check_stored
from test.ports import free_port
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SIGNALS = {"v_in": "command/v_in", "v_out": "command/v_out", "spool_position": "position"}
SERIES = "valve_twin_msgs/msg/Float64Series"
START_NS = 1_700_000_000_000_000_000
PACE = 800.0
"""Samples that the PLC writes in a second of ours [1/s]."""


class Plant:
    """What the PLC measures, whether or not it is there: a new one writes where time has come."""

    def __init__(self) -> None:
        simulation = get_simulation("press_cartridge")
        valve = SimulatedValve(simulation, 5)
        self.period_ns = round(simulation.period_s * 1e9)
        self.cycle_samples = valve.config.cycle_samples
        block = valve.advance(12 * self.cycle_samples)
        self._columns = [c.tolist() for c in (*block.inputs.T[:2], block.position)]
        self._port, self._next = free_port(), 1
        self.start()

    @property
    def address(self) -> str:
        return self._plc.address

    def start(self) -> None:
        first_ns = START_NS + (self._next - 1) * self.period_ns
        self._plc = Plc(self._port, len(SIGNALS), first_ns=first_ns)
        self._thread = threading.Thread(target=self._write)
        self._thread.start()

    def kill(self) -> None:
        """Kill it in the middle of its writing; what it would have written is skipped."""
        self._plc.process.kill()
        self._thread.join()
        self._plc.kill()
        n = self.cycle_samples
        self._next = (self._next // n + 2) * n  # a new one holds 0, which is true where one begins

    def _write(self) -> None:
        """Write the same twelve cycles over and over, a cycle at a time."""
        with suppress(OSError, AssertionError):  # it is killed
            while True:
                begin = self._next % len(self._columns[0])
                some = {
                    tag: column[begin : begin + self.cycle_samples]
                    for tag, column in enumerate(self._columns)
                }
                start_ns = START_NS + self._next * self.period_ns
                self._plc.write(some, start_ns, self.period_ns, pace=PACE)
                self._next += len(some[0])


class Chain:
    """All links, and the client at its end."""

    def __init__(self, graph, folder: Path) -> None:
        self._graph, self._folder = graph, folder
        self.database = folder / "history.sqlite"
        self.plant = Plant()
        self._port = free_port()
        self._start_source()
        self._start_twin()
        graph.spin_until(lambda: self.stored() >= 1, what="a first cycle")
        self._server, self._starting = self._made_server(), threading.Thread()
        self.follower = Follower(f"opc.tcp://127.0.0.1:{self._port}", NS)
        self.links: dict[str, tuple[Callable[[], None], Callable[[], None]]] = {
            "PLC": (self.plant.kill, self.plant.start),
            "opcua_source": (self._kill_source, self._start_source),
            "twin": (self._kill_twin, self._start_twin),
            "server": (self._kill_server, self._start_server),
        }

    def stored(self) -> int:
        """Return the number of the last stored cycle."""
        with suppress(StoreError):  # it is just being made
            with History(self.database, read_only=True) as history:
                last = history.last_record(NS)
            return last.cycle if last else 0
        return 0

    def wait_for_more(self, what: str) -> float:
        """Wait until the client sees a cycle that is not stored yet; return how long it took."""
        before, begun_s = self.stored(), time.monotonic()
        self._graph.spin_until(
            lambda: self.follower.seen[-1:] > [before], what=f"a client to see more {what}"
        )
        return time.monotonic() - begun_s

    def end(self) -> list[int]:
        """End the PLC; return what the client saw once all has arrived."""
        self.plant.kill()
        self._graph.spin(3.0)
        self._graph.spin_until(lambda: self.follower.seen[-1:] == [self.stored()], what="all")
        self.close()
        return self.follower.seen

    def close(self) -> None:
        if self._starting.ident:
            self._starting.join()
        self.follower.end()
        self._kill_server()
        self.plant.kill()

    def _kill_source(self) -> None:
        self._source.kill()

    def _kill_twin(self) -> None:
        self._twin.kill()

    def _start_source(self) -> None:
        self._source = self._graph.start(
            "opcua_source",
            address=self.plant.address,
            tags=[f"{topic} ns=1;s=tag{tag}" for tag, topic in enumerate(SIGNALS.values())],
            period_s=self.plant.period_ns * 1e-9,
        )

    def _start_twin(self) -> None:
        signals = {f"signals.{name}.topic": topic for name, topic in SIGNALS.items()}
        signals |= {f"signals.{name}.type": SERIES for name in SIGNALS}
        url = f"sqlite:///{self.database}"
        given = {
            "topic_prefix": "/plc",
            "history_url": url,
            "period_s": self.plant.period_ns * 1e-9,
        }
        self._twin = self._graph.start("twin", **given, **signals, **REARM)

    def _made_server(self) -> Server:
        address = f"opc.tcp://127.0.0.1:{self._port}"
        return Server(self.database, self._folder / "pki", "--anonymous", "--opcua", address)

    def _start_server(self) -> None:
        def start() -> None:
            self._server = self._made_server()

        self._starting = threading.Thread(target=start)
        self._starting.start()

    def _kill_server(self) -> None:
        if self._starting.ident:
            self._starting.join()
        self._server.process.kill()
        self._server.process.wait()
        if self._server.process.stderr:
            self._server.process.stderr.close()


def outlive(graph, folder: Path, rounds: list[list[str]], seed: int) -> list[float]:
    """Kill the links of each round at any time; return how long the client waited after each."""
    rng, waited_s = random.Random(seed), list[float]()
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    estimates = graph.record(f"{NS}/twin/estimate", Estimate, LATCHED)
    chain = Chain(graph, folder)
    try:
        chain.wait_for_more("at first")
        for links in rounds:
            for link in links:
                kill, start = chain.links[link]
                graph.spin(rng.uniform(0.0, 0.5))
                kill()
                start()
            waited_s.append(chain.wait_for_more(f"after {links}"))
        seen = chain.end()
    finally:
        chain.close()
    check_numbers(summaries)
    check_stored(chain.database, estimates)
    with History(chain.database, read_only=True) as history:
        cycles = history.cycles(NS)
        stored = [(e.cycle, e.estimator) for e in history.estimates(NS)]
    assert seen == sorted(set(seen))  # never back, never twice
    numbers = [c.cycle for c in cycles]
    assert numbers == sorted(set(numbers))
    twins = sum(link == "twin" for links in rounds for link in links)
    # one that was told and then killed before it was stored keeps its number
    assert numbers[-1] - len(numbers) <= twins
    assert len(set(stored)) == len(stored)
    plant, whole_ns = chain.plant, chain.plant.period_ns * chain.plant.cycle_samples
    steps = [b.start_ns - a.start_ns for a, b in pairwise(cycles)]
    taken_ns = [c.samples * plant.period_ns for c in cycles]
    assert all(step >= ns for step, ns in zip(steps, taken_ns, strict=False))  # one after another
    before_the_history = sum(link != "server" for links in rounds for link in links)
    assert sum(step > 1.5 * whole_ns for step in steps) <= before_the_history
    spans = [(c.end_ns - c.start_ns) // plant.period_ns + 1 for c in cycles]
    assert all(c.samples <= n for c, n in zip(cycles, spans, strict=True))  # none twice
    samples = [c.samples for c in cycles if c.accepted]  # a kill may take some of a cycle
    assert plant.cycle_samples in samples
    # one whose end nobody told goes on with the next that is seen to begin
    assert sum(n > plant.cycle_samples for n in samples) <= before_the_history
    assert sum(n < plant.cycle_samples for n in samples) <= before_the_history
    return waited_s


def test_a_chain_whose_every_link_is_killed_stores_nothing_twice_and_is_read_live_again(
    graph, tmp_path
):
    """Three kills of each of the four, in an order by chance."""
    rng = random.Random(8)
    links = ["PLC", "opcua_source", "twin", "server"]
    waited_s = outlive(graph, tmp_path, [rng.sample(links, 4) for _ in range(3)], 9)
    print(f"\nlive again: {sorted(round(s, 1) for s in waited_s)} s")  # noqa: T201


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_a_chain_with_a_hundred_kills_of_one_link_after_another(graph, tmp_path):
    links = ["PLC", "opcua_source", "twin", "server"]
    waited_s = outlive(graph, tmp_path, [[links[n % 4]] for n in range(100)], 10)
    for n, link in enumerate(links):
        some_s = sorted(waited_s[n::4])
        print(f"\n{link}: live again after {some_s[12]:.1f} s, at most {some_s[-1]:.1f} s")  # noqa: T201
