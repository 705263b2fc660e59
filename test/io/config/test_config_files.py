# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The configurations that are shipped explain every key and fit the measured data."""

import re

import numpy as np
import pytest

from test.bag_samples import read_texts
from valve_twin.core.types import CycleRule
from valve_twin.io.bags.read import bag_info, read_signals
from valve_twin.io.config.valve import load_config
from valve_twin.io.tables.csv_import import import_csv

NAMES = [
    "boiler_valve",
    "double_solenoid",
    "eha_cylinder",
    "first_order",
    "hybrid_actuator",
    "hydraulic_actuator",
    "hydraulic_rig",
    "pilot_valve",
    "pilot_valve_current",
    "press_archive",
    "press_cartridge",
    "press_fleet",
    "servo_system",
    "simulated_press",
    "stepper_servo",
]


@pytest.mark.parametrize("name", NAMES)
def test_every_key_is_explained(root, name):
    lines = (root / "config" / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    keys = [line for line in lines if re.match(r"^ {4,}\w[\w/]*:", line)]
    sections = {"signals:", "cycles:", "options:", "aging:", "csv:", "simulation:"}
    seen: set[str] = set()
    for line in keys:
        key = line.split(":")[0].strip()
        explained = "#" in line or line.strip() in sections or key in seen
        assert explained, line
        seen.add(key)


def samples(config, bag, name):
    blocks = [b for b in read_signals(bag, config.signals.values()) if b.signal == name]
    return np.concatenate([b.stamp_ns for b in blocks]), np.concatenate([b.values for b in blocks])


def test_the_boiler_valve_is_imported(root, shared, tmp_path):
    (config,) = load_config(root / "config" / "boiler_valve.yaml")
    import_csv([shared / "damadics_boiler_valve"], config, tmp_path / "bag")
    stamps, position = samples(config, tmp_path / "bag", "position")
    _, command = samples(config, tmp_path / "bag", "command")
    assert len(stamps) == 1800
    assert stamps[0] % (300 * 10**9) == 0
    assert (position.min(), position.max()) == (48.7 * 0.01, 77.1 * 0.01)
    assert (command.min(), command.max()) == (40.5 * 0.01, 77.1 * 0.01)
    assert config.cycles.rule is CycleRule.WINDOW


def test_the_cylinder_is_imported_in_batches(root, shared, tmp_path):
    (config,) = load_config(root / "config" / "eha_cylinder.yaml")
    summary = import_csv([shared / "eha_cylinder"], config, tmp_path / "bag")
    assert len(summary.files) == 20
    stamps, position = samples(config, tmp_path / "bag", "position")
    _, reference = samples(config, tmp_path / "bag", "reference")
    assert len(stamps) == 20 * 31_000
    assert bag_info(tmp_path / "bag").message_count == 2 * 6200 + 20
    assert reference.max() == 1.0
    assert np.abs(position).max() < 1.01
    level, low = config.cycles.reference_level, config.cycles.reference_level / 4
    rises = np.flatnonzero((reference[1:] >= level) & (reference[:-1] < level))
    assert len(rises) == 40
    assert low < level
    names = [text for _, text in read_texts(tmp_path / "bag", "/eha_cylinder/run")]
    assert (names[0], names[-1]) == ("exp_data_1_1", "exp_data_5_4")


def test_fifty_press_valves_stand_in_one_file(root):
    configs = load_config(root / "config" / "press_fleet.yaml")
    assert [c.name for c in configs] == [f"/press/valve_{n:02d}" for n in range(1, 51)]
    assert {c.name for c in configs if c.period_s != 0.03} == {"/press/valve_07"}
    assert len({c.history_url for c in configs}) == 1
    assert configs[49].signals["v_in"].topic == "/press/valve_50/command/v_in"
    assert configs[49].aging.thresholds[0].value == -15.0


def test_an_archive_is_estimated_by_constrained_least_squares_alone(root):
    (config,) = load_config(root / "config" / "press_archive.yaml")
    assert config.options.estimators == ("equation_error_qp8",)
    assert config.options.output_error is False
