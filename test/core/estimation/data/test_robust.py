# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Robust scatter against the closed forms of the normal distribution."""

import numpy as np
import pytest
from scipy.stats import norm

from valve_twin.core.estimation.data.robust import (
    MAD_SCALE,
    NORMAL_975,
    difference_sigma,
    robust_sigma,
)


def test_the_constants_are_those_of_the_normal_distribution():
    assert pytest.approx(1.0 / norm.ppf(0.75), rel=1e-4) == MAD_SCALE
    assert pytest.approx(norm.ppf(0.975), rel=1e-15) == NORMAL_975


def test_outliers_hardly_count():
    off = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    off[::50] = 1e6
    assert robust_sigma(off) == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_differences_tell_the_noise_and_not_a_smooth_motion(order):
    t = np.linspace(0.0, 1.0, 50_000)
    y = np.sin(6.0 * t) + 0.02 * np.random.default_rng(2).standard_normal(len(t))
    assert difference_sigma(np.diff(y, order), order) == pytest.approx(0.02, rel=0.03)
