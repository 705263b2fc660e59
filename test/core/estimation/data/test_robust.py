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
    find_spikes,
    robust_sigma,
)


def test_the_constants_are_those_of_the_normal_distribution():
    assert pytest.approx(1.0 / norm.ppf(0.75), rel=1e-4) == MAD_SCALE
    assert pytest.approx(norm.ppf(0.975), rel=1e-15) == NORMAL_975


def test_outliers_hardly_count():
    off = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    off[::50] = 1e6
    assert robust_sigma(off) == pytest.approx(0.3, rel=0.05)


@pytest.mark.parametrize("digits", [1, 3, 16])
def test_the_median_has_the_bits_of_numpy_and_leaves_the_values_alone(digits):
    rng = np.random.default_rng(5)
    for n in [*range(1, 40), 849, 850, 20_001, 20_002]:
        off = np.round(rng.standard_normal(n), digits)
        off[rng.integers(n)] = rng.choice([np.inf, -1e300, 0.0])
        given = off.copy()
        assert robust_sigma(off) == MAD_SCALE * float(np.median(np.abs(off)))
        assert (off == given).all()
        off[rng.integers(n)] = np.nan
        assert np.isnan(robust_sigma(off))
    assert np.isnan(robust_sigma(np.empty(0)))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_differences_tell_the_noise_and_not_a_smooth_motion(order):
    t = np.linspace(0.0, 1.0, 50_000)
    y = np.sin(6.0 * t) + 0.02 * np.random.default_rng(2).standard_normal(len(t))
    assert difference_sigma(np.diff(y, order), order) == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize("refresh", [1, 4])
def test_samples_that_jump_away_and_back_are_spikes_and_a_motion_is_none(refresh):
    rng = np.random.default_rng(3)
    motion = np.interp(np.arange(400), [0, 100, 160, 250, 300, 399], [0, 0, 0.5, 0.5, 0, 0])
    y = np.repeat((motion + 3e-4 * rng.standard_normal(400))[::refresh], refresh)
    assert not find_spikes(y, 6e-3).any()
    wild, near = np.zeros(400, dtype=bool), np.zeros(400, dtype=bool)
    for first in (40, 128, 200, 280):
        wild[first : first + refresh] = True
        near[first - refresh : first + 2 * refresh] = True
    y[wild] += 0.05
    found = find_spikes(y, 6e-3)
    assert found[wild].all()
    assert not found[~near].any()  # in a motion the value beside a spike turns, too


def test_normal_noise_and_missing_samples_have_no_spikes():
    y = 1e-2 * np.random.default_rng(4).standard_normal(20_000)
    y[::7] = np.nan
    assert not find_spikes(y, 0.0).any()
    assert not find_spikes(np.full(5, np.nan), 0.0).any()
    assert not find_spikes(np.zeros(5), 0.0).any()
