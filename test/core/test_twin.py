# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The twin emits the same bits however its input is cut and however long an estimation takes."""

from __future__ import annotations

import inspect
import itertools
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valve_twin.core.alignment import SignalRange
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.twin import ClockJump, Estimated, Job, Twin, TwinConfig
from valve_twin.core.types import Cycle, CycleRule, Prediction, join_blocks
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

MODEL = get_model("positioner")
OPTIONS = complete_options(MODEL, {"max_delay_s": 0.2})
CONFIG = TwinConfig(
    period_s=0.05,
    signals=(SignalRange("position", -0.2, 1.2), SignalRange("command", -0.1, 1.1)),
    counter=SignalRange("cycle_counter"),
    cycles=CycleConfig(rule=CycleRule.COUNTER),
    options=OPTIONS,
)
CYCLES = 6
SAMPLES = 600


@pytest.fixture(scope="module")
def record():
    """Six cycles of the simulated positioner and the beginning of a seventh."""
    valve = SimulatedValve(get_simulation("positioner"), seed=7)
    return join_blocks([valve.advance(SAMPLES) for _ in range(CYCLES)] + [valve.advance(20)])


def push_all(twin, block, cuts=(), patience=0):
    """Drive a twin; an estimation is delivered `patience` pushes after it was asked for."""
    columns = {
        "command": block.inputs[:, 0],
        "cycle_counter": block.cycle.astype(float),
        "position": block.position,
    }
    events, job, waited = [], None, 0
    edges = [0, *sorted(cuts), len(block)]
    for a, b in itertools.pairwise(edges):
        for name, values in columns.items():
            if b > a:
                events += twin.push(name, block.stamp_ns[a:b], values[a:b])
            job = job or twin.next_job()
            waited += job is not None
            if job is not None and waited > patience:
                events += deliver(twin, job)
                job, waited = None, 0
    while (job := job or twin.next_job()) is not None:
        events += deliver(twin, job)
        job = None
    return events


@cache
def estimated(job):
    """Estimate a pickled cycle with its memory: whatever is the same to the bit only once."""
    return estimate_cycle(MODEL, OPTIONS, *pickle.loads(job))


def deliver(twin, job):
    return twin.deliver(*estimated(pickle.dumps((job.cycle, job.memory))))


def bits(events):
    """All that was published, joined cycle by cycle."""
    predictions = [e for e in events if isinstance(e, Prediction)]
    names = ("stamp_ns", "predicted", "simulated", "residual", "validity")
    joined = {k: np.concatenate([getattr(p, k) for p in predictions]).tobytes() for k in names}
    numbers = np.concatenate([np.full(len(p.stamp_ns), p.cycle) for p in predictions]).tobytes()
    sigmas = [p.residual_sigma for p in predictions for _ in p.stamp_ns]
    estimates = [
        repr(e) for event in events if isinstance(event, Estimated) for e in event.estimates
    ]
    return joined, numbers, repr(sigmas), estimates


def test_samples_that_wait_are_one_part_a_cycle_in_a_snapshot_and_give_the_same_bits(record):
    def run(*, saves):
        twin, events = Twin(CONFIG, MODEL), []
        for at in range(0, len(record), 5):
            stamp_ns, counter = record.stamp_ns[at : at + 5], record.cycle[at : at + 5]
            events += twin.push("command", stamp_ns, record.inputs[at : at + 5, 0])
            events += twin.push("cycle_counter", stamp_ns, counter.astype(float))
            events += twin.push("position", stamp_ns, record.position[at : at + 5])
            if saves and twin.waits:
                waiting = twin.snapshot().waiting
                assert len(waiting) == len({part.ordinal for part in waiting})
        while (job := twin.next_job()) is not None:
            events += deliver(twin, job)
        return bits(events)

    assert run(saves=True) == run(saves=False)


def test_every_sample_is_predicted_once_and_every_cycle_estimated(record):
    events = push_all(Twin(CONFIG, MODEL), record)
    predicted = sum(len(e.stamp_ns) for e in events if isinstance(e, Prediction))
    assert predicted == len(record)
    assert [e.number for e in events if isinstance(e, Cycle)] == [1, 2, 3, 4, 5, 6]
    assert [e.cycle.number for e in events if isinstance(e, Estimated)] == [1, 2, 3, 4, 5, 6]


