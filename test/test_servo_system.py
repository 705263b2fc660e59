# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The servosystem from its configuration to estimates, by the same commands as every valve."""

from __future__ import annotations

import json

import pytest

from valve_twin.cli.main import main
from valve_twin.core.valves.registry import get_model
from valve_twin.io.config.valve import load_config


def test_every_signal_of_the_model_is_mapped(root):
    (config,) = load_config(root / "config" / "servo_system.yaml")
    model = get_model("servo_system")
    assert set(config.signals) == {*model.inputs, model.output, "reference"}


def test_the_committed_sample_is_small_and_tells_orifices_and_fluid(root, capsys):
    bag = root / "samples" / "servo_system"
    assert sum(path.stat().st_size for path in bag.iterdir()) < 300_000
    config = str(root / "config" / "servo_system.yaml")
    assert main(["estimate", str(bag), "--config", config]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    estimates = [x for x in lines if x["kind"] == "estimate" and x["used_by_trend"]]
    assert [e["cycle"] for e in estimates] == [1, 2]
    for estimate in estimates:
        found = dict(zip(estimate["names"], estimate["values"], strict=True))
        assert found["bulk_modulus"] == pytest.approx(1e9, rel=0.01)
        assert found["structural_stiffness"] == pytest.approx(1.5e6, rel=0.01)
    rise = estimates[1]["values"][0] / estimates[0]["values"][0] - 1.0
    assert rise == pytest.approx(0.005, abs=0.002)  # what the orifices erode a cycle
