# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A twin whose database is locked, deleted, gone or full: nothing waits, nothing is lost."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
import statistics
import time
from contextlib import closing
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from valve_twin_msgs.msg import CycleSummary, Estimate, Prediction, Trend

from test.nodes.conftest import NS
from test.nodes.feeding import REARM, Feeder
from valve_twin.core.types import Maintenance
from valve_twin.io.history.store import CycleRecord, History

TREND_ESTIMATOR = "output_error"
FAST = {"busy_timeout_s": 0.3, "retry_s": 0.1, **REARM}


class Plant:
    """A twin in a process of its own, fed by the test, with what it publishes."""

    def __init__(self, graph, database: Path, **parameters) -> None:
        self.graph, self.database = graph, database
        self.estimates = graph.record(f"{NS}/twin/estimate", Estimate)
        self.predictions = graph.record(f"{NS}/twin/prediction", Prediction)
        self.summaries = graph.record(f"{NS}/twin/cycle", CycleSummary)
        self.diagnostics = graph.record("/diagnostics", DiagnosticArray)
        self.parameters = {"history_url": f"sqlite:///{database}", **FAST, **parameters}
        self.twin = graph.start("twin", **self.parameters)
        own = [f"{NS}/twin/{name}" for name in ("estimate", "prediction", "cycle")]
        graph.spin_until(lambda: graph.connected(*own), 120.0, "the twin's publishers")
        graph.be_heard(f"{NS}/twin")
        self.feeder = Feeder(graph, NS)

    def feed(self, cycles: int) -> None:
        """Feed so many cycles and wait until all that are complete were estimated and told."""
        for _ in range(cycles):
            self.feeder.feed(self.feeder.cycle_samples)
        done = self.feeder.sent // self.feeder.cycle_samples - 1
        self.graph.spin_until(lambda: len(set(self.told())) >= done, 120.0, f"{done} estimates")

    def told(self, *, stored: bool | None = None) -> list[int]:
        """Return the cycles of the estimates that feed the trend, as they came."""
        return [
            m.cycle
            for m in self.estimates
            if m.estimator == TREND_ESTIMATOR and stored in (None, m.stored)
        ]

    def wait_stored(self, cycles: list[int]) -> None:
        self.graph.spin_until(
            lambda: self.told(stored=True) == cycles, 120.0, f"{cycles} stored, have {self.told()}"
        )
        assert self.in_database() == cycles

    def in_database(self) -> list[int]:
        with History(self.database, read_only=True) as history:
            return [c.cycle for c in history.cycles(NS)]

    def wait_error(self, text: str) -> DiagnosticStatus:
        def newest():
            found = [s for m in self.diagnostics for s in m.status if s.hardware_id == NS]
            grave = found and found[-1].level == DiagnosticStatus.ERROR
            return found[-1] if grave and text in found[-1].message else None

        return self.graph.spin_until(newest, 120.0, f"an error '{text}' in the diagnostics")

    def figure(self, name: str) -> str:
        def told() -> list[DiagnosticStatus]:
            return [s for m in self.diagnostics for s in m.status if s.hardware_id == NS]

        found = self.graph.spin_until(told, 120.0, "diagnostics")[-1]
        return next(str(v.value) for v in found.values if v.key == name)


