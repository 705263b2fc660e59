# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Snapshots come back to the bit or not at all, and one line says why not."""

from __future__ import annotations

import cProfile
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from valve_twin.core.alignment import SignalRange
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.refusal import Refusal, RefusalCode
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.twin import Estimated, Twin, TwinConfig
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.io.errors import StoreError
from valve_twin.io.history import snapshot as snapshots
from valve_twin.io.history.snapshot import Origin, save_snapshot

MODEL = get_model("positioner")
OPTIONS = complete_options(MODEL, {"max_delay_s": 0.2})
CONFIG = TwinConfig(
    period_s=0.05,
    signals=(SignalRange("position"), SignalRange("command")),
    counter=SignalRange("cycle_counter"),
    conditions=(SignalRange("load"),),
    cycles=CycleConfig(rule=CycleRule.COUNTER),
    options=OPTIONS,
)
ORIGIN = Origin("1.0", "/plant/valve", "configuration", 3, 10**18)


@pytest.fixture(scope="module")
def learnt():
    """State and estimates of a twin inside its fifth cycle, one job under way, one waiting."""
    valve = SimulatedValve(get_simulation("positioner"), seed=7)
    block = valve.advance(4 * 300 + 150)
    counter = 1.0 + np.arange(len(block)) // 300
    columns = {
        "command": block.inputs[:, 0],
        "cycle_counter": counter,
        "load": np.where(counter > 1, 2.5, np.nan),
        "position": block.position,
    }
    twin, estimates = Twin(CONFIG, MODEL), []
    for a in range(0, len(block), 50):
        for name, values in columns.items():
            twin.push(name, block.stamp_ns[a : a + 50], values[a : a + 50])
        while a < 700 and (job := twin.next_job()) is not None:
            found = twin.deliver(*estimate_cycle(MODEL, OPTIONS, job.cycle, job.memory))
            estimates += [e for x in found if isinstance(x, Estimated) for e in x.estimates]
    assert twin.next_job() is not None
    assert twin.pending_jobs == 2
    assert twin.waits
    return twin.snapshot(), estimates


@pytest.fixture
def path(tmp_path, learnt):
    found = tmp_path / "h.db-twin.plant.valve"
    save_snapshot(found, ORIGIN, learnt[0])
    return found


def load_snapshot(*given: Any) -> Any:
    return snapshots.load_snapshot(*given)


def bits(value) -> str:
    with np.printoptions(threshold=10**9, floatmode="unique"):
        return repr(value)


def test_a_state_comes_back_to_the_bit(path, learnt):
    state, estimates = learnt
    found = load_snapshot(path, ORIGIN, lambda: estimates)
    assert bits(found) == bits(state)
    for ours, theirs in zip(found.waiting, state.waiting, strict=True):
        assert ours.frames.stamp_ns.dtype == theirs.frames.stamp_ns.dtype
        assert ours.frames.inputs.tobytes() == theirs.frames.inputs.tobytes()
        assert ours.frames.conditions.tobytes() == theirs.frames.conditions.tobytes()


def test_the_time_to_save_grows_with_the_samples_and_not_with_their_square(tmp_path, learnt):
    state, path = learnt[0], tmp_path / "many"
    part = replace(state.waiting[0], frames=state.waiting[0].frames[:1], opens=False)

    def steps(count):
        state_of_many = replace(state, waiting=(part,) * count)
        profile = cProfile.Profile()
        profile.runcall(save_snapshot, path, ORIGIN, state_of_many)
        return sum(entry.callcount for entry in profile.getstats())

    assert steps(400) < 5 * steps(100)


def test_the_code_of_a_refused_cycle_comes_back(path, learnt):
    state, estimates = learnt
    (ordinal, cycle), *rest = state.jobs
    reason = Refusal(RefusalCode.CYCLE_TOO_SHORT, "too short")
    jobs = ((ordinal, replace(cycle, accepted=False, reason=reason)), *rest, (9, None))
    save_snapshot(path, ORIGIN, replace(state, jobs=jobs))
    found = load_snapshot(path, ORIGIN, lambda: estimates)
    assert found.jobs[0][1].reason == "too short"
    assert found.jobs[0][1].reason.code is RefusalCode.CYCLE_TOO_SHORT
    assert found.jobs[-1] == (9, None)


