# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.config import Law
from valve_twin.core.aging.laws.fit import fit_laws, law_shape
from valve_twin.core.aging.trend import fit_line

X = np.arange(1.0, 121.0)
U = X / 120.0
WAYS = {
    Law.LINE: U,
    Law.EXPONENTIAL: np.expm1(4.0 * U) / np.expm1(4.0),
    Law.POWER: U**0.4,
    Law.SATURATING: np.expm1(-4.0 * U) / np.expm1(-4.0),
}


@pytest.mark.parametrize("law", Law)
def test_the_law_that_made_a_clear_history_is_the_most_probable(law, scatter):
    y = 1.0 - 0.15 * WAYS[law] + 0.002 * scatter(1, 120)
    fit = fit_laws(X, y)
    assert fit.probable()[0] is law
    assert fit.bends == (law is not Law.LINE)
    assert fit.weight.sum() == pytest.approx(1.0)


def test_a_noisy_history_leaves_every_law_open(scatter):
    fit = fit_laws(X, 1.0 - 0.05 * U + 0.03 * scatter(2, 120))
    assert not fit.bends
    assert {law for law, _, _ in fit.alternatives(0.01)} == set(Law)


def test_a_line_seldom_bends(scatter):
    bent = [fit_laws(X, 1.0 - 0.1 * U + 0.01 * scatter(s, 120, 0.3)).bends for s in range(200)]
    assert np.mean(bent) <= 0.05  # as often as the line has less than 5 % of the evidence


def test_line_alone_is_the_least_squares_line(scatter):
    y = 1.0 - 0.1 * U + 0.01 * scatter(3, 120, 0.5)
    fit, line = fit_laws(X, y, ("line",)), fit_line(X, y)
    near = fit.tangent(100.0, samples=120, sigma=line.sigma)
    assert near.mean == pytest.approx(line.level(100.0))
    assert near.slope == pytest.approx(line.slope)
    assert near.var_mean == pytest.approx(line.level_variance(100.0))
    assert near.var_slope == pytest.approx(line.var_slope)
    assert fit.sigma[0] == pytest.approx(line.sigma)


def test_unit_and_origin_do_not_matter(scatter):
    y = 1.0 - 0.15 * WAYS[Law.EXPONENTIAL] + 0.005 * scatter(4, 120)
    one, other = fit_laws(X, y), fit_laws(500.0 + 30.0 * X, -1e-4 * y)
    assert other.weight == pytest.approx(one.weight, rel=1e-6)
    assert other.level == pytest.approx(-1e-4 * one.level)


def test_a_precise_history_gets_shapes_between_those_of_the_grid(scatter):
    y = 1.0 - 0.15 * np.expm1(2.8 * U) / np.expm1(2.8) + 2e-4 * scatter(5, 120)
    fit = fit_laws(X, y)
    own = fit.law == 1
    rate = float(fit.weight[own] @ fit.number[own] / fit.weight[own].sum())
    assert rate == pytest.approx(2.8, abs=0.1)
    assert fit.weight.max() < 0.7


@pytest.mark.parametrize("law", [Law.LINE, Law.EXPONENTIAL])
def test_the_shape_that_leaves_least_is_told_with_whether_it_bends(law):
    shape, bends = law_shape(X, 1.0 - 0.1 * WAYS[law])
    assert bends == (law is not Law.LINE)
    assert np.corrcoef(shape, WAYS[law])[0, 1] == pytest.approx(1.0, abs=1e-4)