def test_an_estimate_takes_effect_two_cycles_later(record):
    events = push_all(Twin(CONFIG, MODEL), record)
    known: dict[int, int] = {}
    for e in events:
        if isinstance(e, Prediction):
            finite = int(np.count_nonzero(np.isfinite(e.predicted)))
            known[e.cycle] = known.get(e.cycle, 0) + finite
    assert known[1] + known[2] == 0
    assert known[3] > 0.9 * SAMPLES
    residuals = [e.residual for e in events if isinstance(e, Prediction) and e.cycle >= 3]
    assert np.nanstd(np.concatenate(residuals)) < 5e-3


@pytest.mark.no_cover
@given(st.lists(st.integers(1, CYCLES * SAMPLES), max_size=25), st.integers(0, 12))
@settings(max_examples=15)
def test_neither_blocks_nor_slow_estimations_change_a_bit(record, cuts, patience):
    whole = bits(push_all(Twin(CONFIG, MODEL), record))
    assert bits(push_all(Twin(CONFIG, MODEL), record, cuts, patience)) == whole


def test_samples_wait_for_the_estimate_they_need(record):
    twin = Twin(CONFIG, MODEL)
    block = record
    events = []
    for name, values in (("command", block.inputs[:, 0]), ("cycle_counter", block.cycle * 1.0)):
        events += twin.push(name, block.stamp_ns, values)
    events += twin.push("position", block.stamp_ns, block.position)
    assert max(e.cycle for e in events if isinstance(e, Prediction)) == 2
    assert twin.pending_jobs == CYCLES
    events = deliver(twin, twin.next_job())
    assert {e.cycle for e in events if isinstance(e, Prediction)} == {3}


def gone_on(record, late, until):
    """Drive a twin that does not wait; the estimate of cycle `late` is there at sample `until`."""
    twin, events = Twin(CONFIG, MODEL), []
    job: Job | None = None
    columns = {"command": record.inputs[:, 0], "cycle_counter": record.cycle * 1.0}
    for at in range(0, len(record), 50):
        part = slice(at, at + 50)
        for name, values in {**columns, "position": record.position}.items():
            events += twin.push(name, record.stamp_ns[part], values[part])
        while (job := job or twin.next_job()) and (job.cycle.number != late or at >= until):
            events += deliver(twin, job)
            job = None
        events += twin.go_on()
    return events


def by_cycle(events):
    """Bits of the predictions of each cycle and what they say of themselves."""
    found = {}
    for n in range(1, CYCLES + 2):
        parts = [e for e in events if isinstance(e, Prediction) and e.cycle == n]
        names = ("stamp_ns", "predicted", "simulated", "residual", "validity")
        said = {e.reproducible for e in parts}
        found[n] = [np.concatenate([getattr(p, k) for p in parts]).tobytes() for k in names], said
    return found


def test_who_does_not_wait_says_so_until_the_due_estimate_is_in_force(record):
    waited = by_cycle(push_all(Twin(CONFIG, MODEL), record))
    events = gone_on(record, late=2, until=int(4.5 * SAMPLES))  # in the middle of cycle 5
    went_on = by_cycle(events)
    assert [went_on[n][1] for n in range(1, 8)] == [
        {True}, {True}, {True}, {False}, {False}, {True}, {True}
    ]  # fmt: skip
    assert [n for n in waited if went_on[n][0] != waited[n][0]] == [4, 5]
    estimates = [e for event in events if isinstance(event, Estimated) for e in event.estimates]
    assert {e.cycle for e in estimates if not e.reproducible} == {4, 5}


def test_nothing_is_waited_for_behind_an_estimate_that_was_not_waited_for(record):
    twin = Twin(CONFIG, MODEL)
    for name, values in (("command", record.inputs[:, 0]), ("cycle_counter", record.cycle * 1.0)):
        twin.push(name, record.stamp_ns, values)
    twin.push("position", record.stamp_ns, record.position)
    events = twin.go_on()
    assert {e.cycle for e in events if isinstance(e, Prediction)} == {3, 4, 5, 6, 7}
    assert not twin.waits
    assert twin.go_on() == []