@pytest.fixture
def database(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    return tmp_path / "data" / "history.sqlite"


def lock(database: Path) -> sqlite3.Connection:
    holder = sqlite3.connect(database, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    return holder


def answers_s(graph, plant, count: int) -> list[float]:
    """Feed five samples at a time; return how long each took to be predicted [s]."""
    delays = []
    for _ in range(count):
        expected = plant.feeder.sent + 5
        begin = time.monotonic()
        plant.feeder.feed(5)
        graph.spin_until(lambda n=expected: len(plant.predictions) >= n, 5.0, "predictions")
        delays.append(time.monotonic() - begin)
    return delays


@pytest.mark.alone
def test_no_prediction_is_late_while_the_database_is_locked(graph, database):
    plant = Plant(graph, database, busy_timeout_s=30.0)  # the writer hangs all the while
    plant.feed(3)
    plant.wait_stored([1, 2])
    with closing(lock(database)) as holder:
        plant.feeder.feed(plant.feeder.cycle_samples)
        graph.spin_until(lambda: len(plant.summaries) == 3, 120.0, "the summary of cycle 3")
        graph.spin_until(lambda: len(plant.predictions) == plant.feeder.sent, 120.0)
        locked = answers_s(graph, plant, 60)
        assert plant.in_database() == [1, 2]  # it was locked to the end
        holder.execute("ROLLBACK")
    graph.spin_until(lambda: plant.told(stored=True)[:3] == [1, 2, 3], 120.0, "cycle 3 stored")
    free = answers_s(graph, plant, 60)
    assert statistics.median(locked) < min(2.0 * statistics.median(free) + 0.01, 0.1)
    assert max(locked) < 1.0


def test_a_locked_database_delays_storing_and_each_cycle_is_told_once_more(graph, database):
    plant = Plant(graph, database)
    plant.feed(3)
    with closing(lock(database)) as holder:
        plant.feed(3)
        assert "database is locked" in plant.wait_error("wait for the database").message
        assert int(plant.figure("cycles unsaved")) >= 1
        holder.execute("ROLLBACK")
    plant.feed(2)
    plant.wait_stored([1, 2, 3, 4, 5, 6, 7])
    waited = plant.told(stored=False)
    assert set(waited) >= {4, 5}
    assert waited == sorted(set(waited))  # in order, none twice
    last = {m.cycle: m for m in plant.estimates if m.estimator == TREND_ESTIMATOR and m.stored}
    first = {
        m.cycle: m for m in plant.estimates if m.estimator == TREND_ESTIMATOR and not m.stored
    }
    for cycle in waited:
        assert last[cycle].status != Estimate.REFUSED, last[cycle].reason
        assert list(first[cycle].values) == list(last[cycle].values)
    graph.wait_log(plant.twin, "all cycles are stored again")
    assert plant.twin.end() == 0


def test_a_deleted_database_is_written_again_with_all_it_held(graph, database, tmp_path):
    plant = Plant(graph, database)
    plant.feed(3)
    plant.wait_stored([1, 2])
    for tail in ("", "-wal", "-shm"):
        Path(f"{database}{tail}").unlink()
    plant.feed(1)
    plant.wait_stored([1, 2, 3])
    graph.wait_log(plant.twin, "was deleted while in use: it was written again")
    away = database.parent.rename(tmp_path / "away")
    shutil.rmtree(away)  # now out of reach, and nothing is made in it meanwhile
    plant.feed(2)
    plant.wait_error("No such file or directory")
    assert plant.told(stored=True) == [1, 2, 3]
    database.parent.mkdir()
    plant.wait_stored([1, 2, 3, 4, 5])
    assert plant.twin.end() == 0
    assert plant.in_database() == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("tail", ["-wal", ""], ids=["log", "file"])
def test_a_truncated_history_is_whole_again_and_survives_a_kill(graph, database, tail):
    plant = Plant(graph, database)
    plant.feed(3)
    plant.wait_stored([1, 2])
    os.truncate(f"{database}{tail}", 0)
    plant.feed(3)
    graph.spin_until(lambda: plant.told(stored=True) == [1, 2, 3, 4, 5], what="five stored")
    graph.wait_log(plant.twin, "was truncated while in use")
    plant.twin.kill()
    assert plant.in_database() == [1, 2, 3, 4, 5]
    with History(database, read_only=True) as history:
        assert not history.verify().damaged


def test_a_killed_monitor_takes_nothing_along(graph, database):
    plant = Plant(graph, database)
    trends = graph.record(f"{NS}/aging_monitor/trend/K_in", Trend)
    cycles = 0
    for _ in range(3):
        monitor = graph.start("aging_monitor", retry_s=0.1)
        graph.wait_log(monitor, "is active")
        plant.feed(2)
        cycles += 2
        graph.spin_until(
            lambda n=cycles - 1: trends and trends[-1].samples >= n, 120.0, "the trend"
        )
        monitor.kill()
    plant.wait_stored([1, 2, 3, 4, 5])
    assert plant.twin.end() == 0
    with History(database, read_only=True) as history:
        assert not history.verify().damaged


def test_a_full_disk_delays_storing(graph, database):
    plant = Plant(graph, database)
    plant.feed(3)
    plant.wait_stored([1, 2])
    unlimited = resource.prlimit(plant.twin.pid, resource.RLIMIT_FSIZE)
    room = Path(f"{database}-wal").stat().st_size
    resource.prlimit(plant.twin.pid, resource.RLIMIT_FSIZE, (room, unlimited[1]))
    plant.feed(2)
    plant.wait_error("wait for the database")
    assert plant.told(stored=True) == [1, 2]
    resource.prlimit(plant.twin.pid, resource.RLIMIT_FSIZE, unlimited)
    plant.wait_stored([1, 2, 3, 4])


def test_beyond_the_limit_the_oldest_are_lost_and_counted(graph, database):
    plant = Plant(graph, database, unsaved_limit=2)
    plant.feed(2)
    plant.wait_stored([1])
    with closing(lock(database)) as holder:
        plant.feed(6)
        graph.spin_until(
            lambda: int(plant.figure("cycles dropped unsaved")) == 4, 120.0, "four cycles dropped"
        )
        graph.wait_log(plant.twin, "2 cycles wait for the history, more are not kept")
        holder.execute("ROLLBACK")
    plant.wait_stored([1, 6, 7])


def test_the_twin_ends_in_time_while_the_database_is_locked(graph, database):
    plant = Plant(graph, database, busy_timeout_s=30.0)
    plant.feed(2)
    plant.wait_stored([1])
    with closing(lock(database)):
        plant.feeder.feed(plant.feeder.cycle_samples)
        graph.spin_until(lambda: len(plant.summaries) == 2, 120.0, "the summary of cycle 2")
        graph.spin_until(lambda: int(plant.figure("cycles unsaved")) == 1, what="it to be stored")
        code, took_s = plant.twin.end_in_s()
    assert code == 0
    assert took_s < 2.0


def test_one_valve_has_one_twin(graph, database):
    plant = Plant(graph, database)
    second = graph.start("twin", extra=["-r", "__node:=second"], **plant.parameters)
    graph.wait_log(second, "cannot configure")
    said = next(line for line in second.log.splitlines() if "cannot configure" in line)
    assert f"{NS} is already written by process {plant.twin.pid} on" in said
    assert second.process.poll() is None
    neighbour = graph.start("twin", ns="/press/v2", **plant.parameters)
    plant.feed(2)
    plant.wait_stored([1])
    assert "cannot configure" not in neighbour.log


def test_a_number_that_another_program_took_is_left_and_counting_goes_on_after_it(graph, database):
    plant = Plant(graph, database)
    plant.feed(2)
    plant.wait_stored([1])
    with History(database) as stranger:
        stranger.store(NS, CycleRecord(2, 5, 6, samples=7, reason="of another program"))
        stranger.add_maintenance(NS, Maintenance(5, 2, "seal"))
    plant.feed(4)
    plant.graph.spin_until(lambda: len(plant.told(stored=True)) >= 3, 120.0, "stored again")
    assert plant.told(stored=False) == [2]
    numbers = [m.cycle for m in plant.summaries]
    assert len(numbers) == len(set(numbers))
    graph.wait_log(plant.twin, "cycle 2 is not stored")
    with History(database, read_only=True) as history:
        assert [c.reason for c in history.cycles(NS, 2, 1)] == ["of another program"]
