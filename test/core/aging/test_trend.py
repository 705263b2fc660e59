# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest
from scipy import stats

from valve_twin.core.aging.trend import (
    fit_line,
    line_sums,
    pooled_autocorrelation,
    quantile,
    ratio_interval,
    residuals,
)


def ar1_matrix(n, rho):
    i = np.arange(n)
    return rho ** np.abs(i[:, None] - i[None, :])


def test_white_scatter_gives_the_textbook_regression():
    rng = np.random.default_rng(1)
    x = np.sort(rng.uniform(100.0, 200.0, 25))
    y = 3.0 - 0.02 * x + 0.1 * rng.standard_normal(25)
    line = fit_line(x, y, autocorrelation=0.0)
    book = stats.linregress(x, y)
    half = stats.t.ppf(0.975, 23) * book.stderr
    assert line.slope == pytest.approx(book.slope, rel=1e-12)
    assert line.level(0.0) == pytest.approx(book.intercept, rel=1e-10)
    assert line.p_value == pytest.approx(book.pvalue, rel=1e-9)
    assert line.slope_interval() == pytest.approx((book.slope - half, book.slope + half))


def test_mean_and_prediction_intervals_follow_their_closed_forms():
    rng = np.random.default_rng(2)
    x = np.arange(30.0)
    y = rng.standard_normal(30)
    line = fit_line(x, y, autocorrelation=0.0)
    s2 = float(residuals(x, y) @ residuals(x, y)) / 28
    leverage = 1 / 30 + (35.0 - x.mean()) ** 2 / np.sum((x - x.mean()) ** 2)
    t = stats.t.ppf(0.975, 28)
    level = line.level(35.0)
    assert line.mean_interval(35.0)[1] - level == pytest.approx(t * np.sqrt(s2 * leverage))
    assert line.prediction_interval(35.0)[1] - level == pytest.approx(
        t * np.sqrt(s2 * (1 + leverage))
    )


@pytest.mark.parametrize("n", [4, 57, 20_000])
def test_sums_of_a_line_are_those_of_its_residuals(n):
    rng = np.random.default_rng(n)
    x = 1e6 + np.cumsum(rng.uniform(0.5, 2.0, n))
    y = 3.0 + 1e-4 * x + 1e-3 * rng.standard_normal(n)
    sums, rest = line_sums(x, y), residuals(x, y)
    assert (sums.center, sums.mean) == pytest.approx((x.mean(), y.mean()), rel=1e-12)
    assert sums.square == pytest.approx(np.sum((x - x.mean()) ** 2), rel=1e-9)
    assert sums.power == pytest.approx(rest @ rest, rel=1e-9)
    assert sums.product == pytest.approx(rest[1:] @ rest[:-1], rel=1e-9, abs=1e-9 * sums.power)
    assert sums.most == y.max()


def test_covariance_under_autocorrelation_is_the_exact_sandwich():
    rng = np.random.default_rng(4)
    n, rho = 35, 0.45
    x = np.cumsum(rng.uniform(0.5, 2.0, n))
    y = rng.standard_normal(n)
    line = fit_line(x, y, autocorrelation=rho)
    X = np.column_stack([np.ones(n), x - x.mean()])
    inverse = np.linalg.inv(X.T @ X)
    R = ar1_matrix(n, rho)
    M = np.eye(n) - X @ inverse @ X.T
    s2 = float(y @ M @ y) / np.trace(M @ R)  # unbiased: E[y' M y] = sigma^2 tr(M R)
    wanted = s2 * inverse @ X.T @ R @ X @ inverse
    assert line.sigma**2 == pytest.approx(s2, rel=1e-10)
    assert np.allclose(
        [[line.var_mean, line.cov], [line.cov, line.var_slope]], wanted, rtol=1e-9, atol=1e-15
    )


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.5])
def test_autocorrelation_is_free_of_the_bias_of_detrending(scatter, rho):
    x = np.arange(60.0)
    found = [pooled_autocorrelation([residuals(x, scatter(s, 60, rho))]) for s in range(500)]
    # standard error of the mean is 0.13/sqrt(500) = 0.006; uncorrected the bias is -0.03 .. -0.07
    assert abs(np.mean(found) - rho) < 0.02


