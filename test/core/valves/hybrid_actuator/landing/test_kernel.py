# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Profile, currents and the observer of the soft landing."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.valves.hybrid_actuator.landing.kernel import (
    current_for,
    profile,
    weakest_current,
)
from valve_twin.core.valves.hybrid_actuator.landing.numbers import LandingNumbers
from valve_twin.core.valves.hybrid_actuator.magnetics import force
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant

PLANT = HybridActuatorPlant()
GAINS, ARMATURE, SOLENOID = LandingNumbers().gains(24.0), PLANT.armature(), PLANT.magnetics()


@pytest.mark.parametrize("s", [1e-5, 7e-4, 1.39e-3, 1.41e-3, 3e-3])
def test_the_acceleration_of_the_profile_is_that_of_its_speed(s):
    h = 1e-8
    ahead, behind = (profile(GAINS, ARMATURE, s + side)[0] for side in (-h, h))
    slope = (ahead - behind) / (2.0 * h)  # over the way gone
    speed, acceleration = profile(GAINS, ARMATURE, s)
    assert acceleration == pytest.approx(speed * slope, rel=1e-4)


def test_the_profile_ends_with_the_wanted_speed_and_no_acceleration():
    assert profile(GAINS, ARMATURE, 0.0) == (0.05, 0.0)
    assert profile(GAINS, ARMATURE, -1e-5) == (0.05, 0.0)


@pytest.mark.parametrize("gap", [0.5e-3, 1e-3, 1.4e-3])
def test_a_current_gives_the_force_that_is_asked_for(gap):
    for wanted in (0.5 * force(SOLENOID, 0.0, gap), 200.0):
        current = current_for(SOLENOID, wanted, gap, 45.0, 1.5e-3)
        assert force(SOLENOID, current, gap) == pytest.approx(wanted, rel=1e-6)


def test_no_current_is_asked_for_that_pulls_less_by_pulling_more():
    gap = 0.5e-3
    weakest = weakest_current(SOLENOID, gap)
    pulls = [force(SOLENOID, i, gap) for i in np.linspace(weakest, 0.0, 101)]
    assert (np.diff(pulls) > 0.0).all()
    assert pulls[0] < 0.4 * pulls[-1]
    assert current_for(SOLENOID, 0.0, gap, 45.0, 1.5e-3) == weakest
    assert current_for(SOLENOID, 0.0, 2e-3, 45.0, 1.5e-3) == 0.0
    assert current_for(SOLENOID, 1e6, gap, 45.0, 1.5e-3) == pytest.approx(45.0)
