# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Noise by seed and index."""

from __future__ import annotations

import numpy as np
from scipy import stats

from valve_twin.core.simulation.noise import normal_at, uniform_at


def test_the_numbers_are_normal_and_those_of_two_seeds_are_independent():
    one, other = (np.array([normal_at(seed, k) for k in range(4000)]) for seed in (1, 2))
    assert stats.kstest(one, "norm").pvalue > 0.001
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.06  # 4 standard deviations
    assert abs(np.corrcoef(one[1:], one[:-1])[0, 1]) < 0.06


def test_a_number_depends_on_seed_and_index_only():
    assert uniform_at(5, 7) == uniform_at(5, 7) != uniform_at(5, 8)
    assert 0.0 < uniform_at(0, 0) < 1.0
