# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The stepper valve's configuration, from simulation over the bag to estimates and trend."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config

CYCLES = 12


def test_a_simulated_screw_that_wears_is_followed_from_its_bag(root, tmp_path):
    config = str(root / "config" / "stepper_servo.yaml")
    bag, out = str(tmp_path / "bag"), tmp_path / "out.json"
    simulate = ["simulate", "--config", config, "--cycles", str(CYCLES), "--out", bag]
    assert main(simulate) == 0
    assert main(["estimate", bag, "--config", config, "--json", str(out)]) == 0
    lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    screws = [x for x in lines if x.get("estimator") == "backlash_output_error"]
    assert len(screws) == CYCLES
    last = dict(zip(screws[-1]["names"], screws[-1]["values"], strict=True))
    worn = 0.1 / 2.1 * (1.0 + 0.005 * CYCLES)  # `simulation.aging` of the file
    assert last["backlash"] == pytest.approx(worn, rel=0.02)
    assert screws[-1]["fit_test"] > 99.0


def test_the_twin_listens_where_the_simulated_valve_publishes(root):
    (config,) = load_config(root / "config" / "stepper_servo.yaml")
    for name in get_model("stepper_servo").inputs:
        assert config.signals[name].topic.endswith(f"/command/{name}")


def test_the_committed_sample_is_small_and_tells_the_screw(root, capsys):
    bag = root / "samples" / "stepper_servo"
    assert sum(path.stat().st_size for path in bag.iterdir()) < 300_000
    config = str(root / "config" / "stepper_servo.yaml")
    assert main(["estimate", str(bag), "--config", config]) == 0
    screw = json.loads(capsys.readouterr().out.splitlines()[0])
    found = dict(zip(screw["names"], screw["values"], strict=True))
    assert 2.1 * found["backlash"] == pytest.approx(0.1, rel=0.05)
    assert 2.1 * found["band_lower"] == pytest.approx(0.45, abs=0.01)
    assert 2.1 * found["band_upper"] == pytest.approx(1.70, abs=0.01)
