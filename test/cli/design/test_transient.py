# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design transient`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.physics.coenergy import CoenergyMap, spline_coefficients
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import write_map

SHORT = [
    "--slope",
    "1e-3",
    "--hold",
    "1e-3",
    "--rest",
    "1e-3",
    "--step",
    "2.5e-4",
    "--fine",
    "0.3",
]


def test_it_writes_the_record_and_the_picture(tmp_path, capsys):
    out, svg = tmp_path / "t.csv", tmp_path / "t.svg"
    words = [*SHORT, "--out", str(out), "--svg", str(svg)]
    assert main(["design", "transient", *words]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["heat"] > 1e-3
    assert abs(said["lacks_of_energy"]) < 0.05
    record = np.genfromtxt(out, delimiter=",", names=True)
    assert len(record) == said["times"] == 29
    assert record["force_N"].max() == pytest.approx(said["largest_force"])
    assert record["current_B_A"].tolist() == [1.0] * 29
    assert "dashed: static" in svg.read_text(encoding="utf-8")


def test_with_a_map_it_fits_the_dynamics(tmp_path, capsys):
    i, x = np.linspace(0.0, 3.0, 4), np.linspace(-1e-3, 1e-3, 4)
    a, b, at = np.meshgrid(i, i, 1.0 + x / 2e-3, indexing="ij")
    values = np.zeros((8, 8, 8))  # iron that does not saturate: the record is what matters here
    values[0::2, 0::2, 0::2] = 0.03 * (a**2 * at + b**2 * (2.0 - at))
    values[1::2, 0::2, 0::2], values[0::2, 1::2, 0::2] = 0.06 * a * at, 0.06 * b * (2.0 - at)
    values[0::2, 0::2, 1::2] = 15.0 * (a**2 - b**2)
    values[1::2, 0::2, 1::2], values[0::2, 1::2, 1::2] = 30.0 * a, -30.0 * b
    of = {"section": repr(DoubleStroke().section())}
    made = CoenergyMap(("A", "B"), i, x, spline_coefficients(values, (i, i, x)), of)
    write_map(made, tmp_path / "m.npz")
    words = ["--out", str(tmp_path / "t.csv"), "--map", str(tmp_path / "m.npz")]
    assert main(["design", "transient", *SHORT, *words]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["G_A"]["fit"] > said["G_A"]["without"]
    assert said["G_F"]["fit"] > said["G_F"]["without"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--swing", "2"], "swing = 2: must be at most the bias, 1 [A]"),
        (["--slope", "0"], "slope = 0.0: must be a number from 1e-07 to 10"),
        (["--position", "0.01"], "position = 0.01: must be from -0.001 to 0.001"),
        (["--map", "none.npz"], "none.npz: is no map of valve-twin design map"),
        (["--skin", "0"], "skin = 0: must be above 2e-05 [m]"),
    ],
)
def test_bad_input_is_one_line(words, said, tmp_path, capsys):
    command = ["design", "transient", *SHORT, "--out", str(tmp_path / "t.csv"), *words]
    assert main(command) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
