# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Cycles beyond the budget wait on disk: same order, same bits; a full disk drops the oldest."""

import shutil
from collections import namedtuple

import numpy as np
import pytest

from valve_twin.core.types import Cycle, Frames
from valve_twin.io.history import spool as spool_module
from valve_twin.io.history.snapshot import load_cycle
from valve_twin.io.history.spool import FREE_BYTES, SAMPLE_BYTES, CycleSpool, MemoryBudget

SAMPLES = 100
SIZE = SAMPLE_BYTES * SAMPLES
Usage = namedtuple("Usage", "total used free")


def cycle(number):
    rng = np.random.default_rng(number)
    column = rng.standard_normal(SAMPLES)
    frames = Frames(
        stamp_ns=np.arange(SAMPLES, dtype=np.int64) + number * 10**9,
        position=column,
        inputs=rng.standard_normal((SAMPLES, 2)),
        counter=np.full(SAMPLES, np.nan),
        reference=column.copy(),
        valid=column > 0.0,
    )
    return Cycle(number, 0.03, frames, reason=f"cycle {number}")


def same(one, other):
    """Whether two cycles have the same bits."""
    names = ("stamp_ns", "position", "inputs", "counter", "reference", "valid")
    arrays = [(getattr(one.frames, n), getattr(other.frames, n)) for n in names]
    alike = all(a.dtype == b.dtype and a.tobytes() == b.tobytes() for a, b in arrays)
    return alike and (one.number, one.reason) == (other.number, other.reason)


def spool_of(folder, cycles, budget=None, room=2, **options):
    spool = CycleSpool(budget or MemoryBudget(room * SIZE), folder, **options)
    for number in range(1, cycles + 1):
        spool.append(number, cycle(number))
    return spool


def emptied(spool):
    return [spool.popleft() for _ in range(len(spool))]


@pytest.fixture
def full(monkeypatch):
    """Let the disk have room for so many cycles more."""

    def fill(folder, cycles):
        def usage(path):
            used = len(list(folder.glob("*.cycle")))
            return Usage(0, 0, FREE_BYTES + (cycles - used) * SIZE)

        monkeypatch.setattr(shutil, "disk_usage", usage)

    return fill


def test_what_is_beyond_the_budget_comes_back_from_disk_with_the_same_bits(tmp_path):
    spool = spool_of(tmp_path / "cycles", 6)
    assert (len(spool), spool.spooled) == (6, 4)
    assert all(same(c, cycle(n)) for n, c in spool)
    found = emptied(spool)
    assert [n for n, _ in found] == [1, 2, 3, 4, 5, 6]
    assert all(same(c, cycle(n)) for n, c in found)
    assert (spool.spooled, spool.dropped) == (0, 0)
    assert not list((tmp_path / "cycles").iterdir())


def test_the_budget_is_of_all_valves_together(tmp_path):
    budget = MemoryBudget(3 * SIZE)
    first = spool_of(tmp_path / "a", 2, budget)
    second = spool_of(tmp_path / "b", 2, budget)
    assert (first.spooled, second.spooled) == (0, 1)
    assert budget.used == 3 * SIZE
    emptied(first)
    emptied(second)
    assert budget.used == 0


def test_a_full_disk_drops_the_oldest_first_and_counts(tmp_path, full):
    full(tmp_path / "cycles", 1)
    spool = spool_of(tmp_path / "cycles", 6)
    found = emptied(spool)
    assert [n for n, _ in found] == [1, 2, 3, 4, 5, 6], "each keeps its place"
    assert [n for n, c in found if c is not None] == [4, 5, 6]
    assert spool.dropped == 3
    assert spool.trouble.startswith(f"{tmp_path / 'cycles'}: ")


@pytest.mark.parametrize("makes_parents", [False, True])
def test_beside_a_history_that_went_with_its_disk_no_folder_takes_its_place(
    tmp_path, makes_parents
):
    folder = tmp_path / "mount" / "a-cycles"
    spool = spool_of(folder, 5, makes_parents=makes_parents)
    assert folder.parent.exists() == makes_parents
    assert (spool.spooled, spool.dropped) == ((3, 0) if makes_parents else (0, 3))


