# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valve whose opening sets a speed: its law, and through simulation, estimation and report."""

import json

import numpy as np
import pytest

from valve_twin.cli import main
from valve_twin.core.valves.integrator import VALVE

GAINS = np.array([0.5, 0.4, 0.04, 0.5])


def moved(opening, start=0.5, period_s=0.1):
    x = np.array([start])
    VALVE.law.step(x, np.array([opening]), GAINS, period_s)
    return x[0]


def test_its_speed_is_that_of_the_law_each_way():
    assert moved(0.74) == pytest.approx(0.5 + 0.1 * 0.5 * 0.20)
    assert moved(0.26) == pytest.approx(0.5 - 0.1 * 0.4 * 0.20)


@pytest.mark.parametrize("opening", [0.461, 0.5, 0.539])
def test_inside_the_dead_band_it_rests(opening):
    assert moved(opening) == 0.5


def test_it_rests_at_its_stops():
    assert moved(1.0, 0.999, 1.0) == 1.0
    assert moved(0.0, 0.001, 1.0) == 0.0


@pytest.mark.no_cover
def test_its_aging_is_found_and_reported_from_a_simulated_bag(root, tmp_path, capsys):
    bag, page = tmp_path / "bag", tmp_path / "page.html"
    config = ["--config", str(root / "config" / "integrator.yaml")]
    assert main(["simulate", *config, "--cycles", "30", "--out", str(bag)]) == 0
    capsys.readouterr()
    assert main(["estimate", str(bag), *config]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    trends = {line["parameter"]: line for line in lines if "slope" in line}
    slope = trends["gain_rising"]
    assert slope["slope_lower_95"] < -0.004 * 0.5 < slope["slope_upper_95"]
    assert trends["gain_falling"]["status"] == trends["neutral"]["status"] == "STEADY"
    assert main(["report", str(bag), *config, "--out", str(page)]) == 0
    assert "gain_rising" in page.read_text(encoding="utf-8")
