# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design optimise` on an analytic stand-in for the field computation."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main
from valve_twin.cli.design import optimise
from valve_twin.design.geometry import DoubleStroke, read_design
from valve_twin.design.search.tasks import Outcome
from valve_twin.io.bags.file import hold

QUICK = ["--population", "6", "--generations", "3", "--vary", "gap_ratio=0.17:0.21"]
QUICK += ["--vary", "valve.preload=5:30"]


def bowl(arguments, work, lost, *, keep):
    """Return what runs tasks: the gap decides, wide ones fail."""
    del arguments, work, lost, keep

    def run(tasks):
        for task in tasks:
            known, gap = (task.key, task.fidelity, task.values), task.values["gap_ratio"]
            if gap > 0.2:
                yield Outcome(*known, error="it is too wide")
                continue
            figures = {"rise_s": 0.016 * gap, "settling_s": 0.032 * gap,
                       "graded_s": 0.032 * gap, "overshoot": 0.01, "error": 0.001,
                       "loss": 1.0 + 1e-3 * task.values["valve.preload"],
                       "heating": 10.0, "margin": 50.0}  # fmt: skip
            yield Outcome(*known, figures)

    return run


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(optimise, "runner_of", bowl)


def test_it_searches_and_writes_the_chosen_design(tmp_path, capsys):
    archive, chosen = str(tmp_path / "a.jsonl"), tmp_path / "chosen.yaml"
    words = ["design", "optimise", "--archive", archive, *QUICK, "--json"]
    assert main([*words, "--yaml", str(chosen)]) == 0
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    best = found["front"][0]["figures"]
    assert best["rise_s"] < found["reference"]["rise_s"]
    better = read_design(chosen)
    assert isinstance(better, DoubleStroke)
    assert better.gap_ratio == pytest.approx(found["chosen"]["gap_ratio"])
    assert "generation 3 of 3" in shown.err
    before = (tmp_path / "a.jsonl").read_bytes()
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out) == found
    assert (tmp_path / "a.jsonl").read_bytes() == before


def test_the_table_names_reference_front_and_choice(tmp_path, capsys):
    assert main(["design", "optimise", "--archive", str(tmp_path / "a"), *QUICK]) == 0
    shown = capsys.readouterr()
    assert "reference" in shown.out
    assert " *" in shown.out
    assert "gap_ratio:" in shown.err
    assert "the search ended by its generations: 3 of 3 generations, " in shown.err


def test_a_search_that_its_time_ends_says_so_and_goes_on(tmp_path, capsys):
    words = ["design", "optimise", "--archive", str(tmp_path / "a"), *QUICK]
    assert main([*words, "--seconds", "1e-9"]) == 0
    shown = capsys.readouterr().err
    assert "the search ended by its time, 1e-09 s: 1 of 3 generations, " in shown
    assert main(words) == 0
    assert "the search ended by its generations: 3 of 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--vary", "gap_ratio=0.3:0.2"], "gap_ratio: bounds 0.3 to 0.2: the lower must be"),
        (["--vary", "gap=0.1:0.2"], "'gap' is no number of the design"),
        (["--vary", "gap_ratio=0.2"], "--vary gap_ratio=0.2: write NAME=LOW:HIGH"),
        (["--population", "1"], "Settings.population = 1: must be a number from 2"),
        (["--fidelity", "fine"], "fidelity 'fine': must be one of search, usual, twice"),
        ([*QUICK, "--most-overshoot", "0.005"], "keeps all limits; the nearest"),
        (["--most-overshoot", "2"], "Limits.overshoot = 2.0: must be a number from 0 to 1"),
    ],
)
def test_bad_input_is_one_line(words, said, tmp_path, capsys):
    assert main(["design", "optimise", "--archive", str(tmp_path / "a"), *words]) == 2
    last = capsys.readouterr().err.splitlines()
    last = [line for line in last if not line.startswith("generation")]
    assert len(last) == 1
    assert said in last[0]


def test_the_archive_of_another_design_is_refused(tmp_path, capsys):
    words = ["design", "optimise", "--archive", str(tmp_path / "a"), *QUICK]
    assert main(words) == 0
    capsys.readouterr()
    assert main([*words, "--set", "flange_ratio=0.6"]) == 2
    assert "is the archive of another problem: flange_ratio is" in capsys.readouterr().err


def test_an_interruption_says_what_is_kept(tmp_path, capsys, monkeypatch):
    def stops(arguments, work, lost, *, keep):
        run = bowl(arguments, work, lost, keep=keep)

        def some(tasks):
            yield next(iter(run(tasks)))
            raise KeyboardInterrupt

        return some

    monkeypatch.setattr(optimise, "runner_of", stops)
    assert main(["design", "optimise", "--archive", str(tmp_path / "a"), *QUICK]) == 1
    assert "interrupted: 1 designs are kept" in capsys.readouterr().err


def test_an_archive_that_another_run_works_on_is_refused(tmp_path, capsys):
    path = tmp_path / "a"
    with hold(path):
        assert main(["design", "optimise", "--archive", str(path), *QUICK]) == 2
        assert main(["design", "sensitivity", "--archive", str(path)]) == 2
    for line in capsys.readouterr().err.splitlines():
        assert "a: another run works on this archive" in line
    assert path.read_bytes() == b""
