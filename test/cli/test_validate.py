# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin validate`: the table, its JSON form, its exit codes."""

import json
import math

import pytest

from valve_twin.cli import main, validate
from valve_twin.validation import Check, Paper
from valve_twin.validation.registry import Benchmark, Outcome


@pytest.fixture
def checks(monkeypatch):
    """Return the comparisons that the command gets in place of the paper's."""
    made = [
        Check("Table 1", "theta_1", -0.16, -0.16, -0.17, -0.15, "exact"),
        Check("Table 4", "theta_2 [s]", "yes", float("nan"), note="the box does not reach it"),
    ]
    paper = Paper("002", "a valve", 1, lambda _: tuple(made))
    monkeypatch.setattr(validate, "get_paper", lambda _: paper)
    return made


def test_what_cannot_be_reproduced_is_shown_with_its_reason_and_does_not_fail(checks, capsys):
    assert main(["validate", "002"]) == 0
    shown = capsys.readouterr().out
    assert "the box does not reach it" in shown
    assert "theta_2 [s]" in shown
    assert "published: 1 agree, 0 do not; derived: 0 agree, 0 do not;" in shown
    assert "; 1 cannot be reproduced" in shown


def test_a_number_that_does_not_agree_ends_with_1(checks, capsys):
    checks.append(Check("Table 1", "theta_2", 1.0, 2.0, 0.9, 1.1, "10 %"))
    assert main(["validate", "002"]) == 1
    assert "FAIL" in capsys.readouterr().out


def test_json_has_one_object_a_comparison(checks, capsys):
    assert main(["validate", "002", "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["verdict"] for row in rows] == ["PASS", "CANNOT"]
    assert rows[0]["kind"] == "published"
    assert rows[0]["obtained"] == -0.16
    assert rows[1]["obtained"] is None
    assert rows[1]["lower"] is None


def test_an_unknown_paper_is_refused_in_one_line(capsys):
    assert main(["validate", "2"]) == 2
    assert capsys.readouterr().err.startswith("valve-twin: validate: there is no paper '2'; ")


@pytest.fixture
def benchmark(monkeypatch):
    row: dict[str, float | str] = {"scenario": "f1S", "r_td": 0.96, "named": "f1 [s]"}
    checks = (Check("counts", "detected", 31.0, 36.0, 34.0, math.inf, "at least 34"),)
    found = Benchmark("damadics", "a stub", 1, lambda _: Outcome({"Step I": (row,)}, checks))
    monkeypatch.setattr(validate, "get_benchmark", lambda _: found)


@pytest.mark.usefixtures("benchmark")
def test_a_benchmark_prints_its_rows_and_its_counts(capsys):
    assert main(["validate", "damadics"]) == 0
    out = capsys.readouterr().out
    assert "Step I" in out
    assert "f1 [s]" in out
    assert "published: 1 agree, 0 do not" in out


@pytest.mark.usefixtures("benchmark")
def test_a_benchmark_prints_a_json_object_a_row(capsys):
    assert main(["validate", "damadics", "--json"]) == 0
    row, check = map(json.loads, capsys.readouterr().out.splitlines())
    assert row == {"benchmark": "damadics", "table": "Step I", "scenario": "f1S", "r_td": 0.96,
                   "named": "f1 [s]"}  # fmt: skip
    assert check["verdict"] == "PASS"
