# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin design geometry`."""

from __future__ import annotations

import errno
import json
import os

import pytest

from valve_twin.cli import main
from valve_twin.design.geometry import DoubleStroke, read_design, read_dxf


def test_it_prints_the_winding_and_writes_the_drawings(tmp_path, capsys):
    files = [str(tmp_path / f"d.{kind}") for kind in ("svg", "dxf", "yaml")]
    words = [w for f in files for w in (f"--{f.rsplit('.', 1)[1]}", f)]
    assert main(["design", "geometry", "--set", "turns=300", "--json", *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["layers"] == 12
    assert read_design(tmp_path / "d.yaml") == DoubleStroke(turns=300)
    assert "armature" in read_dxf(tmp_path / "d.dxf")
    assert (tmp_path / "d.svg").read_text(encoding="utf-8").startswith("<svg")


@pytest.mark.parametrize("kind", ["dxf", "yaml"])
def test_a_disk_that_fails_leaves_what_was_there(tmp_path, monkeypatch, kind):
    path = tmp_path / f"d.{kind}"
    path.write_text("before")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)
    assert main(["design", "geometry", f"--{kind}", str(path)]) == 1
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_the_table_names_resistance_and_mass(capsys):
    assert main(["design", "geometry"]) == 0
    shown = capsys.readouterr().out
    assert "resistance_20" in shown
    assert "1.9444" in shown


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "turns=500"], "winding height = 0.0118516: must be 0 to 0.0095 [m], off by"),
        (["--set", "turns=300", "--set", "turns=350"], "--set turns=350: turns is set twice"),
        (["--set", "wire=0.6e-3"], "the nearest are 0.00056 and 0.00063"),
        (
            ["--set", "wire=2e-3"],
            "wire = 0.002: must be 0.0001 to 0.0016 [m], the wires of EN IEC",
        ),
        (
            ["--set", "wire=9e-5"],
            "wire = 9e-05: must be 0.0001 to 0.0016 [m], the wires of EN IEC",
        ),
        (["--set", "wire=thin"], "wire: value 'thin' is no number"),
        (["--set", "turns"], "--set turns: write NAME=VALUE"),
        (["missing.yaml"], "missing.yaml: cannot be read"),
    ],
)
def test_bad_input_is_one_line(words, said, capsys):
    assert main(["design", "geometry", *words]) in {1, 2}
    shown = capsys.readouterr().err
    assert said in shown
    assert shown.count("\n") == 1


def test_a_missing_package_is_named_with_the_remedy(monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    assert main(["design", "geometry"]) == 2
    assert "pip install 'valve_twin[design]'" in capsys.readouterr().err
