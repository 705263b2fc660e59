# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import numpy as np
import pytest

from valve_twin.core.aging.laws.ar1 import ar1_forms, ar1_leading, ar1_product, shape_weights
from valve_twin.core.aging.laws.shapes import squares


def ar1_matrix(n, rho):
    i = np.arange(n)
    return rho ** np.abs(i[:, None] - i[None, :])


def test_one_pass_product_equals_the_full_matrix():
    rng = np.random.default_rng(3)
    u, v = rng.standard_normal((2, 40))
    assert ar1_product(u, v, 0.6) == pytest.approx(float(u @ ar1_matrix(40, 0.6) @ v), rel=1e-12)


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95])
def test_products_of_many_rows_are_those_of_the_full_matrix(rho):
    rng = np.random.default_rng(31)
    u, v, short = rng.standard_normal((3, 40)), rng.standard_normal((3, 40)), np.ones(4)
    r, whole = ar1_matrix(40, rho), np.r_[short, np.zeros(36)]
    forms = [np.diag(a @ r @ b.T) for a, b in ((u, u), (u, v), (v, v))]
    assert ar1_forms(u, v, rho) == pytest.approx(np.array(forms), rel=1e-11)
    assert ar1_leading(short, v, rho) == pytest.approx(v @ r @ whole, rel=1e-11)


def test_weights_of_shapes_give_their_level_and_change():
    random = np.random.default_rng(4)
    g, y, rho = np.sort(random.random((5, 30)), axis=1), random.random(30), 0.4
    kept, fits = np.array([1, 3, 4]), squares(g, y, np.empty(30))
    level, change = np.empty((2, 3, 30))
    forms = shape_weights(g, kept, fits[kept], rho, level, change)
    for k, row in enumerate(kept):
        slope, mean = np.polyfit(g[row], y, 1)
        assert change[k] @ y == pytest.approx(slope)
        assert level[k] @ y == pytest.approx(mean + slope * g[row, -1])
    assert np.array_equal(forms, ar1_forms(level, change, rho))