def test_one_job_at_a_time(record):
    twin = Twin(CONFIG, MODEL)
    with pytest.raises(ValueError, match="no estimation is running"):
        twin.deliver((), Memory.empty())
    push_all(twin, record)
    assert twin.next_job() is None


def test_a_clock_set_back_drops_the_cycle_and_keeps_what_was_learnt(record):
    twin = Twin(CONFIG, MODEL)
    push_all(twin, record)
    back = replace(record, stamp_ns=record.stamp_ns - 10**12, cycle=record.cycle + 6)
    events = push_all(twin, back)
    jumps = [e for e in events if isinstance(e, ClockJump)]
    assert jumps[0].dropped_cycle == 7
    numbers = [e.cycle.number for e in events if isinstance(e, Estimated)]
    assert numbers == [7, 8, 9, 10, 11, 12]
    first = next(e for e in events if isinstance(e, Prediction) and e.cycle == 7)
    assert np.isfinite(first.residual_sigma)


def test_a_sample_that_cannot_be_believed_is_marked_and_the_rest_predicted(record):
    position = record.position.copy()
    position[[1500, 1600]] = [np.nan, 7.0]
    events = push_all(Twin(CONFIG, MODEL), replace(record, position=position))
    validity = np.concatenate([e.validity for e in events if isinstance(e, Prediction)])
    residual = np.concatenate([e.residual for e in events if isinstance(e, Prediction)])
    assert np.flatnonzero(validity == 5).tolist() == [1500, 1600]
    assert np.isnan(residual[[1500, 1600]]).all()
    assert (validity[1700:] == 0).all()


def test_receive_times_are_said_to_be_not_reproducible(record):
    twin = Twin(CONFIG, MODEL)
    columns = {"command": record.inputs[:, 0], "cycle_counter": record.cycle * 1.0}
    for name, values in columns.items():
        twin.push(name, record.stamp_ns, values, header=False)
    twin.push("position", record.stamp_ns, record.position, header=False)
    job = twin.next_job()
    assert job is not None
    assert not job.cycle.reproducible
    assert not estimate_cycle(MODEL, OPTIONS, job.cycle, job.memory)[0][0].reproducible


def test_a_counter_that_lags_beyond_hold_back_has_its_cycles_refused(record):
    lag = 3 * 20  # samples: hold_back_s is 2 s
    columns = {"command": record.inputs[:, 0], "position": record.position}
    twin, events = Twin(CONFIG, MODEL), []
    for at in range(0, len(record), 10):
        for name, values in columns.items():
            events += twin.push(name, record.stamp_ns[at : at + 10], values[at : at + 10])
        behind = slice(max(at - lag, 0), max(at - lag + 10, 0))
        counter = record.cycle[behind].astype(float)
        events += twin.push("cycle_counter", record.stamp_ns[behind], counter)
    cycles = [e for e in events if isinstance(e, Cycle)]
    assert len(cycles) == CYCLES - 1
    assert not any(c.accepted or c.reproducible for c in cycles)
    assert "samples of cycle_counter, which cuts the cycles, came later" in cycles[0].reason


def test_the_mean_of_a_condition_stands_in_every_estimate(record):
    twin = Twin(replace(CONFIG, conditions=(SignalRange("load"),)), MODEL)
    columns = {
        "command": record.inputs[:, 0],
        "cycle_counter": record.cycle * 1.0,
        "load": 100.0 * record.cycle + np.arange(len(record)) % 2,
        "position": record.position,
    }
    events = []
    for name, values in columns.items():
        events += twin.push(name, record.stamp_ns, values)
    while (job := twin.next_job()) is not None:
        events += deliver(twin, job)
    estimates = [e for x in events if isinstance(x, Estimated) for e in x.estimates]
    assert len(estimates) >= CYCLES - 1
    for estimate in estimates:
        found = {c.name: c.value for c in estimate.conditions}
        assert found["load"] == pytest.approx(100.0 * estimate.cycle + 0.5, abs=0.01)
        assert found["stroke"] > 0.0
        assert "temperature" not in found