def test_several_short_lines_share_one_autocorrelation(scatter):
    x = np.arange(30.0)
    found = [
        pooled_autocorrelation([residuals(x, part) for part in scatter(s, 90, 0.4).reshape(3, 30)])
        for s in range(500)
    ]
    assert abs(np.mean(found) - 0.4) < 0.02


def test_too_few_residuals_say_nothing_about_autocorrelation():
    assert pooled_autocorrelation([np.array([1.0, -1.0, 1.0, -1.0])]) == 0.0


def slope_hits(scatter, n, seeds, **known):
    x = np.arange(float(n))
    hits = 0
    for seed in range(seeds):
        y = 1.0 - 0.0013 * x + 0.013 * scatter(seed, n)
        low, high = fit_line(x, y, **known).slope_interval()
        hits += low <= -0.0013 <= high
    return hits


def test_slope_interval_covers_95_percent_of_white_histories(scatter):
    # binomial 99 % limits of 1000 draws at 0.95 are 932 and 967
    assert 932 <= slope_hits(scatter, 60, 1000, autocorrelation=0.0) <= 967


def test_estimating_the_autocorrelation_costs_no_coverage(scatter):
    # a negative estimate is not used, so the interval is a little wide: 95.9 % of 3000 other
    # histories; binomial 99 % limits of 1000 draws at 0.959 are 942 and 974
    assert 942 <= slope_hits(scatter, 60, 1000) <= 974


def test_correction_restores_the_coverage_that_autocorrelation_takes(scatter):
    x = np.arange(100.0)
    corrected = naive = 0
    for seed in range(500):
        y = scatter(seed, 100, 0.5)
        low, high = fit_line(x, y).slope_interval()
        corrected += low <= 0.0 <= high
        low, high = fit_line(x, y, autocorrelation=0.0).slope_interval()
        naive += low <= 0.0 <= high
    # equations.md 2.5: 73-81 % uncorrected
    assert 0.68 <= naive / 500 <= 0.81
    assert 0.90 <= corrected / 500 <= 0.975


def test_units_and_origin_of_the_axis_do_not_matter():
    rng = np.random.default_rng(5)
    x, y = np.arange(40.0), rng.standard_normal(40)
    line, scaled = fit_line(x, y), fit_line(2.0 * x + 1e5, -1000.0 * y)
    assert scaled.slope == pytest.approx(-500.0 * line.slope)
    assert scaled.p_value == pytest.approx(line.p_value)
    assert scaled.level(1e5) == pytest.approx(-1000.0 * line.level(0.0))


def test_refuses_a_line_without_extent():
    with pytest.raises(ValueError, match="3 values at different places, got 4"):
        fit_line(np.ones(4), np.arange(4.0))


def test_ratio_limits_solve_their_defining_equation():
    a, b, var_a, cov, var_b, t = 0.86, 1.0, 4e-4, 1e-4, 3e-4, 2.0
    for r in ratio_interval(a, b, var_a=var_a, cov=cov, var_b=var_b, t=t):
        spread = var_a - 2 * r * cov + r * r * var_b
        assert (a - r * b) ** 2 == pytest.approx(t * t * spread)


def test_ratio_has_no_limits_where_the_reference_may_be_zero():
    low, high = ratio_interval(1.0, 0.1, var_a=0.01, cov=0.0, var_b=0.01, t=2.0)
    assert np.isnan(low)
    assert np.isnan(high)


def test_quantile_is_that_of_student():
    assert quantile(7.5, 0.9) == pytest.approx(stats.t.ppf(0.95, 7.5))
