# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design evaluate`."""

from __future__ import annotations

import json

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
        ("eddies", "the next order, gains that grow with the current"),
    ],
)
def test_a_force_that_fits_poorly_says_what_the_form_lacks(form, said, capsys, monkeypatch):
    fits = {0.1: 74.9, 0.5: 75.0}
    shown = {"without": 10.0, "refitted": 92.0, "error": 0.5}
    monkeypatch.setattr(
        evaluate, "_replayed", lambda design, found, of, share: {"fit": fits[share], **shown}
    )
    monkeypatch.setattr(chain, "STEPS", (0.1, 0.5))
    words = ["design", "evaluate", "--fidelity", "search", "--replay", "--shares", "0.1", "0.5"]
    assert main([*words, "--dynamics", form]) == 0
    said_now = capsys.readouterr().err.splitlines()
    (lacks,) = [line for line in said_now if "below 75 %" in line]
    assert lacks.startswith("step of 10 %: below 75 %: ")
    assert said in lacks
    assert main([*words, "--dynamics", form, "--json"]) == 0
    small, half = json.loads(capsys.readouterr().out)["replay"]
    assert (said in small["lacks"], half["lacks"]) == (True, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "turns=500"], "winding height = 0.0118516: must be 0 to 0.0095"),
        (["--fidelity", "fine"], "fidelity 'fine': must be one of search, usual, twice"),
        (["--dynamics", "third"], "dynamics 'third': must be one of second_order, eddies"),
        (["--shares", "0.3"], "--shares 0.3: must be one of 0.1, 0.25, 0.5, 1"),
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
