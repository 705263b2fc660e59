# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design evaluate`."""

from __future__ import annotations

import json
from importlib import import_module

import pytest

from valve_twin.cli import main
from valve_twin.cli.design import evaluate
from valve_twin.design import chain
from valve_twin.design.map import MapGrid

pytestmark = pytest.mark.usefixtures("transients_once", "maps_once")


def test_it_prints_the_steps_and_draws_them(tmp_path, capsys, monkeypatch):
    quick = chain.Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)
    monkeypatch.setitem(chain.FIDELITIES, "usual", quick)
    monkeypatch.setattr(chain, "STEPS", (0.1, 1.0))
    svg = tmp_path / "s.svg"
    assert main(["design", "evaluate", "--robust", "--json", "--svg", str(svg)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [of["step"] for of in found["steps"]] == [0.1, 1.0]
    assert found["steps"][0]["settling_s"] < 0.01
    assert found["steps"][0]["error"] < 0.01  # friction does not hold it short of its place
    for of, worst in zip(found["steps"], found["worst"], strict=True):
        assert worst["loss"] > of["loss"]
    assert found["force_margin"] > 0.0
    assert svg.read_text(encoding="utf-8").startswith("<svg")


def test_a_power_that_no_step_gets_is_told(capsys, monkeypatch):
    monkeypatch.setattr(chain, "STEPS", (1.0,))
    words = ["--fidelity", "search", "--set", "turns=60", "--set", "wire=1.4e-3"]
    assert main(["design", "evaluate", *words]) == 0
    said = capsys.readouterr().err
    assert "valve.bias + valve.span = 3 A: the steps get no more" in said
    assert "16.1 A that valve.power = 15 W allows; raise valve.span" in said


@pytest.mark.parametrize(
    ("form", "said"),
    [
        ("second_order", "the next order is --dynamics eddies"),
        ("eddies", "the next order is --dynamics growing"),
    ],
)
def test_a_force_that_fits_poorly_says_what_the_form_lacks(form, said, capsys, monkeypatch):
    fits = {(0.0, 0.1): 74.9, (1.0, 0.0): 75.0}
    shown = {"without": 10.0, "refitted": 92.0, "error": 0.5}
    monkeypatch.setattr(evaluate, "_replayed", lambda *given: {"fit": fits[given[-1]], **shown})
    monkeypatch.setattr(chain, "STEPS", (0.1, 0.5))
    words = ["design", "evaluate", "--fidelity", "search", "--replay", "--shares", "0.1", "1:0"]
    assert main([*words, "--dynamics", form]) == 0
    said_now = capsys.readouterr().err.splitlines()
    assert any(line.startswith("step from 100 to 0 % in the moving") for line in said_now)
    (lacks,) = [line for line in said_now if "below 75 %" in line]
    assert lacks.startswith("step of 10 %: below 75 %: ")
    assert said in lacks
    assert main([*words, "--dynamics", form, "--json"]) == 0
    small, back = json.loads(capsys.readouterr().out)["replay"]
    assert (said in small["lacks"], back["lacks"]) == (True, "")
    assert (back["from"], back["step"], back["fitted_to"]) == (1.0, 0.0, False)


def test_a_step_that_was_fitted_to_is_told():
    assert evaluate._fitted_to((0.0, 1.0), "growing")
    assert not evaluate._fitted_to((0.0, 0.5), "growing")
    assert not evaluate._fitted_to((0.0, 1.0), "eddies")


def test_any_step_is_replayed_in_the_moving_field(capsys, monkeypatch):
    monkeypatch.setattr(import_module("valve_twin.design.dynamics.replay"), "FOLLOWED_S", 0.012)
    words = ["design", "evaluate", "--fidelity", "search", "--replay", "--shares", "0.4:-0.3"]
    assert main([*words, "--json"]) == 0
    (of,) = json.loads(capsys.readouterr().out)["replay"]
    assert of["fit"] > 60.0 > of["without"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "turns=500"], "winding height = 0.0118516: must be 0 to 0.0095"),
        (["--fidelity", "fine"], "fidelity 'fine': must be one of search, usual, twice"),
        (
            ["--dynamics", "third"],
            "dynamics 'third': must be one of second_order, eddies, growing",
        ),
        (["--shares", "1.3"], "--shares 1.3: write a step as 0.5 or FROM:TO, two numbers from"),
        (["--shares", "0.5:half"], "--shares 0.5:half: write a step as 0.5 or FROM:TO"),
        (["--shares", "0.5:0.5"], "--shares 0.5:0.5: write a step as 0.5 or FROM:TO"),
        (["--shares", "nan"], "--shares nan: write a step as 0.5 or FROM:TO"),
        (["--shares", "0.1"], "--shares: says which steps --replay follows"),
        (["--set", "valve.change=2"], "valve.change: value 2.0 is outside its limits"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["design", "evaluate", *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1


def test_a_section_is_no_double_stroke_solenoid(root, capsys):
    sample = str(root / "samples" / "design" / "pot_magnet.yaml")
    assert main(["design", "evaluate", sample]) == 2
    assert "kind must be double_stroke" in capsys.readouterr().err
