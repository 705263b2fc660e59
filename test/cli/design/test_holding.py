# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design holding`."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main


def test_it_prints_forces_and_what_a_dimension_does(root, tmp_path, capsys):
    svg = tmp_path / "h.svg"
    sample = str(root / "samples" / "design" / "hybrid_pole.yaml")
    words = [sample, "--fine", "0.3", "--of", "magnet_thickness", "--of", "magnet_height"]
    assert main(["design", "holding", *words, "--svg", str(svg), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ampere_turns"] == [0.0, 500.0, 1000.0, 1500.0]
    near, far = (found["force"][gap] for gap in ("0.0005", "0.004"))
    assert all(a > b > 0.0 for a, b in zip(near, far, strict=True))
    thickness, height = found["effects"]
    assert thickness["force"][0][0] < near[0] < thickness["force"][1][0]
    assert height["force"][1] == [None] * 4
    assert "magnet_height = 0.055" in height["error"]
    assert svg.read_text(encoding="utf-8").startswith("<svg")


def test_the_tables_stand_beside_the_paper(capsys):
    words = ["--fine", "0.3", "--of", "gap_3", "--of", "shoe"]
    assert main(["design", "holding", *words]) == 0
    out = capsys.readouterr().out
    assert "(423.5)" in out
    assert "-12.6 %" in out
    assert "not printed" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--of", "gap_5"], "'gap_5' is no number of the pole"),
        (["--of", "gap"], "'gap' is no number of the pole"),
        (["--set", "gap=0.001"], "--set gap: this step takes gaps from 0.5 to 4 mm"),
        (["--set", "shoe=-1"], "shoe"),
        (["--set", "base_width=0.0065", "--set", "cover_width=0.0006"], "base_width = 0.0065"),
        (["--set", "cover_width=0.03"], "cover_width = 0.03: must be from 0 to 0.0212 [m]"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["design", "holding", "--fine", "0.3", *words]) == 2
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert said in told[0]


def test_another_solenoid_is_refused(root, capsys):
    sample = str(root / "samples" / "design" / "pot_magnet.yaml")
    assert main(["design", "holding", sample]) == 2
    assert "kind must be hybrid_pole" in capsys.readouterr().err


def test_geometry_and_field_take_the_pole_as_well(root, tmp_path, capsys):
    sample, svg = str(root / "samples" / "design" / "hybrid_pole.yaml"), tmp_path / "s.svg"
    assert main(["design", "geometry", sample, "--svg", str(svg)]) == 0
    assert "magnet" in svg.read_text(encoding="utf-8")
    words = ["--set", "gap=0.001", "--fine", "0.3", "--current", "1000", "--json"]
    assert main(["design", "field", sample, *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["force"] == pytest.approx(-155.0, rel=0.05)
