# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The way of cycles into a server's history that comes and goes, beside a disk that does, too."""

from __future__ import annotations

import errno
import random
from collections import deque
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import CycleRecord
from valve_twin.io.history.unsaved import UnsavedCycles
from valve_twin.nodes.runtime.worker import Outcome
from valve_twin.nodes.twin.history import flusher, writer
from valve_twin.nodes.twin.history.writer import HistoryWriter, QueuedCycle

VALVES = ("/a", "/a/b", "/b")


class Server:
    """A history whose server is away at times, also between a commit and its answer."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, int]] = []
        self.is_away = self.is_lost_after_commit = False
        self.notices: deque[str] = deque()

    def store(self, valve: str, record: CycleRecord, *_: object) -> None:
        self.repair()
        if (valve, record.cycle) not in self.rows:
            self.rows.append((valve, record.cycle))
        if self.is_lost_after_commit:
            self.is_lost_after_commit = False
            self.fail()

    def last_cycle(self, valve: str) -> int:
        return max((cycle for name, cycle in self.rows if name == valve), default=0)

    def repair(self) -> None:
        if self.is_away:
            self.fail()

    def fail(self) -> None:
        msg = "server away"
        raise StoreError(msg)

    def close(self) -> None:
        """There is nothing to give back."""


class Turns:
    """Stands in for a thread: its work is done when it is told so."""

    def __init__(self, _: str) -> None:
        self.jobs: deque[Any] = deque()

    def submit(self, work, deliver):
        self.jobs.append((work, deliver))

    def step(self):
        work, deliver = self.jobs.popleft()
        try:
            outcome = Outcome(work(), "", 0.0)
        except StoreError as err:
            outcome = Outcome(None, str(err), 0.0)
        deliver(outcome)

    def close(self, _):
        while self.jobs:
            self.step()


class Bench:
    """A writer with all that it talks to."""

    def __init__(self, folder: Path, limit: int) -> None:
        self.folder, self.limit = folder, limit
        self.server = Server()
        self.lines: list[str] = []
        self.posted: deque[Any] = deque()
        self.timers: list[Any] = []
        self.cycles = dict.fromkeys(VALVES, 0)
        self.dropped = 0
        self.start()

    def start(self) -> None:
        log = SimpleNamespace(**dict.fromkeys(("info", "warning", "error"), self.lines.append))
        node: Any = SimpleNamespace(
            get_logger=lambda: log,
            post=self.posted.append,
            create_timer=self.make_timer,
            destroy_timer=self.timers.remove,
        )
        history: Any = self.server
        unsaved = UnsavedCycles(self.folder, "postgresql://valve@/db")
        self.writer = HistoryWriter(node, history, retry_s=1, limit=self.limit, unsaved=unsaved)
        for valve in VALVES:
            self.writer.store_left(valve)
        self.queues = {
            v: self.writer.open(v, lambda *_: None, lambda _: None) for v in self.cycles
        }

    def make_timer(self, _: float, call: Any, **__: object) -> Any:
        self.timers.append(call)
        return call

    def add(self, valve: str) -> None:
        self.cycles[valve] = cycle = self.cycles[valve] + 1
        queue = self.queues[valve]
        queue.waiting += 1
        self.writer.add(QueuedCycle(queue, CycleRecord(cycle, 0, cycle, 850), (), 0.1))

    def flush(self) -> None:
        flusher: Any = self.writer._flusher
        if flusher._thread.jobs:
            flusher._thread.step()

    def step(self) -> None:
        thread: Any = self.writer.write_thread
        if thread.jobs:
            thread.step()
        while self.posted:
            self.posted.popleft()()

    def end(self) -> int:
        self.dropped += sum(queue.dropped for queue in self.queues.values())
        self.posted.clear()
        return self.writer.close(1.0)

    def settle(self) -> None:
        self.server.is_away = False
        for _ in range(10_000):
            self.step()
            for call in tuple(self.timers):
                call()
            if not any(queue.waiting for queue in self.queues.values()):
                return

    @property
    def queued(self) -> list[QueuedCycle]:
        storing = self.writer._storing
        return [*self.writer._waiting, *([] if storing is None else [storing])]

    @property
    def in_memory(self) -> int:
        return sum(not queued.is_shed for queued in self.writer._waiting)

    @property
    def files(self) -> list[Path]:
        return sorted(path for path in self.folder.rglob("*") if path.is_file())


@pytest.fixture
def bench(tmp_path, monkeypatch):
    for module in (writer, flusher):
        monkeypatch.setattr(module, "WorkerThread", Turns)
    return partial(Bench, tmp_path / "state")


def refuse(number):
    raise OSError(number, "refused")


@pytest.mark.parametrize("seed", range(60))
def test_each_cycle_is_stored_once_in_order_and_nothing_is_left_on_disk(seed, bench):
    rng = random.Random(seed)
    one = bench(rng.choice([1, 2, 5]))
    for _ in range(200):
        what = rng.random()
        if what < 0.45:
            one.add(rng.choice(VALVES))
        elif what < 0.8:
            one.step()
        elif what < 0.83:
            one.flush()
        elif what < 0.88:
            one.server.is_away = not one.server.is_away
        elif what < 0.9:
            one.server.is_lost_after_commit = True
        elif what < 0.97:
            for call in tuple(one.timers):
                call()
        else:
            assert one.end() == 0
            one.server.is_away = one.server.is_lost_after_commit = False
            one.start()
        assert one.in_memory <= one.limit
        for queue in one.queues.values():
            kept = [q for q in one.queued if q.valve is queue and q.is_flushed]
            assert queue.flushed == len(kept)
            assert all(q.file.exists() for q in kept)
    one.settle()
    assert one.end() == one.dropped == 0
    for valve, count in one.cycles.items():
        stored = [cycle for name, cycle in one.server.rows if name == valve]
        assert stored == list(range(1, count + 1))
    assert one.files == []


def test_a_server_that_does_not_answer_lets_cycles_wait_on_disk_too(bench):
    one = bench(2)
    for _ in range(8):
        one.add("/a")  # the first one is being stored all the while
    assert len(one.files) == 5
    assert one.in_memory == 2
    one.settle()
    assert [cycle for _, cycle in one.server.rows] == list(range(1, 9))


def test_a_full_disk_is_asked_once_a_try_and_told_once(bench, monkeypatch):
    one = bench(50)
    one.server.is_away = True
    asked = []

    def fill(path, _):
        asked.append(path)
        refuse(errno.ENOSPC)

    monkeypatch.setattr(Path, "write_bytes", fill)
    for _ in range(20):
        one.add("/a")
    one.step()
    assert len(asked) == 1
    for _ in range(3):
        (retry,) = [call for call in one.timers if call == one.writer._retry]
        retry()
        one.step()
    assert len(asked) == 4
    assert len([line for line in one.lines if "are kept in memory" in line]) == 1
    monkeypatch.undo()
    one.settle()
    assert [cycle for _, cycle in one.server.rows] == list(range(1, 21))


def test_a_file_that_cannot_be_read_now_is_read_later(bench, monkeypatch):
    one = bench(1)
    one.server.is_away = True
    for _ in range(5):
        one.add("/a")
    one.step()
    one.server.is_away = False
    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", lambda _: refuse(errno.EMFILE))
        for call in tuple(one.timers):
            call()
        one.step()
        assert "cannot be read" in one.writer.error
    one.settle()
    assert [cycle for _, cycle in one.server.rows] == [1, 2, 3, 4, 5]


def test_what_is_damaged_on_disk_is_told_at_the_end_too(bench):
    one = bench(1)
    one.server.is_away = True
    for _ in range(5):
        one.add("/a")
    one.step()
    one.files[1].write_bytes(b"damaged")
    one.server.is_away = False
    one.end()
    assert [cycle for _, cycle in one.server.rows] == [1, 3, 4, 5]
    assert [line for line in one.lines if line.startswith("/a: cycle 2 is not stored")]


def test_a_cycle_is_on_disk_before_it_is_told_as_not_stored(bench):
    one = bench(50)
    one.server.is_away = True
    told = []

    def tell(queued, is_stored):
        told.append((queued.record.cycle, is_stored, queued.file in one.files))

    one.queues["/a"].publish = tell
    for _ in range(3):
        one.add("/a")
    one.step()
    one.add("/a")  # after the first refusal
    assert told == [(cycle, False, True) for cycle in (1, 2, 3, 4)]


def test_cycles_are_flushed_all_at_once_and_counted_then_only(bench):
    one = bench(50)
    one.server.is_away = True
    for _ in range(5):
        one.add("/a")
    one.step()
    assert one.queues["/a"].flushed == 0
    assert len(one.writer._flusher._thread.jobs) == 1
    one.flush()
    one.step()
    assert one.queues["/a"].flushed == 5
    one.settle()
    assert one.queues["/a"].flushed == 0


def test_what_was_flushed_and_is_gone_from_the_disk_is_counted_once(bench):
    """It was counted again with each time that the folder was deleted."""
    one = bench(50)
    one.server.is_away = True
    for _ in range(3):
        one.add("/a")
    one.step()
    for _ in range(3):
        one.flush()
        one.step()
        assert one.queues["/a"].flushed == len(one.files) == 3
        for file in one.files:
            file.unlink()
        for call in tuple(one.timers):
            call()
        one.step()
    one.flush()
    one.step()
    one.settle()
    assert one.queues["/a"].flushed == 0


def test_what_the_disk_does_not_flush_is_written_anew(bench, monkeypatch):
    one = bench(50)
    one.server.is_away = True
    for _ in range(3):
        one.add("/a")
    one.step()
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", lambda _: refuse(errno.EIO))
        one.flush()
        one.step()
    assert one.files == []
    for call in tuple(one.timers):
        call()
    one.step()
    one.flush()
    one.step()
    assert one.queues["/a"].flushed == len(one.files) == 3
    one.settle()
    assert [cycle for _, cycle in one.server.rows] == [1, 2, 3]
