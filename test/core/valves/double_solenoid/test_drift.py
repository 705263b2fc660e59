# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A drift of 15 % of what ages is found inside the interval that the aging monitor publishes."""

from __future__ import annotations

import pytest

from test.core.valves.drift import study
from valve_twin.core.valves.double_solenoid.parameters import COILS, NAMES

SYSTEMATIC = {"friction": 0.1, "force_gain": 0.05}
"""What the ripple of the currents leaves, of a change [%]; no interval counts it."""


def of_one(name, drift, seeds):
    return study("double_solenoid", {name: drift}, NAMES, seeds)


def test_drifts_of_all_at_once_are_told_apart():
    signs = (1.0, -1.0, -1.0, 1.0, 1.0)
    drifts = {name: sign * 15.0 for name, sign in zip(NAMES, signs, strict=True)}
    for of in study("double_solenoid", drifts, NAMES, range(1)).values():
        assert of.found[0] == pytest.approx(of.truth, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", NAMES)
def test_intervals_hold_a_drift_in_twenty_seeds(name, sign):
    of = of_one(name, sign * 15.0, range(20))[name]
    left = SYSTEMATIC.get(name, 0.01)
    wide = sum(
        low - left <= of.truth <= high + left for low, high in zip(of.lower, of.upper, strict=True)
    )
    assert wide >= 17  # of a 95 % interval: fewer in 2 % of campaigns
    assert of.found.mean() == pytest.approx(of.truth, abs=0.2)
    if name in COILS:
        assert of.found == pytest.approx(of.truth, abs=1.0)
