# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A restarted twin goes on with the same bits where no sample lacks, else after its cycles."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import valve_twin.core
from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation.valve import SimulatedValve
from valve_twin.core.state import Announced
from valve_twin.core.twin import Estimated
from valve_twin.core.types import Cycle, CycleRule, Prediction
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.config.valve import ValveConfig
from valve_twin.io.errors import StoreError
from valve_twin.io.history import restart as restarts
from valve_twin.io.history.restart import Restart
from valve_twin.io.history.store import History
from valve_twin.io.offline.make_twin import make_twin

NAME = "/plant/valve"
MODEL = get_model("positioner")
OPTIONS = complete_options(MODEL, {"max_delay_s": 0.2})
SAMPLES, CYCLES = 400, 5
NAMES = ("command", "cycle_counter", "position")
CONFIG = ValveConfig(
    name=NAME,
    model="positioner",
    period_s=0.05,
    hold_back_s=2.0,
    signals={n: SignalSource(n, f"/plant/{n}") for n in NAMES},
    cycles=CycleConfig(rule=CycleRule.COUNTER),
    options=OPTIONS,
)


@pytest.fixture(scope="module")
def data():
    """Stamps and columns of five cycles and of the begin of a sixth."""
    valve = SimulatedValve(get_simulation("positioner"), seed=7)
    block = valve.advance(CYCLES * SAMPLES + 20)
    counter = 1.0 + np.arange(len(block)) // SAMPLES
    return block.stamp_ns, {
        "command": block.inputs[:, 0],
        "cycle_counter": counter,
        "position": block.position,
    }


class Life:
    """A twin from its start to its death, with the database that outlives it."""

    def __init__(self, file: Path, config: ValveConfig = CONFIG) -> None:
        self.history, self.config = History(file), config
        self.notes: list[str] = []
        self.claim = self.history.claim(NAME)
        self.restart = Restart(
            self.history,
            config,
            self.claim,
            make=partial(make_twin, config),
            tell=self.notes.append,
        )
        self.predictions: list[Prediction] = []
        self.cycles: list[Cycle] = []
        self.stored: list[bool] = []

    def push(self, data, begin: int, end: int, *, estimates: bool = True, block: int = 37) -> None:
        """Take samples in blocks; without `estimates` the jobs wait."""
        stamps, columns = data
        for a in range(begin, end, block):
            rows = slice(a, min(a + block, end))
            parts = [(name, stamps[rows], columns[name][rows]) for name in NAMES]
            restart = self.restart
            self._take((restart.push if restart.is_open else restart.twin.push_round)(parts))
            if estimates:
                self.estimate()

    def estimate(self) -> None:
        twin = self.restart.twin
        while (job := twin.next_job()) is not None:
            self._take(twin.deliver(*estimate_cycle(MODEL, OPTIONS, job.cycle, job.memory)))

    def _take(self, events) -> None:
        for event in events:
            if isinstance(event, Prediction):
                self.predictions.append(event)
            elif isinstance(event, Cycle):
                self.cycles.append(event)
                self.claim.announce(Announced(event.number, event.start_ns))
            elif isinstance(event, Estimated):
                self.restart.stored(event.cycle.number, event.cycle.start_ns)
                self.stored.append(self.history.store(NAME, event.cycle, event.estimates))

    def save(self) -> None:
        saving = self.restart.saving()
        assert saving is not None
        saving()

    def die(self) -> None:
        self.history.close()


def predicted(*lives: Life) -> dict[int, str]:
    """Return by stamp what was predicted, the last word where it was said twice, to the bit."""
    found = {}
    for prediction in (p for life in lives for p in life.predictions):
        columns = (prediction.measured, prediction.predicted, prediction.simulated)
        for i, stamp in enumerate(prediction.stamp_ns.tolist()):
            values = [float(c[i]).hex() for c in columns]
            shared = (prediction.cycle, float(prediction.residual_sigma).hex())
            found[stamp] = repr((*shared, values, prediction.reproducible))
    return found


