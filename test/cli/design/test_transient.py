# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design transient`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from valve_twin.cli import main

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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--swing", "2"], "swing = 2: must be at most the bias, 1 [A]"),
        (["--slope", "0"], "slope = 0.0: must be a number from 1e-07 to 10"),
        (["--position", "0.01"], "position = 0.01: must be from -0.001 to 0.001"),
        (["--skin", "0"], "skin = 0: must be above 2e-05 [m]"),
    ],
)
def test_bad_input_is_one_line(words, said, tmp_path, capsys):
    command = ["design", "transient", *SHORT, "--out", str(tmp_path / "t.csv"), *words]
    assert main(command) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
