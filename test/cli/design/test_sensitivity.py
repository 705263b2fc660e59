# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design sensitivity` on an analytic stand-in for the field computation."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main
from valve_twin.cli.design import sensitivity
from valve_twin.design.search.tasks import Outcome


def plane(arguments, work, lost, *, keep):
    """Return what runs tasks: rise follows gap and radius, nothing else does anything."""
    del arguments, work, lost, keep

    def run(tasks):
        for task in tasks:
            design = task.design
            if design.turns > 380:
                yield Outcome(task.key, task.fidelity, task.values, error="no room for the turns")
                continue
            poles = {f"{of}_{kind}_{k}_hz": 10.0 for of in ("current", "force")
                     for kind in ("pole", "zero") for k in (1, 2)}  # fmt: skip
            figures = {"rise_s": 16e-3 * design.gap_ratio, "settling_s": design.armature_radius,
                       "overshoot": 0.01, "loss": 1.0, "margin": 50.0, **poles}  # fmt: skip
            curves = {"force": (1.0, design.gap_ratio), "flux": (1.0,)}
            yield Outcome(task.key, task.fidelity, task.values, figures, curves)

    return run


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(sensitivity, "runner_of", plane)


def test_it_prints_tables_and_draws_them(tmp_path, capsys):
    svg = tmp_path / "s.svg"
    assert main(["design", "sensitivity", "--svg", str(svg)]) == 0
    shown = capsys.readouterr()
    row = next(line for line in shown.out.splitlines() if "gap_ratio" in line)
    assert "-5.0/+5.0" in row
    assert "turns: no room for the turns" in shown.err
    assert svg.read_text(encoding="utf-8").startswith("<svg")


def test_json_holds_effects_and_indices_of_the_strongest(capsys, tmp_path):
    archive = str(tmp_path / "a.jsonl")
    words = ["design", "sensitivity", "--sobol", "30", "--json", "--archive", archive]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert {of["name"] for of in found["effects"]} >= {"gap_ratio", "armature_radius", "turns"}
    rise = next(of for of in found["sobol"] if of["figure"] == "rise_s")
    assert len(rise["first"]) == 6
    assert rise["first"]["gap_ratio"][0] == pytest.approx(1.0, abs=0.03)
    loss = next(of for of in found["sobol"] if of["figure"] == "loss")
    assert loss["refused"] == "it is the same in all designs"
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out) == found


def test_chosen_numbers_and_their_share(capsys):
    words = ["--of", "gap_ratio", "--of", "valve.preload", "--share", "0.1", "--sobol", "12"]
    assert main(["design", "sensitivity", *words]) == 0
    shown = capsys.readouterr()
    row = next(line for line in shown.out.splitlines() if "gap_ratio" in line)
    assert "-10.0/+10.0" in row
    assert "no indices: it is the same in all designs" in shown.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--of", "diameter"], "'diameter' is no number of the design"),
        (["--fidelity", "fine"], "fidelity 'fine': must be one of search, usual, twice"),
        (["--of", "gap_ratio", "--sobol", "20"], "1 numbers, 20 designs: indices take 2 numbers"),
        (["--sobol", "13"], "6 numbers, 13 designs: indices take 2 numbers or more and 14"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_computed(words, said, capsys, monkeypatch):
    monkeypatch.setattr(sensitivity, "runner_of", lambda *_, **__: pytest.fail)
    assert main(["design", "sensitivity", *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
