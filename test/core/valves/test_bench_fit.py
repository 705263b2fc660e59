# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What bench fits share: intervals by propagation, and times that can be used."""

import numpy as np
import pytest

from valve_twin.core.estimation.solvers.nonlinear import Curve, FitParameter, fit_curves
from valve_twin.core.valves.bench_fit import check_time, fitted_value, with_interval


def line_fit(seed):
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 1.0, 20)
    curve = Curve(x, 2.0 + 3.0 * x + 0.1 * rng.standard_normal(20))
    parameters = [FitParameter("level", 1.0), FitParameter("slope", 1.0)]
    return fit_curves(lambda x, p: p[0] + p[1] * x, [curve], parameters)


@pytest.mark.no_cover
def test_propagated_intervals_hold_the_truth_as_often_as_they_say():
    """Level at x = 1: 5, correlated parameters; 95 % of 400 draws, two standard errors 2.2."""
    hits = 0
    for seed in range(400):
        found = fitted_value(line_fit(seed), "end", "1", lambda p: float(p[0] + p[1]))
        hits += found.lower <= 5.0 <= found.upper
    assert 0.928 <= hits / 400 <= 0.972


def test_a_value_without_an_error_has_no_interval():
    assert np.isnan(with_interval("x", 1.0, np.nan, 5.0, "1").lower)
    assert np.isnan(with_interval("x", 1.0, 0.1, 0.0, "1").upper)


@pytest.mark.parametrize(
    ("times", "line"),
    [
        ([0.0, 1.0], "2 rows; 8 or more are needed"),
        ([0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 6.0], "time goes from 2 to 2 s: must increase"),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 9.0], "a step of 3 s at 6 s among steps of 1 s"),
    ],
)
def test_times_that_cannot_be_used_are_told(times, line):
    with pytest.raises(ValueError, match=line):
        check_time(np.array(times), uniform=True)
