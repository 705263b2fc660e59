# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The smallest valve: one file, through simulation, estimation, trend and report."""

import json
import re

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.valves.first_order import VALVE
from valve_twin.core.valves.registry import get_simulation
from valve_twin.demo.cases import case_names, find_case


def test_its_file_is_of_about_45_lines(root):
    text = (root / "valve_twin/core/valves/first_order.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 45


def test_its_step_is_the_closed_solution():
    x = np.array([0.2])
    VALVE.law.step(x, np.array([0.8]), np.array([0.5, 0.1]), 0.25)
    assert x[0] == pytest.approx(0.7 - 0.5 * np.exp(-0.5), rel=1e-12)
    VALVE.law.step(x, x + 0.1, np.array([0.5, 0.1]), 0.25)
    assert x[0] == pytest.approx(0.7 - 0.5 * np.exp(-0.5), rel=1e-12)


@pytest.mark.no_cover
def test_its_aging_is_found_and_reported_from_a_simulated_bag(root, tmp_path, capsys):
    bag, page = tmp_path / "bag", tmp_path / "page.html"
    config = ["--config", str(root / "config" / "first_order.yaml")]
    assert main(["simulate", *config, "--cycles", "40", "--out", str(bag)]) == 0
    capsys.readouterr()
    assert main(["estimate", str(bag), *config]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    trends = {line["parameter"]: line for line in lines if "slope" in line}
    assert trends["time_constant"]["drift_reference_lower_95"] > 0.0
    assert trends["dead_band"]["drift_reference_lower_95"] < 0.0
    assert main(["report", str(bag), *config, "--out", str(page)]) == 0
    assert re.search("time_constant", page.read_text(encoding="utf-8"))


def test_it_is_shown_by_the_demo_like_every_other():
    assert "first_order" in case_names()
    case = find_case("first_order")
    assert (case.aged, case.followed) == ("time_constant", "time_constant")
    assert case.cycle_s == get_simulation("first_order").program.duration_s
