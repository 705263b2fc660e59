# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""`valve-twin validate`: the table, its JSON form, its exit codes."""

import json

import pytest

from valve_twin.cli import main, validate
from valve_twin.validation import Check, Paper


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
