# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An archive is estimated bag by bag: resumable, bad bags named, the same bits anywhere."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from test.bag_samples import write_sample
from valve_twin.cli import main
from valve_twin.io.bags.read import BagWriter
from valve_twin.io.batch.archive import estimate_task, find_bags, lost_bag, run_batch
from valve_twin.io.batch.results import BatchTask, Results, digest_of
from valve_twin.io.batch.runners import LocalRunner
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import BagError, ValveTwinError

CONFIG = """\
/**:
  ros__parameters:
    valves: [press/valve_1, press/valve_2]
    model: {model}
    topic_prefix: /sim
    cycles: {{rule: commands, start_signal: v_in, rearm_signal: v_out}}
    options: {{estimators: [equation_error_qp4], output_error: false, lag: 2}}
"""
GOOD = ("line_a/monday", "line_a/tuesday", "line_b/monday")
BAGS = 20
"""Of a batch that a signal ends: far more than are done until it comes."""
KILLER = """\
import dataclasses, os
from valve_twin.core.valves.press_cartridge.model import PressCartridgeModel

@dataclasses.dataclass(frozen=True)
class Killer(PressCartridgeModel):
    name: str = "killer"

    def input_fault(self, cycle, *rest):
        if len(cycle.frames) < 300:
            os._exit(9)
        return super().input_fault(cycle, *rest)

MODEL = Killer()
"""


@pytest.fixture(scope="module")
def archive(tmp_path_factory, root):
    """Return an archive of three good bags and two bad ones, and its configuration."""
    folder = tmp_path_factory.mktemp("archive")
    bags = folder / "bags"
    simulation = root / "config" / "simulated_press.yaml"
    for seed, name in enumerate(GOOD):
        out = bags / name
        out.parent.mkdir(parents=True, exist_ok=True)
        call("simulate", "--config", simulation, "--cycles", 2, "--seed", seed, "--out", out)
    with BagWriter(bags / "line_b" / "other_topics") as bag:
        write_sample(bag, "/temperature", 10**18, 21.5)
    (bags / "line_b" / "notes.mcap").write_bytes(b"this is no bag" * 100)
    config = folder / "valves.yaml"
    config.write_text(CONFIG.format(model="press_cartridge"), encoding="utf-8")
    return SimpleNamespace(bags=bags, config=config, configs=tuple(load_config(config)))


@pytest.fixture
def good(archive, tmp_path):
    """Return a copy of the good bags alone."""
    for name in GOOD:
        shutil.copytree(archive.bags / name, tmp_path / "bags" / name)
    return tmp_path / "bags"


def call(*arguments):
    try:
        return main([str(a) for a in arguments])
    except SystemExit as end:
        return int(str(end.code))


def tasks_of(folder, configs):
    return [BatchTask(name, str(path), configs) for name, path in find_bags(folder)]


def in_this_process(tasks):
    return map(estimate_task, tasks)


