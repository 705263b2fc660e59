# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design map`."""

from __future__ import annotations

import json

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.design.map import read_map

SMALL = ["--currents", "4", "--positions", "4", "--fine", "0.3"]


def test_it_writes_a_map_that_can_be_read_and_its_picture(tmp_path, capsys):
    out, svg = tmp_path / "m.npz", tmp_path / "m.svg"
    assert main(["design", "map", *SMALL, "--out", str(out), "--svg", str(svg)]) == 0
    said = json.loads(capsys.readouterr().out)
    found = read_map(out)
    assert said["sha256"] == found.provenance["sha256"]
    assert found.force(np.array([[2.0, 0.0]]), np.zeros(1))[0] == pytest.approx(50.8, rel=0.1)
    assert svg.read_text(encoding="utf-8").startswith("<svg")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--currents", "2"], "currents = 2: must be a number from 4 to 60"),
        (["--largest-current", "-1"], "largest_current = -1.0: must be a number from 0.001"),
        (["--set", "gap_ratio=0.01"], "gap_ratio: value 0.01 is outside its limits"),
    ],
)
def test_bad_input_is_one_line(words, said, tmp_path, capsys):
    assert main(["design", "map", *SMALL, "--out", str(tmp_path / "m.npz"), *words]) == 2
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1
