# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design field`."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main


def test_it_prints_flux_and_force_and_draws_the_field(tmp_path, capsys):
    svg = tmp_path / "f.svg"
    words = ["--current", "2", "0", "--fine", "0.5", "--svg", str(svg), "--json"]
    assert main(["design", "field", *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["force"] == pytest.approx(50.8, rel=0.02)
    assert found["flux_A"] == pytest.approx(99.9e-3, rel=0.01)
    assert svg.read_text(encoding="utf-8").startswith("<svg")


def test_a_negative_position_with_an_exponent_is_a_number(capsys):
    words = ["--current", "2", "-1e-3", "--position", "-5e-4", "--fine", "0.4", "--json"]
    assert main(["design", "field", *words]) == 0
    assert json.loads(capsys.readouterr().out)["force"] < 45.0  # 50.8 N in the middle


def test_the_table_of_a_section_names_its_coil(root, capsys):
    sample = str(root / "samples" / "design" / "pot_magnet.yaml")
    assert main(["design", "field", sample, "--fine", "0.4"]) == 0
    assert "inductance_AA" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--current", "1"], "must be one finite number for each coil, A, B"),
        (["--current", "2", "-1e9"], "current of B = -1e+09: must be from -428 to 428 [A]"),
        (["--position", "0.002"], "position = 0.002: must be from -0.001 to 0.001 [m]"),
        (["--fine", "20"], "fine = 20: must be from 0.2 to 6"),
        (["--set", "turns=500"], "winding height = 0.0118516: must be 0 to 0.0095"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["design", "field", *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize("verb", ["field", "transient", "map"])
def test_a_region_in_the_stretched_air_is_told_with_its_file(verb, root, tmp_path, capsys):
    sample = (root / "samples" / "design" / "pot_magnet.yaml").read_text(encoding="utf-8")
    path = tmp_path / "lid.yaml"
    lid = "  - {name: lid, material: steel, outline_mm: [[2, 8], [5, 8], [5, 9], [2, 9]]}\n"
    path.write_text(sample + lid, encoding="utf-8")
    out = [] if verb == "field" else ["--out", str(tmp_path / "out")]
    assert main(["design", verb, str(path), *out]) == 2
    shown = capsys.readouterr().err.splitlines()[-1]
    assert shown.startswith(f"valve-twin: {path}: lid: r = 0.002 to 0.005")
    assert "lies in the air that the motion stretches" in shown


def test_a_section_without_a_coil_takes_no_current(root, tmp_path, capsys):
    sample = (root / "samples" / "design" / "pot_magnet.yaml").read_text(encoding="utf-8")
    path = tmp_path / "bare.yaml"
    path.write_text(sample.replace("coil: A, turns: 120, ", ""), encoding="utf-8")
    assert main(["design", "field", str(path), "--current", "5"]) == 2
    assert "one finite number for each coil, of which there is none" in capsys.readouterr().err
