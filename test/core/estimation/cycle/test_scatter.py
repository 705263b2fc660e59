# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled scatter of a series: the bits of the same in numpy."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.scatter import NOT_CALIBRATED, scatter_between_cycles
from valve_twin.core.estimation.cycle.scatter_kernel import middle_of, sum_as_numpy
from valve_twin.core.estimation.data.robust import robust_sigma

LENGTHS = [10, 11, 15, 16, 17, 49, 50, 127, 128, 129, 300]


def in_numpy(values):
    n = len(values)
    x = np.arange(n, dtype=float)
    i, j = np.triu_indices(n, 1)
    off = values - float(np.median((values[j] - values[i]) / (x[j] - x[i]))) * x
    off = off - np.median(off)
    limit = 4.0 * robust_sigma(off)
    keep = np.abs(off) <= limit if limit > 0.0 else np.ones(n, dtype=bool)
    x, y = x[keep] - x[keep].mean(), values[keep] - values[keep].mean()
    along = float((x * y).sum())
    squares = float((y * y).sum() - along * along / (x * x).sum())
    return float(np.sqrt(max(squares, 0.0) / (len(y) - 2))), len(y) - 2


def made(kind, length):
    rng = np.random.default_rng(length)
    values = 0.3 + 1e-3 * rng.normal(size=length) + 1e-4 * np.arange(length)
    if kind == "outliers":
        values[rng.integers(0, length, 3)] *= 10.0
    elif kind == "steps":
        values = np.round(values, 3)
    elif kind == "constant":
        values[:] = 0.3
    return values


@pytest.mark.parametrize("kind", ["noise", "outliers", "steps", "constant"])
@pytest.mark.parametrize("length", LENGTHS)
def test_the_scatter_has_the_bits_of_numpy(kind, length):
    values = made(kind, length)
    found = scatter_between_cycles(values)
    assert (found.sigma, found.freedom) == in_numpy(values)
    assert middle_of(values) == np.median(values)
    assert sum_as_numpy(values) == np.sum(values)


def test_few_values_and_such_that_are_no_numbers_are_not_calibrated():
    assert scatter_between_cycles(np.ones(9)) == NOT_CALIBRATED
    assert np.isnan(scatter_between_cycles(np.full(12, np.nan)).sigma)


@pytest.mark.parametrize("length", [1, 2, 3, 8, 1000, 1001])
def test_the_middle_of_huge_and_of_equal_numbers(length):
    rng = np.random.default_rng(length)
    for values in (1e300 * rng.normal(size=length), rng.integers(0, 2, length).astype(float)):
        assert middle_of(values) == np.median(values)