def test_a_snapshot_that_costs_much_is_followed_by_a_rest(tmp_path, data, monkeypatch):
    clock = [100.0]

    def save_slowly(*_):
        clock[0] += 0.5
        raise OSError(28, "the disk is full")  # it costs no less

    monkeypatch.setattr(restarts, "save_snapshot", save_slowly)
    monkeypatch.setattr(restarts, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    life = Life(tmp_path / "h.db")
    life.push(data, 0, 100)
    assert not life.restart.is_resting
    with pytest.raises(StoreError, match="cannot be written: the disk is full: free some"):
        life.save()
    resting = []
    for seconds in (0.5 * restarts.REST - 0.01, 0.02):
        clock[0] += seconds
        resting.append(life.restart.is_resting)
    assert resting == [True, False]
    life.die()


def kept(life: Life):
    return life.history.cycles(NAME), list(map(repr, life.history.estimates(NAME)))


@pytest.fixture(scope="module")
def undisturbed(data, tmp_path_factory):
    life = Life(tmp_path_factory.mktemp("whole") / "h.db")
    life.push(data, 0, len(data[0]))
    yield predicted(life), kept(life)
    life.die()


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    saved=st.integers(20, CYCLES * SAMPLES - 20),
    lived=st.integers(0, 60),
    back=st.integers(0, SAMPLES),
)
def test_data_that_goes_on_or_is_given_again_gives_the_bits_of_an_undisturbed_run(
    data, undisturbed, tmp_path_factory, saved, lived, back
):
    """Killed `lived` samples after the snapshot, given again from `back` before it."""
    file = tmp_path_factory.mktemp("killed") / "h.db"
    first = Life(file)
    first.push(data, 0, saved)
    first.save()
    last = first.history.last_record(NAME)
    lived = min(lived, SAMPLES - saved % SAMPLES - 40)  # no cycle is stored after the snapshot
    first.push(data, saved, saved + max(lived, 0))
    first.die()
    begin = 0 if last is None else int(np.searchsorted(data[0], last.start_ns))
    second = Life(file)
    second.push(data, max(begin, saved - back), len(data[0]))
    assert second.notes
    assert "goes on where it ended" in second.notes[0]
    assert all(second.stored)
    assert (predicted(first, second), kept(second)) == undisturbed
    second.die()


def test_a_cycle_that_waited_for_its_estimation_is_stored_after_the_restart(
    data, undisturbed, tmp_path
):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, SAMPLES + 100)
    first.push(data, SAMPLES + 100, 2 * SAMPLES + 100, estimates=False)
    assert first.restart.twin.pending_jobs == 1
    first.save()
    first.die()
    second = Life(tmp_path / "h.db")
    second.estimate()
    assert second.stored == [True]
    second.push(data, 2 * SAMPLES + 100, len(data[0]))
    assert (predicted(first, second), kept(second)) == undisturbed
    second.die()


def test_where_samples_are_missing_the_running_cycle_is_left_out_and_closed_ones_are_kept(
    data, undisturbed, tmp_path
):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 2 * SAMPLES - 10)
    first.push(data, 2 * SAMPLES - 10, 2 * SAMPLES + 100, estimates=False)
    first.save()
    first.die()
    second = Life(tmp_path / "h.db")
    second.push(data, 2 * SAMPLES + 102, len(data[0]))
    assert second.notes == [
        f"{NAME}: samples are missing since it ended: cycle 3, which was running, is left out"
    ]
    cycles, estimates = kept(second)
    whole, whole_estimates = undisturbed[1]
    assert [c.cycle for c in cycles] == [1, 2, 4, 5]
    assert cycles[:2] == whole[:2]
    assert estimates[: len(estimates) // 2] == whole_estimates[: len(estimates) // 2]
    assert [c.start_ns for c in cycles[2:]] == [c.start_ns for c in whole[3:]]
    assert not (tmp_path / "h.db-twin.plant.valve").exists()
    second.die()


@pytest.mark.parametrize("lost", [1, 30])
def test_a_gap_behind_data_given_again_is_no_reason_to_store_a_cycle_twice(data, tmp_path, lost):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 2 * SAMPLES - 10)
    first.push(data, 2 * SAMPLES - 10, 2 * SAMPLES + 100, estimates=False)
    first.save()
    first.die()
    second = Life(tmp_path / "h.db")
    second.push(data, 2 * SAMPLES - 50, 2 * SAMPLES + 100, block=7)
    assert second.restart.is_open
    second.push(data, 2 * SAMPLES + 100 + lost, len(data[0]), block=7)
    cycles, _ = kept(second)
    starts = [c.start_ns for c in cycles]
    assert len(set(starts)) == len(starts)
    assert [c.cycle for c in cycles] == [1, 2, 3, 4, 5]
    assert [c.lost for c in cycles] == [0, 0, lost, 0, 0]
    assert not cycles[2].reproducible
    second.die()


def test_data_of_another_time_is_taken_as_without_a_snapshot(data, tmp_path):
    stamps, columns = data
    other = (stamps - 10**12, columns | {"cycle_counter": columns["cycle_counter"] + 10})
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 2 * SAMPLES + 100)
    first.save()
    first.die()
    (tmp_path / "without").mkdir()
    for name in ("h.db", "h.db-writers"):
        (tmp_path / "without" / name).write_bytes((tmp_path / name).read_bytes())
    found = []
    for file in (tmp_path / "h.db", tmp_path / "without" / "h.db"):
        life = Life(file)
        life.push(other, 0, 3 * SAMPLES)
        found.append((predicted(life), kept(life)))
        life.die()
    assert found[0][1] == found[1][1]
    assert found[0][0].keys() == found[1][0].keys()
    assert [c.cycle for c in found[0][1][0]] == [1, 2, 12]


def test_a_snapshot_older_than_the_last_stored_cycle_is_refused(data, tmp_path):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, SAMPLES + 100)
    first.save()
    first.push(data, SAMPLES + 100, 2 * SAMPLES + 100)
    first.die()
    second = Life(tmp_path / "h.db")
    (note,) = second.notes
    assert "the history ends with another cycle: cycles go on after the last stored one" in note
    assert not second.restart.is_open
    assert second.restart.last_cycle == 2
    second.die()


