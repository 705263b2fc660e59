# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design dynamics`."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from test.design.dynamics.made import CURVES, GAINS, answer
from valve_twin.cli import main
from valve_twin.design.dynamics import eddies, switched
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import write_map


def test_it_fits_draws_and_says_how_steep_the_flanks_may_be(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(switched, "run_transient", answer)
    monkeypatch.setattr(eddies, "run_transient", answer)
    of = {"section": repr(DoubleStroke().section())}
    write_map(replace(CURVES, provenance=of), tmp_path / "m.npz")
    words = ["--map", str(tmp_path / "m.npz"), "--svg", str(tmp_path / "d.svg")]
    assert main(["design", "dynamics", *words]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["reached"]
    assert said["slope"] > 1e-3
    assert said["flux_error"] <= said["flux_error_allowed"]
    assert said["G_A"]["fast_gain"] > 1.0 > said["G_F"]["fast_gain"]
    assert said["eddies"]["gains"] == pytest.approx(GAINS, rel=0.05)
    assert "dashed: i_s" in (tmp_path / "d.svg").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--slope", "-1"], "Trapezoid.slope = -1.0: must be a number from 1e-07 to 10 [s/A]"),
        (["--fidelity", "fine"], "fidelity 'fine': must be one of search"),
        (["--map", "none.npz"], "none.npz: is no map of valve-twin design map"),
        (["--set", "turns=500"], "winding height = 0.0118516: must be 0 to 0.0095"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["design", "dynamics", *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
