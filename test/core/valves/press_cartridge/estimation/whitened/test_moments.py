# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Second moments of normal variables that are cut off at zero."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import (
    cut_moment,
    invert,
    truncated_moments,
)


@pytest.mark.parametrize("level", [-80.0, -25.001, -24.999, -6.0, -1.0, 0.0, 0.7, 3.0, 5.9])
def test_the_moment_is_that_of_a_cut_normal_variable(level):
    cut = truncnorm(-level, np.inf, loc=level)
    expected = cut.var() + (cut.mean() - max(level, 0.0)) ** 2
    assert cut_moment(level) == pytest.approx(expected, rel=1e-3 if level < -20.0 else 1e-9)


def test_far_from_zero_nothing_is_cut():
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(40, 7))
    columns[:, 6] = columns[:, :6] @ np.full(6, 50.0)
    gram = columns.T @ columns
    moments = np.zeros((6, 6))
    assert truncated_moments(gram, np.array([0, 1, 3, 5]), 0.01, moments)
    kept = np.ix_([0, 1, 3, 5], [0, 1, 3, 5])
    assert moments[kept] == pytest.approx(0.01 * np.linalg.inv(gram[kept]))
    assert np.isinf(moments[2]).all()


def test_dependent_columns_are_told():
    column = np.arange(1.0, 9.0)[:, None] * np.ones((1, 7))
    assert not truncated_moments(column.T @ column, np.array([0, 1]), 1.0, np.zeros((6, 6)))


def test_a_column_that_is_zero_is_not_regular():
    """A cycle of a sensor in coarse steps left one, and the estimate ended with a division."""
    gram = np.diag([2.0, 0.0, 1.0])
    assert not invert(gram, np.arange(3), np.empty((3, 3)))
    assert invert(gram, np.array([0, 2]), np.empty((2, 2)))