def test_without_a_folder_the_budget_holds_all_the_same():
    spool = spool_of(None, 5)
    assert [n for n, c in emptied(spool) if c is not None] == [4, 5]
    assert spool.dropped == 3


def test_the_only_cycle_stays_whatever_it_takes():
    spool = spool_of(None, 2, room=0)
    assert [n for n, c in emptied(spool) if c is not None] == [2]


@pytest.mark.parametrize("damage", [lambda p: p.write_bytes(b"x"), lambda p: p.unlink()])
def test_a_cycle_that_the_disk_does_not_give_back_counts_as_dropped(tmp_path, damage):
    spool = spool_of(tmp_path / "cycles", 3)
    damage(next((tmp_path / "cycles").iterdir()))
    assert [c is None for _, c in emptied(spool)] == [False, False, True]
    assert spool.dropped == 1
    assert spool.trouble == f"{tmp_path / 'cycles' / '3.cycle'} is gone or damaged"


def test_what_a_killed_process_left_is_counted_and_removed(tmp_path):
    spool_of(tmp_path / "cycles", 5)
    after = CycleSpool(MemoryBudget(SIZE), tmp_path / "cycles")
    assert after.left == 3
    assert not (tmp_path / "cycles").exists()


def test_what_stays_at_a_stop_is_taken_over_with_the_same_bits(tmp_path, monkeypatch):
    budget, read = MemoryBudget(3 * SIZE), []
    before = spool_of(tmp_path / "cycles", 9, budget)
    before.popleft()
    before.popleft()  # room for a newer one in memory, behind those on disk
    before.append(10, cycle(10))
    before.append(11, None)  # dropped
    before.append(12, cycle(12))
    before.stay()

    def load(path):
        read.append(path)
        return load_cycle(path)

    monkeypatch.setattr(spool_module, "load_cycle", load)
    jobs = list(before)
    assert [n for n, _ in jobs] == [3, 4, 5, 6, 7, 8, 9, 10, 11, 12]
    assert [n for n, c in jobs if c is not None] == [3, 12], "first and last tell when it was"
    assert len(read) == 2, "gigabytes are not read for a snapshot"
    before.close()
    assert budget.used == 0
    (tmp_path / "cycles" / "99.cycle").write_bytes(b"of a killed process")
    after = CycleSpool(MemoryBudget(3 * SIZE), tmp_path / "cycles", jobs)
    assert after.left == 1
    found = emptied(after)
    assert [n for n, c in found if c is None] == [11]
    assert all(same(c, cycle(n)) for n, c in found if c is not None)
    assert [n for n, _ in found] == [n for n, _ in jobs]
    assert not list((tmp_path / "cycles").iterdir())
    after.close()


def test_what_the_disk_does_not_take_at_a_stop_stays_in_the_snapshot(tmp_path, full):
    full(tmp_path / "cycles", 4)
    before = spool_of(tmp_path / "cycles", 5)
    before.stay()
    jobs = list(before)
    before.close()
    after = CycleSpool(MemoryBudget(9 * SIZE), tmp_path / "cycles", jobs)
    assert all(same(c, cycle(n)) for n, c in emptied(after))
    assert after.left == 0


def test_dropped_jobs_cost_nothing_and_are_seen_ahead(tmp_path):
    spool = CycleSpool(MemoryBudget(0), tmp_path / "cycles", [(1, None)])
    assert spool.begins_dropped
    assert spool.popleft() == (1, None)
    assert (spool.dropped, spool.begins_dropped) == (0, False)


def test_closed_it_leaves_nothing(tmp_path):
    budget = MemoryBudget(2 * SIZE)
    spool_of(tmp_path / "cycles", 5, budget).close()
    assert budget.used == 0
    assert not (tmp_path / "cycles").exists()
