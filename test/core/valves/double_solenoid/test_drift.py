# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A drift of 15 % of what ages is found inside the interval that the aging monitor publishes."""

from __future__ import annotations

import pytest

from test.core.valves.drift import study
from valve_twin.core.valves.double_solenoid.parameters import COILS, NAMES

SCATTER = {f"scatter.{name}": 0.003 for name in NAMES}
"""What a plant parameter differs by from cycle to cycle: without it the intervals are so narrow
(0.01 %) that what the ripple of the currents leaves (up to 0.05 % of a change) lies outside."""

PATTERN = (1.0, -1.0, -1.0, 1.0, 1.0)


def all_at_once(sign, seeds):
    """Let all five drift together, in directions that do not hide behind each other."""
    drifts = {name: sign * s * 15.0 for name, s in zip(NAMES, PATTERN, strict=True)}
    return study("double_solenoid", drifts, NAMES, seeds, given=SCATTER)


@pytest.mark.no_cover
def test_drifts_of_all_at_once_are_told_apart():
    for of in all_at_once(1.0, range(1)).values():
        assert of.found[0] == pytest.approx(of.truth, abs=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_intervals_hold_drifts_in_twenty_seeds(sign):
    for name, of in all_at_once(sign, range(20)).items():
        assert of.inside >= 17, of.line  # of a 95 % interval: fewer in 2 % of campaigns
        assert of.found.mean() == pytest.approx(of.truth, abs=0.2)
        if name in COILS:
            assert of.found == pytest.approx(of.truth, abs=1.0)
