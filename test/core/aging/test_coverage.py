# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The limits of the remaining life are tested as statistics, over the whole way of a history."""

from functools import cache

import numpy as np
import pytest

from valve_twin.core.aging.coverage import LIMIT_PERCENT, SLOPE, ar1_scatter, coverage_of_life
from valve_twin.core.aging.coverage import true_remaining as remaining

found_of = cache(coverage_of_life)
"""What lives show, computed once for all that is asked of it."""


@pytest.mark.no_cover
@pytest.mark.parametrize("samples", [60, 105])
def test_limits_of_white_histories_hold_the_truth_as_often_as_they_claim(samples):
    found = found_of(samples, 0.0)
    # 4000 other histories: 90.8 and 91.8 %; binomial standard error of 500 draws 1.3 %
    assert abs(found.covered - 0.9) <= 0.03
    assert found.unbounded <= 0.01
    assert found.silent <= 0.01


@pytest.mark.no_cover
@pytest.mark.parametrize("samples", [60, 105])
def test_limits_of_autocorrelated_histories_hold_the_truth(samples):
    found = coverage_of_life(samples, 0.5)
    # 4000 other histories: 87.3 and 88.4 %; binomial standard error of 500 draws 1.5 %
    assert found.covered >= 0.85
    assert found.silent <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize("samples", [60, 105])
@pytest.mark.parametrize("autocorrelation", [0.0, 0.5])
def test_limits_of_many_histories_hold_the_truth(samples, autocorrelation):
    found = coverage_of_life(samples, autocorrelation, histories=4000, seed=1)
    # binomial standard error 0.5 %; 87-92 % in fact
    assert (0.865 if autocorrelation else 0.885) <= found.covered <= 0.93


@pytest.mark.no_cover
def test_limits_err_to_both_sides_alike():
    found = found_of(105, 0.0)
    # half of the histories each: binomial standard error 2.2 % of the median
    assert abs(found.median_late - 0.5) <= 0.06
    assert abs(found.too_early - found.too_late) <= 0.03


def test_short_histories_mostly_have_no_upper_limit():
    found = coverage_of_life(20, 0.0, histories=200)
    assert found.unbounded >= 0.5
    assert found.covered >= 0.87  # those without an upper limit hold what is later


def test_the_true_life_is_that_of_the_line_without_scatter():
    line = 1.0 + SLOPE * np.arange(1, 400)
    limit = (1.0 + LIMIT_PERCENT / 100.0) * line[:10].mean()
    beyond = 1 + int(np.flatnonzero(line <= limit)[0])
    assert beyond - 1 < 60 + remaining(60, 10) <= beyond


def test_scatter_has_the_size_and_autocorrelation_asked_for():
    drawn = ar1_scatter(np.random.default_rng(1), 400, 500, 0.5)
    # the mean square of 400 x 500 values with rho = 0.5 has a standard error of 0.004
    assert np.mean(drawn**2) == pytest.approx(1.0, abs=0.02)
    assert np.mean(drawn[:, 1:] * drawn[:, :-1]) == pytest.approx(0.5, abs=0.02)