def results_in(folder):
    """Return the content of every file of results."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_every_bag_of_the_archive_is_found(archive):
    names = [name for name, _ in find_bags(archive.bags)]
    assert names == [*GOOD[:2], GOOD[2], "line_b/notes.mcap", "line_b/other_topics"]
    assert [name for name, _ in find_bags(archive.bags / GOOD[0])] == ["monday"]


@pytest.mark.parametrize("what", ["no folder", "holds no bag"])
def test_an_archive_without_bags_is_one_line(what, tmp_path):
    (tmp_path / "empty").mkdir()
    place = tmp_path / ("none" if what == "no folder" else "empty")
    with pytest.raises(BagError, match=what):
        find_bags(place)


def test_the_verb_estimates_every_bag_and_names_the_bad_ones(archive, tmp_path, capsys):
    out = tmp_path / "out"
    command = ("batch", archive.bags, "--config", archive.config, "--out", out, "--jobs", 2)
    assert call(*command) == 1
    captured = capsys.readouterr()
    errors = [line for line in captured.err.splitlines() if line.startswith("valve-twin: /")]
    assert len(errors) == 2
    assert any("notes.mcap" in line for line in errors)
    assert any("none of the 2 valves" in line for line in errors)
    assert "5 bags: 3 done, 0 kept, 2 failed" in captured.out
    with (out / "summary.csv").open(encoding="utf-8") as file:
        rows = {row["bag"]: row for row in csv.DictReader(file)}
    assert set(rows) == {*GOOD, "line_b/notes.mcap", "line_b/other_topics"}
    assert {rows[name]["cycles"] for name in GOOD} == {"2"}
    for name in GOOD:
        config, bag = archive.config, archive.bags / name
        lines = tmp_path / "alone.jsonl"
        call("estimate", bag, "--config", config, "--valve", "press/valve_1", "--json", lines)
        assert (out / f"{name}.jsonl").read_bytes() == lines.read_bytes()
        assert json.loads(lines.read_text().splitlines()[0])["estimator"] == "equation_error_qp4"
    capsys.readouterr()
    before = results_in(out)
    assert call(*command) == 1
    assert "5 bags: 0 done, 3 kept, 2 failed" in capsys.readouterr().out
    assert results_in(out) == before


def test_no_name_of_a_bag_is_a_formula_in_the_summary(archive, tmp_path):
    bags = tmp_path / "bags"
    bags.mkdir()
    (bags / "=1+1.mcap").write_bytes(b"no bag")
    command = ("batch", bags, "--config", archive.config, "--out", tmp_path / "out")
    assert call(*command) == 1
    with (tmp_path / "out" / "summary.csv").open(encoding="utf-8") as file:
        assert [row["bag"] for row in csv.DictReader(file)] == ["'=1+1.mcap"]


def test_an_interrupted_batch_goes_on_where_it_stopped(good, archive, tmp_path):
    tasks = tasks_of(good, archive.configs)
    straight, broken = Results(tmp_path / "straight"), Results(tmp_path / "broken")
    list(run_batch(tasks, straight, in_this_process))
    first = next(run_batch(tasks, broken, in_this_process))
    (broken.folder / "line_a" / ".tuesday.jsonl.part").write_bytes(b"half a re")
    ran: list[str] = []

    def counting(left):
        ran.extend(task.name for task in left)
        return in_this_process(left)

    again = list(run_batch(tasks, broken, counting))
    assert [r.name for r in again if r.kept] == [first.name]
    assert ran == [task.name for task in tasks if task.name != first.name]
    (broken.folder / "line_a" / ".tuesday.jsonl.part").unlink(missing_ok=True)
    assert results_in(broken.folder) == results_in(straight.folder)


def test_what_a_result_was_made_from_decides_whether_it_is_kept(good, archive, tmp_path):
    tasks = tasks_of(good, archive.configs)
    results = Results(tmp_path / "out")
    list(run_batch(tasks, results, in_this_process))
    task = tasks[0]
    assert _digest_of_kept(results, task) == digest_of(task)
    (file,) = (good / GOOD[0]).glob("*.mcap")
    os.utime(file, ns=(1, 1))
    assert _digest_of_kept(results, task) == digest_of(task)
    other = BatchTask(task.name, task.bag, archive.configs[:1])
    assert results.finished(other) is None
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    assert results.finished(task) is None
    assert _digest_of_kept(results, tasks[1]) == digest_of(tasks[1])
    results.lines(tasks[1].name).write_text("cut", encoding="utf-8")
    assert results.finished(tasks[1]) is None


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "{}", "7", ""], ids=lambda t: t[:2])
def test_a_file_of_something_else_keeps_no_result(text, tmp_path, archive):
    task = BatchTask("a", tmp_path, archive.configs)
    results = Results(tmp_path)
    results.lines("a").write_text("", encoding="utf-8")
    results.mark("a").write_text(text, encoding="utf-8")
    assert results.finished(task) is None


def test_a_cut_bag_is_estimated_as_far_as_it_goes_and_its_loss_is_told(good, archive, tmp_path):
    (file,) = (good / GOOD[0]).glob("*.mcap")
    file.write_bytes(file.read_bytes()[: int(0.7 * file.stat().st_size)])
    results = Results(tmp_path / "out")
    found = {
        r.name: r for r in run_batch(tasks_of(good, archive.configs), results, in_this_process)
    }
    cut, whole = found[GOOD[0]], found[GOOD[1]]
    assert not cut.error
    assert any("lost" in note for note in cut.notes)
    assert 0 < cut.cycles <= whole.cycles
    assert not whole.notes


def _digest_of_kept(results, task):
    kept = results.finished(task)
    return kept.digest if kept is not None and kept.kept else ""


def test_a_bag_that_fails_keeps_no_earlier_result(good, archive, tmp_path):
    tasks = tasks_of(good, archive.configs)[:1]
    results = Results(tmp_path / "out")
    list(run_batch(tasks, results, in_this_process))
    (file,) = (good / GOOD[0]).glob("*.mcap")
    file.write_bytes(b"overwritten")
    (failed,) = run_batch(tasks, results, in_this_process)
    assert failed.error
    assert not results.lines(GOOD[0]).exists()
    assert results.finished(tasks[0]) is None


def test_a_bag_that_kills_its_process_is_named_and_the_others_are_done(
    good, archive, tmp_path, monkeypatch
):
    package = tmp_path / "package"
    (package / "killer-1.0.dist-info").mkdir(parents=True)
    meta = package / "killer-1.0.dist-info"
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: killer\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[valve_twin.valves]\nkiller = killer:MODEL\n")
    (package / "killer.py").write_text(KILLER)
    monkeypatch.syspath_prepend(str(package))
    config = tmp_path / "killer.yaml"
    config.write_text(CONFIG.format(model="killer"), encoding="utf-8")
    _short_cycle(BagWriter(good / "deadly"))
    tasks = tasks_of(good, tuple(load_config(config))[:1])
    runner = LocalRunner(2, estimate_task, lost_bag)
    found = {r.name: r for r in run_batch(tasks, Results(tmp_path / "out"), runner)}
    assert set(found) == {*GOOD, "deadly"}
    assert "its process was killed" in found["deadly"].error
    assert not any(found[name].error for name in GOOD)
    sys.modules.pop("killer", None)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_batch_and_the_same_command_goes_on(archive, tmp_path, number):
    """SIGINT comes to every process of the terminal; SIGTERM to the first alone."""
    bags, out = tmp_path / "bags", tmp_path / "out"
    for k in range(BAGS):
        shutil.copytree(archive.bags / GOOD[k % 3], bags / f"bag_{k:03d}")
    command = [sys.executable, "-m", "valve_twin.cli", "batch", bags, "--config", archive.config]
    command += ["--out", out, "--jobs", "1"]
    with (tmp_path / "log").open("w+") as log:
        # a shell starts what it puts into the background with SIGINT ignored, for children, too
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        process = subprocess.Popen(
            [str(c) for c in command], stderr=log, stdout=log, start_new_session=True
        )
        signal.signal(signal.SIGINT, before)
        end = time.monotonic() + 60.0
        while not (out / "bag_000.batch.json").exists() and time.monotonic() < end:
            assert process.poll() is None
            time.sleep(0.01)  # polls another process's folder; nothing depends on the length
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
        assert process.wait(20.0) == 1
        log.seek(0)
        text = log.read()
    assert "interrupted" in text
    assert "the same command goes on" in text
    done = len(list(out.glob("*.batch.json")))
    assert 1 <= done < BAGS
    with pytest.raises(ProcessLookupError):
        _until_gone(process.pid)
    tasks = tasks_of(bags, archive.configs)
    again = list(run_batch(tasks, Results(out), in_this_process))
    assert sum(result.kept for result in again) == done
    assert not any(result.error for result in again)


def _until_gone(group: int) -> None:
    """Raise ProcessLookupError once no process of the group is left."""
    end = time.monotonic() + 20.0
    while time.monotonic() < end:
        os.killpg(group, 0)
        time.sleep(0.05)  # polls the process table; nothing depends on the length


def _short_cycle(bag):
    """Record 200 samples of one short cycle."""
    with bag:
        for n in range(200):
            stamp = 10**18 + 30_000_000 * n
            write_sample(
                bag, "/sim/press/valve_1/command/v_in", stamp, 0.5 if 50 < n < 99 else 0.0
            )
            write_sample(bag, "/sim/press/valve_1/command/v_out", stamp, 0.0)
            write_sample(bag, "/sim/press/valve_1/spool_position", stamp, 0.1 + 1e-3 * n)


def test_a_dask_cluster_gives_the_same_bits(archive, tmp_path, capsys):
    distributed = pytest.importorskip("distributed")
    command = ("batch", archive.bags, "--config", archive.config)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        there, here = tmp_path / "there", tmp_path / "here"
        assert call(*command, "--out", there, "--scheduler", address) == 1
        assert "3 done, 0 kept, 2 failed" in capsys.readouterr().out
    assert call(*command, "--out", here, "--jobs", 1) == 1
    assert results_in(there) == results_in(here)


def test_a_scheduler_that_does_not_answer_is_one_line(good, archive, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from valve_twin.io.batch import runners as batch_runners

    monkeypatch.setattr(batch_runners, "CONNECT_S", 0.5)
    with pytest.raises(ValveTwinError, match=r"--scheduler tcp://127.0.0.1:9: does not answer"):
        batch_runners.ClusterRunner("tcp://127.0.0.1:9", estimate_task, lost_bag)


def test_without_dask_the_remedy_is_named(monkeypatch):
    from valve_twin.io.batch.runners import ClusterRunner

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValveTwinError, match=r"pip install 'valve_twin\[dask\]'"):
        ClusterRunner("tcp://127.0.0.1:8786", estimate_task, lost_bag)
