# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recorded sample bags: small, readable, and the twin finds in them what was put in."""

import pytest

from valve_twin.io.config.valve import load_config
from valve_twin.io.offline.run import run_bag


def test_the_sample_of_the_hybrid_actuator(root):
    bag = root / "samples" / "hybrid_actuator"
    assert sum(p.stat().st_size for p in bag.iterdir()) < 300_000
    (config,) = load_config(root / "config" / "hybrid_actuator.yaml")
    estimates = [e for e in run_bag(config, bag).estimates if e.used_by_trend]
    assert [e.cycle for e in estimates] == [1, 2, 3, 4, 5, 6]
    for estimate in estimates:
        assert estimate.reason == "accepted"
        assert estimate.value("resistance_closer") == pytest.approx(0.37, rel=0.01)
        assert estimate.value("spring_rate") == pytest.approx(18820.0, rel=0.03)
    assert all(e.fit_test > 99.5 for e in estimates[2:])