def test_a_full_disk_keeps_the_one_before_and_nothing_of_the_next(path, learnt, monkeypatch):
    def write_half(self, content):
        with self.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    state, estimates = learnt
    monkeypatch.setattr(Path, "write_bytes", write_half)
    with pytest.raises(OSError, match="No space left"):
        save_snapshot(path, ORIGIN, replace(state, last_ns=1))
    assert list(path.parent.iterdir()) == [path]
    assert bits(load_snapshot(path, ORIGIN, lambda: estimates)) == bits(state)


def test_what_would_not_come_back_is_not_saved(path, learnt):
    state, estimates = learnt
    with pytest.raises(TypeError, match="a state holds a RefusalCode, which a snapshot cannot"):
        save_snapshot(path, ORIGIN, replace(state, done=RefusalCode.OTHER))
    assert bits(load_snapshot(path, ORIGIN, lambda: estimates)) == bits(state)


def test_a_twin_goes_on_from_it(path, learnt):
    state, estimates = learnt
    twins = [Twin(CONFIG, MODEL), Twin(CONFIG, MODEL)]
    twins[0].restore(state)
    twins[1].restore(load_snapshot(path, ORIGIN, lambda: estimates))
    found = []
    for twin in twins:
        events = []
        while (job := twin.next_job()) is not None:
            events += twin.deliver(*estimate_cycle(MODEL, OPTIONS, job.cycle, job.memory))
        found.append(bits([*events, *twin.finish()]))
    assert found[0] == found[1]


def test_where_there_is_none_there_is_none(tmp_path):
    assert load_snapshot(tmp_path / "none", ORIGIN, list) is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"software": "1.1"}, "of another version of valve_twin"),
        ({"valve": "/plant/other"}, "of another valve"),
        ({"configuration": "other"}, "the valve was configured otherwise"),
        ({"cycle": 4}, "the history ends with another cycle"),
        ({"start_ns": 1}, "the history ends with another cycle"),
    ],
)
def test_one_of_another_origin_is_refused(path, learnt, changes, why):
    with pytest.raises(StoreError, match=why) as caught:
        load_snapshot(path, replace(ORIGIN, **changes), lambda: learnt[1])
    assert str(caught.value).startswith(f"{path}: is not used: ")
    assert "\n" not in str(caught.value)


def test_one_of_another_layout_is_refused(path, learnt, monkeypatch):
    fewer = dict(list(snapshots._RECORDS.items())[1:])
    monkeypatch.setattr(snapshots, "_RECORDS", fewer)
    monkeypatch.setattr(snapshots, "_layout", snapshots._layout.__wrapped__)
    with pytest.raises(StoreError, match="of another version"):
        load_snapshot(path, ORIGIN, lambda: learnt[1])


def test_one_whose_estimates_the_history_lacks_is_refused(path, learnt):
    with pytest.raises(StoreError, match="the history lacks estimates of that time"):
        load_snapshot(path, ORIGIN, lambda: learnt[1][1:])


@pytest.mark.parametrize("part", [0.0, 0.001, 0.1, 0.5, 0.999])
def test_a_damaged_one_is_refused(path, learnt, part):
    whole = path.read_bytes()
    at = int(part * len(whole))
    damaged = [whole[:at], whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :], whole + b"x"]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(StoreError, match=r"it is (damaged|no snapshot of a twin)"):
            load_snapshot(path, ORIGIN, lambda: learnt[1])


def test_a_foreign_file_is_refused(path):
    path.write_text("cycle,K_in\n")
    with pytest.raises(StoreError, match="it is no snapshot of a twin"):
        load_snapshot(path, ORIGIN, list)


def test_one_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(StoreError, match="it cannot be read: Is a directory"):
        load_snapshot(tmp_path, ORIGIN, list)


WRITER = """
import pickle, sys
from pathlib import Path
from valve_twin.io.history.snapshot import Origin, save_snapshot

state = pickle.loads(Path(sys.argv[2]).read_bytes())
origin = Origin("1.0", "/plant/valve", "configuration", 3, 10**18)
print("ready", flush=True)
while True:
    save_snapshot(Path(sys.argv[1]), origin, state)
"""


def test_whoever_is_killed_while_it_writes_leaves_a_whole_one(tmp_path, learnt):
    import pickle

    path, given = tmp_path / "h.db-twin.plant.valve", tmp_path / "state"
    given.write_bytes(pickle.dumps(learnt[0]))
    for _ in range(5):
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path), str(given)], stdout=subprocess.PIPE
        )
        assert process.stdout is not None
        process.stdout.readline()
        while not path.exists():
            assert process.poll() is None
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        found = load_snapshot(path, ORIGIN, lambda: learnt[1])
        assert bits(found) == bits(learnt[0])
        path.unlink()
