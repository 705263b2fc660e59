# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The double-solenoid valve's configuration, from simulation over the bag to estimates."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli import main
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config

TRUTH = {"resistance_a": 2.6, "resistance_b": 2.6, "force_gain": 1.0, "preload_1": 20.0}


def test_a_simulated_valve_that_silts_up_is_followed_from_its_bag(root, tmp_path):
    config = str(root / "config" / "double_solenoid.yaml")
    bag, out, page = str(tmp_path / "bag"), tmp_path / "out.json", tmp_path / "page.html"
    assert main(["simulate", "--config", config, "--cycles", "12", "--out", bag]) == 0
    assert main(["estimate", bag, "--config", config, "--json", str(out)]) == 0
    lines = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    estimates = [x for x in lines if x["kind"] == "estimate" and x["used_by_trend"]]
    assert len(estimates) == 12
    last = dict(zip(estimates[-1]["names"], estimates[-1]["values"], strict=True))
    assert last["friction"] == pytest.approx(6.0 * (1.0 + 0.005 * 12), rel=0.01)
    for name, truth in TRUTH.items():
        assert last[name] == pytest.approx(truth, rel=0.01)
    assert main(["report", bag, "--config", config, "--out", str(page)]) == 0
    assert "friction" in page.read_text(encoding="utf-8")


def test_the_twin_listens_where_the_simulated_valve_publishes(root):
    (config,) = load_config(root / "config" / "double_solenoid.yaml")
    assert set(get_model("double_solenoid").inputs) <= set(config.signals)


def test_the_committed_sample_is_small_and_tells_the_valve(root, capsys):
    bag = root / "samples" / "double_solenoid"
    assert sum(path.stat().st_size for path in bag.iterdir()) < 300_000
    config = str(root / "config" / "double_solenoid.yaml")
    assert main(["estimate", str(bag), "--config", config]) == 0
    first = json.loads(capsys.readouterr().out.splitlines()[0])
    found = dict(zip(first["names"], first["values"], strict=True))
    for name, truth in TRUTH.items():
        assert found[name] == pytest.approx(truth, rel=0.01)
