# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The parameter file of a designed valve: what is kept, what is replaced, what is refused."""

from __future__ import annotations

import pytest

from test.core.valves.test_designed import FOUND
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.io.config.exported import exported_yaml
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ConfigError
from valve_twin.io.offline.simulated_bag import simulation_of

NUMBERS = MODEL.of_design(FOUND)


def exported(root, tmp_path):
    like = root / "config" / "double_solenoid.yaml"
    path = tmp_path / "designed.yaml"
    path.write_text(
        exported_yaml(like, MODEL.name, NUMBERS.shared, NUMBERS.own, "a design"), encoding="utf-8"
    )
    return load_config(like)[0], load_config(path)[0]


def test_twin_and_simulated_valve_have_the_numbers_and_the_rest_is_kept(root, tmp_path):
    like, found = exported(root, tmp_path)
    for name, value in NUMBERS.shared.items():
        assert getattr(found.options, name) == value
    plant = simulation_of(found).plant
    assert isinstance(plant, DoubleSolenoidPlant)
    assert plant.map_coenergy == NUMBERS.shared["map_coenergy"]
    assert plant.control == "trajectory_set"
    assert plant.largest_current == FOUND.largest_current
    assert (found.signals, found.cycles, found.aging) == (like.signals, like.cycles, like.aging)
    assert found.simulation["scatter.friction"] == like.simulation["scatter.friction"]


def test_a_file_of_another_valve_is_refused(root):
    with pytest.raises(ConfigError, match="is of model 'servo_system'; give one of"):
        exported_yaml(root / "config" / "servo_system.yaml", MODEL.name, {}, {}, "")
    with pytest.raises(ConfigError, match="is no parameter file"):
        exported_yaml(root / "README.md", MODEL.name, {}, {}, "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is no parameter file with a section '/\\*\\*' and a model$"),
        (
            "'/**': {ros__parameters: {model: MODEL, options: [1]}}",
            r"options = \[1\]: must be a sec",
        ),
        (
            "'/**': {ros__parameters: {model: MODEL, simulation: {plant: 3}}}",
            "plant = 3: must be a",
        ),
    ],
)
def test_sections_that_are_none_are_refused(text, said, tmp_path):
    path = tmp_path / "like.yaml"
    path.write_text(text.replace("MODEL", MODEL.name), encoding="utf-8")
    with pytest.raises(ConfigError, match=said):
        exported_yaml(path, MODEL.name, {}, {}, "")


def test_empty_sections_are_filled(tmp_path):
    path = tmp_path / "like.yaml"
    text = f"'/**':\n  ros__parameters:\n    model: {MODEL.name}\n    options:\n    simulation:\n"
    path.write_text(text, encoding="utf-8")
    found = exported_yaml(path, MODEL.name, {"mass": 0.1}, {}, "a design")
    assert found.count("mass: 0.1") == 2
