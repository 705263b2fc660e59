# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A simulated valve of 10 kHz is recorded in batches, and its twin estimates it from them."""

import numpy as np
import pytest

from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant
from valve_twin.core.valves.hybrid_actuator.plant_kernel import FLUX_CLOSER, OPEN_CLOSER
from valve_twin.io.bags.read import read_signals
from valve_twin.io.config.valve import load_config
from valve_twin.io.errors import ConfigError
from valve_twin.io.offline.run import run_bag
from valve_twin.io.offline.simulated_bag import (
    SERIES_SAMPLES,
    START_NS,
    simulation_of,
    write_simulated_bag,
)


@pytest.fixture(scope="module")
def config(root):
    (loaded,) = load_config(root / "config" / "hybrid_actuator.yaml")
    return loaded


def samples(config, bag, name):
    blocks = [b for b in read_signals(bag, config.signals.values()) if b.signal == name]
    return np.concatenate([b.stamp_ns for b in blocks]), np.concatenate([b.values for b in blocks])


def test_batches_hold_what_the_valve_showed(config, tmp_path):
    messages = write_simulated_bag(config, tmp_path / "bag", cycles=1, seed=3)
    block = SimulatedValve(simulation_of(config), 3).advance(2000)
    assert messages == 6 * 2000 / SERIES_SAMPLES
    for name, values in (
        ("position", block.position),
        ("closer_current", block.inputs[:, 3]),
        ("reference", block.reference),
    ):
        stamps, found = samples(config, tmp_path / "bag", name)
        np.testing.assert_array_equal(stamps, block.stamp_ns + START_NS)
        np.testing.assert_array_equal(found, values)


def test_a_lost_sample_of_a_batch_has_no_value(config, tmp_path):
    fault = ["fault.kind=lost_samples", "fault.severity=0.01"]
    write_simulated_bag(config, tmp_path / "bag", cycles=1, seed=3, overrides=fault)
    stamps, found = samples(config, tmp_path / "bag", "position")
    assert len(stamps) == 2000
    assert 5 < np.count_nonzero(np.isnan(found)) < 40


def test_the_cycles_of_a_bag_of_batches_are_estimated(config, tmp_path):
    write_simulated_bag(config, tmp_path / "bag", cycles=3, seed=3)
    found = [e for e in run_bag(config, tmp_path / "bag").estimates if e.used_by_trend]
    assert [e.cycle for e in found] == [1, 2, 3]
    for estimate in found:
        assert estimate.value("resistance_opener") == pytest.approx(0.34, rel=0.01)
        assert estimate.fit_train > 99.5


def test_an_integration_that_fails_ends_the_bag_with_time_and_state(config, tmp_path, monkeypatch):
    initial = HybridActuatorPlant.initial_state

    def broken(plant):
        state = initial(plant)
        state[FLUX_CLOSER], state[OPEN_CLOSER] = np.nan, 0.0
        return state

    monkeypatch.setattr(HybridActuatorPlant, "initial_state", broken)
    with pytest.raises(
        ConfigError, match=r"valve_1: cycle 1: integration failed at 0\.0000\d+ s: x"
    ):
        write_simulated_bag(config, tmp_path / "bag", cycles=2, seed=3)
