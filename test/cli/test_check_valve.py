# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import json

import pytest

from valve_twin.cli import main


def test_a_line_a_check_and_an_exit_code(capsys):
    assert main(["check-valve", "first_order", "--seeds", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 12
    assert all(line.startswith("pass") for line in lines)


def test_one_object_a_check(capsys):
    main(["check-valve", "cycle_timing", "--seeds", "1", "--json"])
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {f["check"]: f["passed"] for f in found}["recovery"] is None


def test_strangers_of_a_valve_without_a_simulation_are_wrong_usage_and_there_may_be_none(capsys):
    assert main(["check-valve", "cycle_timing", "--strangers"]) == 2
    assert "check-valve: model 'cycle_timing' cannot be simulated" in capsys.readouterr().err
    assert main(["check-valve", "damadics", "--strangers", "--seeds", "1"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_an_unknown_valve_is_wrong_usage(capsys):
    assert main(["check-valve", "first_ordr"]) == 2
    assert "did you mean 'first_order'?" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["check-valve", "first_order", "--seeds", "0"])
