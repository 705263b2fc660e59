# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin budget` and the budget in `valve-twin report`."""

import json

import pytest

from valve_twin.cli import main


@pytest.fixture(scope="module")
def config(root):
    return str(root / "config" / "simulated_press.yaml")


def test_json_has_every_parameter_with_every_source(config, capsys):
    assert main(["budget", "--config", config, "--json", "--realisations", "2"]) == 0
    budget = json.loads(capsys.readouterr().out)
    assert budget["valve"] == "/press/valve_1"
    letters = [source["row"] for source in budget["sources"]]
    assert letters == list("abcdefghijk")
    for parameter in budget["parameters"]:
        assert sorted(parameter["errors"]) == letters
        assert parameter["total"] == pytest.approx(sum(parameter["errors"].values()))
    names = [p["parameter"] for p in budget["parameters"]]
    assert names[0] == "K_in"
    assert names[-1] == "theta_5"


def test_the_table_follows_the_settings_that_are_given(config, capsys):
    arguments = ["budget", "--config", config, "--realisations", "2"]
    assert main([*arguments, "--set", "measurement.noise=1e-5", "--offset", "2e-3"]) == 0
    shown = capsys.readouterr().out
    lines = {line.split(")")[0][-1]: line for line in shown.splitlines() if "│(" in line}
    assert "2.0e-03" in lines["a"]
    assert "1.0e-05" in lines["f"]
    assert shown.count("*") >= len(lines) - 4


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--offset", "0"], "offset = 0.0: must be above 0 and at most 0.5 [1]"),
        (["--realisations", "1"], "realisations = 1: must be 2 or more"),
        (["--set", "plant.mas=3"], "did you mean 'plant.mass'"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(config, capsys, arguments, part):
    assert main(["budget", "--config", config, *arguments]) == 2
    said = capsys.readouterr().err
    assert part in said
    assert said.count("\n") == 1


def test_a_valve_that_never_moves_has_no_budget(config, capsys):
    still = "program.targets=[0, 0, 0, 0, 0]"
    assert main(["budget", "--config", config, "--realisations", "2", "--set", still]) == 1
    assert "no estimate of the simulated cycle" in capsys.readouterr().err


def test_the_report_shows_it_when_asked(config, tmp_path):
    bag, page = str(tmp_path / "bag"), tmp_path / "page.html"
    assert main(["simulate", "--config", config, "--cycles", "3", "--out", bag]) == 0
    assert main(["report", bag, "--config", config, "--out", str(page), "--budget"]) == 0
    assert 'class="wide budget"' in page.read_text(encoding="utf-8")