def disturbed(record, seed):
    """Return pushes of the record: blocks of any length, one gap, one clock that was set back."""
    rng = np.random.default_rng(seed)
    edges = np.unique(np.concatenate(([0, len(record)], rng.integers(1, len(record), 30))))
    gap = int(rng.integers(SAMPLES, 4 * SAMPLES))
    jump = int(rng.integers(1, len(edges) - 1))
    kept = np.flatnonzero((np.arange(len(record)) < gap) | (np.arange(len(record)) > gap + 40))
    columns = {
        "command": record.inputs[:, 0],
        "cycle_counter": record.cycle.astype(float),
        "position": record.position,
    }
    pushes = []
    for k, (a, b) in enumerate(itertools.pairwise(edges)):
        rows = kept[(kept >= a) & (kept < b)]
        back = 10**10 if k >= jump else 0
        pushes += [(name, record.stamp_ns[rows] - back, v[rows]) for name, v in columns.items()]
    return pushes


def run_with_restart(pushes, patience, restart):
    """Push all; at push `restart` another twin goes on from the snapshot of the first."""
    twin, events, job, waited = Twin(CONFIG, MODEL), [], None, 0
    for k, (name, stamps, values) in enumerate(pushes):
        if k == restart:
            state = pickle.loads(pickle.dumps(twin.snapshot()))
            twin = Twin(CONFIG, MODEL, last_cycle=3)
            twin.restore(state)
            job = twin.next_job() if job is not None else None
        events += twin.push(name, stamps, values)
        job = job or twin.next_job()
        waited += job is not None
        if job is not None and waited > patience:
            events += deliver(twin, job)
            job, waited = None, 0
    while (job := job or twin.next_job()) is not None:
        events += deliver(twin, job)
        job = None
    return [*events, *twin.finish()], twin.counts()


@given(st.integers(0, 2**32 - 1), st.integers(0, 12), st.integers(0, 89))
@settings(max_examples=15)
def test_a_twin_goes_on_from_a_snapshot_with_the_same_bits(record, seed, patience, restart):
    """Inside a cycle, in a gap, after a clock jump, with a job out: wherever it is taken."""
    pushes = disturbed(record, seed)
    whole, counted = run_with_restart(pushes, patience, restart=-1)
    again, counted_again = run_with_restart(pushes, patience, restart % len(pushes))
    assert bits(again) == bits(whole)
    assert repr([e for e in again if isinstance(e, ClockJump)]) == repr(
        [e for e in whole if isinstance(e, ClockJump)]
    )
    cycles, cycles_again = ([e for e in run if isinstance(e, Cycle)] for run in (whole, again))
    assert [(c.number, c.reason, c.missed_cycles, c.reproducible) for c in cycles_again] == [
        (c.number, c.reason, c.missed_cycles, c.reproducible) for c in cycles
    ]
    assert counted_again == counted


CONFIGURED = {
    *("_config", "_model", "predicts", "_period_s", "_columns", "_limits_ns", "_step_ns"),
    "_cut_by",
    *("_n_inputs", "_names", "_counter", "_reference", "_conditions", "_hold_back_ns", "_jump_ns"),
}


def test_a_restore_sets_all_that_is_not_configured():
    """Whoever gives a part one more thing to remember gives it to its state, too."""
    twin = Twin(CONFIG, MODEL)
    for part in (twin, twin._segmenter, twin._aligner):
        source = inspect.getsource(type(part).restore)
        names = set(vars(part)) - CONFIGURED
        assert len(names) >= 4
        assert [name for name in names if f"self.{name}" not in source] == []


def test_a_snapshot_of_other_signals_is_refused():
    other = replace(CONFIG, counter=None)
    state = Twin(other, MODEL).snapshot()
    with pytest.raises(ValueError, match=r"of the signals position, command, not .*cycle_counter"):
        Twin(CONFIG, MODEL).restore(state)
