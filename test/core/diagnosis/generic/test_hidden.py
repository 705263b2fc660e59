# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether repeated values are those of a resting stem, against drawn values."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.hidden import (
    frozen_share,
    is_hidden,
    noise_of,
    repeated_at_rest,
)
from valve_twin.core.diagnosis.generic.motion import Motion


def features(noise, step):
    """Return rows of which the second holds the valve's own motion."""
    motion = Motion(0.1, noise, step, (0.0, 9.0), (0.0, 1.0))
    numbers = tuple(v.value for v in motion.values())
    return SimpleNamespace(key=np.arange(3), motions={1: numbers, 7: (0.1, 9.0, 1.0)})


@pytest.mark.parametrize("noise", [0.3, 0.6, 1.0, 3.0])
def test_a_resting_stem_repeats_at_most_as_often_as_in_mid_step(noise):
    random = np.random.default_rng(1)
    shares = []
    for level in np.linspace(0.0, 0.5, 6):
        drawn = np.round(level + noise * random.standard_normal(40_000))
        shares.append(float(np.mean(np.diff(drawn) == 0.0)))
    assert shares[0] == pytest.approx(repeated_at_rest(noise), abs=0.01)
    assert max(shares) < repeated_at_rest(noise) + 0.01


def test_what_repeats_beyond_chance_is_frozen_where_noise_is_seen():
    assert frozen_share(3.0, 0.1, 0.55) == pytest.approx(0.5)
    assert frozen_share(math.inf, 0.0, 0.3) == pytest.approx(0.3)
    assert frozen_share(1.0, 0.1, 0.3) == 0.0  # a resting stem repeats 0.26
    assert frozen_share(0.4, 0.1, 1.0) == frozen_share(math.nan, 0.1, 1.0) == 0.0


def test_the_noise_of_the_sensor_is_that_of_its_motion_over_its_step():
    assert noise_of(features(2e-3, 1e-3)) == pytest.approx(2.0)
    assert noise_of(features(2e-3, 0.0)) == math.inf
    without: Any = SimpleNamespace(key=np.arange(3), motions={})
    assert math.isnan(noise_of(without))
    assert is_hidden(features(0.289e-3, 1e-3))
    assert not is_hidden(features(2e-3, 1e-3))
