# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import errno
import os
from pathlib import Path

import pytest

from test.io.history.test_store import VALVE, both, record
from valve_twin.core.operation.counters import Counters
from valve_twin.io.errors import StoreError
from valve_twin.io.history.store import History
from valve_twin.io.history.unsaved import UnsavedCycle, UnsavedCycles, unsaved_of

CYCLE = UnsavedCycle(record(3), both(3), Counters(cycle=3, cycles=3))


@pytest.fixture
def unsaved(tmp_path):
    return UnsavedCycles(tmp_path / "state", "postgresql://valve@/db")


def test_a_cycle_comes_back_as_it_was(unsaved, tmp_path):
    path = unsaved.put(VALVE, CYCLE)
    assert unsaved.waiting(VALVE) == [path]
    found = unsaved.read(VALVE, path)
    assert found is not None
    with History(tmp_path / "a.db") as history:
        assert history.store(VALVE, *found)
        assert not history.store(VALVE, *CYCLE)  # exactly this is stored
        assert history.log.counters(VALVE) == CYCLE.counters


def test_they_come_in_order_and_each_valve_has_its_own(unsaved):
    for cycle in (10, 9, 100):
        unsaved.put(VALVE, UnsavedCycle(record(cycle)))
    other = unsaved.put(f"{VALVE}.1", UnsavedCycle(record(1)))
    found = [unsaved.read(VALVE, path) for path in unsaved.waiting(VALVE)]
    assert [f.record.cycle for f in found if f] == [9, 10, 100]
    assert unsaved.waiting(f"{VALVE}.1") == [other]
    assert unsaved.read(VALVE, other) is None


def test_a_damaged_file_is_none(unsaved):
    path = unsaved.put(VALVE, CYCLE)
    sound = path.read_bytes()
    for place in range(0, len(sound), 97):
        path.write_bytes(sound[:place] + bytes([sound[place] ^ 1]) + sound[place + 1 :])
        assert unsaved.read(VALVE, path) is None
    os.truncate(path, 100)
    assert unsaved.read(VALVE, path) is None
    path.unlink()
    assert unsaved.read(VALVE, path) is None


def test_a_disk_that_fails_leaves_nothing_behind(unsaved, tmp_path, monkeypatch):
    whole = Path.write_bytes

    def fill(path, data):
        whole(path, data[:20])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", fill)
        with pytest.raises(OSError, match="No space"):
            unsaved.put(VALVE, CYCLE)
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == []


def test_what_cannot_be_read_now_is_not_gone(unsaved, monkeypatch):
    path = unsaved.put(VALVE, CYCLE)

    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(StoreError, match="cannot be read: Permission denied"):
        unsaved.read(VALVE, path)
    with pytest.raises(StoreError, match="cannot be read: Permission denied"):
        unsaved.waiting(VALVE)


def test_only_what_a_server_keeps_waits_in_the_folder(server, tmp_path, monkeypatch):
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    with History(server) as history, History(tmp_path / "a.db") as file:
        assert unsaved_of(history, "") is None
        assert unsaved_of(file, str(tmp_path)) is None
        assert unsaved_of(history, str(tmp_path)) is not None
        monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
        assert unsaved_of(history, "") is not None
