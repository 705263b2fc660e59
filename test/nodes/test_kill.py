# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin that is killed at any moment: nothing told as stored is lost, no number is given twice.

The data is given again from inside the last stored cycle on, as a recorder or a buffering PLC
does; then the history is that of an undisturbed run, to the last bit. Where the plant goes on
meanwhile, only whole cycles are stored.
"""

from __future__ import annotations

import json
import os
import random
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from valve_twin_msgs.msg import CycleSummary, Estimate, Float64Stamped, Prediction

from test.io.history.test_store import bits
from test.nodes.conftest import NS
from test.nodes.feeding import REARM, START_NS
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.valves.registry import get_model, get_simulation
from valve_twin.io.cdr.codec import encode_stamped
from valve_twin.io.history.store import History
from valve_twin.nodes.player.outbox import SubscriberGate
from valve_twin.nodes.runtime.stamps import from_time

TOPICS = ("command/v_in", "command/v_out", "spool_position")
LATCHED = QoSProfile(depth=100000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RESULT = Path(__file__).resolve().parents[2] / "docs" / "campaigns" / "kill.json"


class Data:
    """All samples of a run, to be published from anywhere."""

    def __init__(self, cycles: int, seed: int = 3) -> None:
        valve = SimulatedValve(get_simulation("press_cartridge"), seed)
        self.cycle_samples = valve.config.cycle_samples
        block = valve.advance(cycles * self.cycle_samples + 50)
        self.stamps = block.stamp_ns + START_NS
        columns = (block.inputs[:, 0], block.inputs[:, 1], block.position)
        self._messages = [
            [encode_stamped(int(t), float(v)) for t, v in zip(self.stamps, column, strict=True)]
            for column in columns
        ]

    def __len__(self) -> int:
        return len(self.stamps)

    def publish(self, publishers, begin: int, end: int) -> None:
        for i in range(begin, end):
            for publisher, messages in zip(publishers, self._messages, strict=True):
                publisher.publish(messages[i])


class Life:
    """One twin process and, fresh each time, the hardware that feeds it."""

    def __init__(self, graph, ns: str, database: Path) -> None:
        self.graph, self.ns, self.database = graph, ns, database
        self.hardware = graph.stranger("hardware")
        self.publishers = [
            self.hardware.create_publisher(Float64Stamped, f"{ns}/{t}", QoSProfile(depth=100000))
            for t in TOPICS
        ]
        self.twin = graph.start("twin", ns=ns, history_url=f"sqlite:///{database}", **REARM)
        gate = SubscriberGate(self.hardware)
        graph.spin_until(
            lambda: gate.is_open(self.publishers, 1, time.monotonic()), 120.0, "the twin's inputs"
        )
        graph.be_heard(f"{ns}/twin")

    def kill(self) -> None:
        self.twin.kill()
        self.graph.strangers.remove(self.hardware)
        self.hardware.destroy_node()
        rclpy.shutdown(context=self.hardware.context)

    def last_stored(self):
        with History(self.database, read_only=True) as history:
            return history.last_record(self.ns)


def wait_for_cycle(life: Life, number: int) -> None:
    def reached() -> bool:
        last = life.last_stored()
        return last is not None and last.cycle >= number

    life.graph.spin_until(reached, 120.0, f"cycle {number} in the history")


def wait_for_word(life: Life, estimates, number: int) -> None:
    """Wait for the news of a stored cycle; a twin that ends at once takes it along."""
    life.graph.spin_until(
        lambda: any(m.stored and m.cycle >= number for m in estimates),
        120.0,
        f"the estimates of cycle {number}",
    )


def holds(snapshot: Path, cycle: int, stamp_ns: int) -> bool:
    """Whether a snapshot was taken after a cycle was stored and a stamp came on all topics."""
    if not snapshot.exists():
        return False
    head = snapshot.read_bytes().split(b"\n", 2)[1]
    return bool(json.loads(head)["cycle"] == cycle and head.count(b"%d" % stamp_ns) >= len(TOPICS))


def received(diagnostics) -> list[int]:
    """Return how many messages of each topic a twin has taken, by its newest diagnostics."""
    figures = [v for m in diagnostics[-1:] for s in m.status for v in s.values]
    return [int(v.value.split("/")[0]) for v in figures if v.key.endswith("/unreadable")]


def kept(database: Path, ns: str):
    """Return cycles, counters and estimates of a history by their bits, and what they say."""
    with History(database, read_only=True) as history:
        cycles, estimates = history.cycles(ns), history.estimates(ns)
        counters = history.log.counters(ns)
    model = get_model("press_cartridge")
    trend = tuple(e for e in estimates if e.estimator == model.trend_estimator)
    found = assess(trend, (), AgingConfig(), parameters=model.parameters, valve="v")
    assert counters is not None
    assert counters.cycles == len(cycles)
    return cycles, repr(counters), [bits(e) for e in estimates], repr(found)


def kill_at_random(graph, tmp_path: Path, kills: int, seed: int) -> dict[str, object]:
    """Kill a twin at random moments and compare with one that was left alone."""
    rng = random.Random(seed)
    data = Data(cycles=kills * 2 + 4)
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    estimates = graph.record(f"{NS}/twin/estimate", Estimate, LATCHED)
    database, undisturbed = tmp_path / "killed.sqlite", tmp_path / "undisturbed.sqlite"
    last_cycle = len(data) // data.cycle_samples  # the first samples of one more end it
    life = Life(graph, NS, database)
    at, repeated, in_cycle = 0, 0, 0
    for _ in range(kills):
        until = min(at + rng.randint(50, 3 * data.cycle_samples), len(data))
        data.publish(life.publishers, at, until)
        graph.spin(rng.uniform(0.0, 0.4))
        life.kill()
        graph.spin(0.01)
        record = life.last_stored()
        again = 0
        if record is not None:
            first, last = np.searchsorted(data.stamps, [record.start_ns, record.end_ns])
            again = rng.randint(int(first), int(last))
            in_cycle += until < len(data)
        repeated += until - again
        at = again
        life = Life(graph, NS, database)
    data.publish(life.publishers, at, len(data))
    wait_for_cycle(life, last_cycle)
    wait_for_word(life, estimates, last_cycle)
    assert life.twin.end() == 0

    reference = Life(graph, "/press/ref", undisturbed)
    data.publish(reference.publishers, 0, len(data))
    wait_for_cycle(reference, last_cycle)
    assert reference.twin.end() == 0

    check_numbers(summaries)
    check_stored(database, estimates)
    for ours, theirs in zip(kept(database, NS), kept(undisturbed, "/press/ref"), strict=True):
        assert ours == theirs
    return {"kills": kills, "cycles": last_cycle, "samples": len(data), "repeated": repeated}


def check_numbers(summaries) -> None:
    """No number belongs to two cycles and no cycle has two numbers."""
    starts: dict[int, int] = {}
    numbers: dict[int, int] = {}
    for message in summaries:
        start = from_time(message.start)
        assert starts.setdefault(message.cycle, start) == start
        assert numbers.setdefault(start, message.cycle) == message.cycle


def check_stored(database: Path, estimates) -> None:
    """What was told as stored is in the history, with the same values."""
    with History(database, read_only=True) as history:
        values = {
            (e.cycle, e.estimator): [p.value for p in e.parameters] for e in history.estimates(NS)
        }
    told = [m for m in estimates if m.stored]
    assert told
    for message in told:
        np.testing.assert_array_equal(
            list(message.values), values[message.cycle, message.estimator]
        )


def test_a_twin_killed_at_any_time_gives_the_history_of_an_undisturbed_one(graph, tmp_path):
    kill_at_random(graph, tmp_path, kills=3, seed=11)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("seed", range(4))
def test_so_it_does_after_many_kills(graph, tmp_path, seed):
    begin = time.monotonic()
    found = kill_at_random(graph, tmp_path, kills=30, seed=seed)
    results = json.loads(RESULT.read_text()) if RESULT.exists() and seed else {}
    results[f"seed {seed}"] = {**found, "seconds": round(time.monotonic() - begin)}
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(json.dumps(results, indent=2) + os.linesep)


@pytest.mark.parametrize("death", ["kill", "end"])
def test_a_twin_goes_on_inside_a_cycle_with_the_bits_of_an_undisturbed_one(graph, tmp_path, death):
    """Killed, with the last samples given again; or ended, with data that waits meanwhile."""
    data = Data(cycles=5)
    n = data.cycle_samples
    until = 2 * n + n // 2
    again = n // 2 - 10 if death == "kill" else 0
    database = tmp_path / "killed.sqlite"
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    diagnostics = graph.record("/diagnostics", DiagnosticArray)
    said = {ns: graph.record(f"{ns}/twin/prediction", Prediction) for ns in (NS, "/press/ref")}

    def predicted(ns: str, sample: int) -> None:
        stamp = data.stamps[sample]
        graph.spin_until(
            lambda: bool(said[ns]) and from_time(said[ns][-1].header.stamp) >= stamp,
            120.0,
            f"the prediction of sample {sample} of {ns}",
        )

    life = Life(graph, NS, database)
    data.publish(life.publishers, 0, until)
    predicted(NS, until - 5)
    wait_for_cycle(life, 2)
    graph.spin_until(
        lambda: [m.cycle for m in summaries] == [1, 2], what="the word of both cycles"
    )
    if death == "kill":
        snapshot = tmp_path / "killed.sqlite-twin.press.v1"
        graph.spin_until(lambda: holds(snapshot, 2, data.stamps[until - 1]), 120.0, "a snapshot")
    else:
        graph.spin_until(lambda: received(diagnostics) == [until] * 3, what="every sample")
        assert life.twin.end() == 0
    life.kill()
    life = Life(graph, NS, database)
    data.publish(life.publishers, until - again, len(data))
    predicted(NS, len(data) - 5)
    wait_for_cycle(life, 5)
    graph.spin_until(lambda: summaries[-1].cycle == 5, 120.0, "the word of the last cycle")
    graph.wait_log(life.twin, "goes on where it ended, inside cycle 3")
    assert life.twin.end() == 0

    reference = Life(graph, "/press/ref", tmp_path / "undisturbed.sqlite")
    data.publish(reference.publishers, 0, len(data))
    predicted("/press/ref", len(data) - 5)
    wait_for_cycle(reference, 5)
    assert reference.twin.end() == 0

    check_numbers(summaries)
    assert [m.cycle for m in summaries] == [1, 2, 3, 4, 5]
    theirs = kept(tmp_path / "undisturbed.sqlite", "/press/ref")
    assert kept(database, NS) == theirs
    ours, whole = ({from_time(m.header.stamp): repr(m) for m in said[ns]} for ns in said)
    assert len(whole) >= len(data) - 5
    assert {stamp: ours.get(stamp) for stamp in whole} == whole


def test_where_the_plant_goes_on_only_whole_cycles_are_stored_under_new_numbers(graph, tmp_path):
    data = Data(cycles=8)
    summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
    estimates = graph.record(f"{NS}/twin/estimate", Estimate, LATCHED)
    database = tmp_path / "killed.sqlite"
    life = Life(graph, NS, database)
    at, n = 0, data.cycle_samples

    def closed(cycle: int) -> None:
        start = data.stamps[cycle * n]
        graph.spin_until(
            lambda: bool(summaries) and from_time(summaries[-1].start) >= start,
            120.0,
            f"the summary of the cycle at sample {cycle * n}",
        )

    for until in (n + n // 2, 4 * n + n // 2):
        data.publish(life.publishers, at, until)
        closed(until // n - 1)
        life.kill()
        at = until + n // 4
        life = Life(graph, NS, database)
    data.publish(life.publishers, at, len(data))
    closed(7)
    wait_for_cycle(life, summaries[-1].cycle)
    wait_for_word(life, estimates, summaries[-1].cycle)
    check_numbers(summaries)
    check_stored(database, estimates)
    whole_ns = int(data.stamps[n] - data.stamps[0])
    with History(database, read_only=True) as history:
        cycles = history.cycles(NS)
    assert len(cycles) >= 2
    assert {c.samples for c in cycles} == {n}
    assert len({c.start_ns % whole_ns for c in cycles}) == 1
    assert [c.start_ns for c in cycles] == sorted(c.start_ns for c in cycles)