@pytest.mark.parametrize(
    "changes",
    [
        {"period_s": 0.06},
        {"hold_back_s": 1.0},
        {"options": complete_options(MODEL, {"max_delay_s": 0.3})},
        {"cycles": CycleConfig(rule=CycleRule.COUNTER, min_cycle_s=1.5)},
        {"signals": CONFIG.signals | {"position": SignalSource("position", "/other/position")}},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_snapshot_of_another_configuration_is_refused(data, tmp_path, changes):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 100)
    first.save()
    first.die()
    second = Life(tmp_path / "h.db", replace(CONFIG, **changes))
    (note,) = second.notes
    assert "the valve was configured otherwise: cycles go on after the last stored one" in note
    assert second.restart.twin.cycle == 0
    second.die()


def test_a_snapshot_of_another_build_of_the_same_version_is_refused(data, tmp_path, monkeypatch):
    """The states of other code may have the same length and another meaning."""
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 100)
    first.save()
    first.die()
    core = tmp_path / "core"
    shutil.copytree(Path(valve_twin.core.__path__[0]), core)
    kernels = core / "valves" / "positioner" / "kernels.py"
    kernels.write_text(kernels.read_text().replace("MEMORY = 1 + MAX_LAG + 1", "MEMORY = 1026"))
    monkeypatch.setattr(valve_twin.core, "__file__", str(core / "__init__.py"))
    restarts.build_of.cache_clear()
    second = Life(tmp_path / "h.db")
    restarts.build_of.cache_clear()
    (note,) = second.notes
    assert "it is of another build of valve_twin or of the model: cycles go on after" in note
    assert second.restart.twin.cycle == 0
    assert not second.restart.is_open
    second.die()


def test_a_model_of_another_package_tells_its_builds_apart_too(tmp_path, monkeypatch):
    (tmp_path / "my_valve.py").write_text("MODEL = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(restarts, "model_module", lambda name: "my_valve")
    build = restarts.build_of.__wrapped__
    before = build("my_valve")
    assert build("my_valve") == before
    (tmp_path / "my_valve.py").write_text("MODEL = 2\n")
    assert build("my_valve") != before


def test_a_request_before_the_first_sample_leaves_the_running_cycle_out(data, tmp_path):
    first = Life(tmp_path / "h.db")
    first.push(data, 0, SAMPLES + 100)
    first.save()
    first.die()
    second = Life(tmp_path / "h.db")
    assert second.restart.saving() is None  # the one before still holds
    second.restart.give_up()
    assert second.restart.twin.cycle == 0
    assert second.restart.twin.close_cycle() == []
    second.die()


def test_waiting_cycles_outlive_a_second_stop_before_any_sample(data, undisturbed, tmp_path):
    """Three cycles wait; one is estimated while nothing is heard; the twin stops again."""
    first = Life(tmp_path / "h.db")
    first.push(data, 0, 3 * SAMPLES + 100, estimates=False)
    first.save()
    first.die()
    second = Life(tmp_path / "h.db")
    twin = second.restart.twin
    job = twin.next_job()
    assert job is not None
    second._take(twin.deliver(*estimate_cycle(MODEL, OPTIONS, job.cycle, job.memory)))
    assert second.restart.is_open
    second.save()
    second.die()
    third = Life(tmp_path / "h.db")
    third.push(data, 3 * SAMPLES + 100, len(data[0]))
    assert kept(third) == undisturbed[1]
    third.die()


@pytest.mark.parametrize("until", [300, SAMPLES + 100, 3 * SAMPLES + 100])
def test_a_stream_given_again_from_before_its_first_cycle_keeps_its_numbers(data, tmp_path, until):
    """Nothing is stored when it dies, so that all is given again, the samples before cycle 1 too.

    Twice: the second time dies with less than the first had seen.
    """
    stamps, columns = data
    lead, period_ns = 60, int(stamps[1] - stamps[0])
    before = stamps[0] - period_ns * np.arange(lead, 0, -1)
    longer = {n: np.concatenate([np.full(lead, c[0]), c]) for n, c in columns.items()}
    longer["cycle_counter"][:lead] = np.nan
    again = np.concatenate([before, stamps]), longer
    told: dict[int, int] = {}
    for end in (lead + until, lead + until // 2, len(stamps)):
        life = Life(tmp_path / "h.db")
        assert life.restart.last_cycle == 0
        life.push(again, 0, end, estimates=end == len(stamps))
        for cycle in life.cycles:
            assert told.setdefault(cycle.start_ns, cycle.number) == cycle.number
        if not life.restart.is_open:
            life.save()
        life.die()
    assert sorted(told.values()) == list(range(1, len(told) + 1))
    last = Life(tmp_path / "h.db")
    assert [c.cycle for c in kept(last)[0]] == sorted(told.values())
    last.die()
