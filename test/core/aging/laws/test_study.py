# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What is forecast of random trends of all laws is tested as statistics, with seeds of its own."""

import numpy as np
import pytest

from valve_twin.core.aging.config import Law
from valve_twin.core.aging.laws.study import brier_skill, draw_case, study_laws


@pytest.mark.slow
def test_limits_hold_as_often_as_they_claim_whatever_the_law():
    rows = study_laws(histories=400, seed=2)
    assert 0.85 <= np.mean([row.covered for row in rows]) <= 0.95
    for row in rows:
        # binomial standard error of 400 draws 1.5 %; an infinite limit counts as holding
        assert 0.83 <= row.covered <= 0.98, row
    assert rows[0].bounded >= 0.8
    assert rows[0].bends <= 0.03
    assert brier_skill(rows) >= 0.3


def test_few_histories_of_each_law_are_judged():
    rows = study_laws(histories=25, seed=3)
    assert [row.law for row in rows] == [law.value for law in Law]
    # four standard errors of 100 draws below 90 %
    assert np.mean([row.covered for row in rows]) >= 0.78
    assert brier_skill(rows) > 0.0


@pytest.mark.parametrize("law", Law)
def test_the_true_life_is_where_the_way_without_scatter_ends(law, monkeypatch):
    monkeypatch.setattr("valve_twin.core.aging.laws.study.ar1_scatter", quiet)
    for seed in range(20):
        case = draw_case(np.random.default_rng(seed), law)
        share = 100.0 * (case.values[-1] / case.values[:10].mean() - 1.0) / case.limit_percent
        assert 30 <= len(case.values) <= 150
        assert 0.0 < share < 1.0  # on its way, and not there
        if law is Law.LINE:
            end = case.values[-1] + (case.values[1] - case.values[0]) * case.remaining
            limit = (1.0 + 0.01 * case.limit_percent) * case.values[:10].mean()
            assert end == pytest.approx(limit)


def quiet(rng, histories, samples, autocorrelation):
    """Stand in for the scatter: none."""
    return np.zeros((histories, samples))


def test_a_third_of_the_saturating_never_reach_the_limit():
    many = [draw_case(np.random.default_rng(s), Law.SATURATING).remaining for s in range(300)]
    # standard error 2.7 %
    assert np.mean(np.isinf(many)) == pytest.approx(1.0 / 3.0, abs=0.09)
