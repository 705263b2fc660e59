# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Surrogates and what they say of themselves."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.search.surrogate import fit_surrogate


def drawn(count, wide=3):
    return np.random.default_rng(1).random((count, wide))


@pytest.mark.parametrize(
    ("kind", "of"),
    [
        ("linear", lambda x: 2.0 + 3.0 * x[:, 0] - x[:, 2]),
        ("quadratic", lambda x: 1.0 + x[:, 0] * x[:, 1] + 2.0 * x[:, 2] ** 2),
    ],
)
def test_a_polynomial_is_found_exactly(kind, of):
    points, unseen = drawn(40), np.random.default_rng(2).random((20, 3))
    found = fit_surrogate(points, of(points))
    assert found.error < 1e-9
    assert found.told == pytest.approx(1.0)
    assert found.model(unseen) == pytest.approx(of(unseen))
    assert kind in ("linear", found.kind)


def test_the_error_it_claims_is_that_of_unseen_designs():
    def of(x):
        return np.sin(5.0 * x[:, 0]) + np.exp(x[:, 1]) * x[:, 2]

    found = fit_surrogate(drawn(60), of(drawn(60)))
    unseen = np.random.default_rng(2).random((400, 3))
    missed = float(np.sqrt(np.mean((found.model(unseen) - of(unseen)) ** 2)))
    assert found.kind == "radial basis"
    assert 0.5 * missed < found.error < 2.0 * missed
    assert len(found.parts) == 10


def test_noise_is_told_from_nothing():
    values = np.random.default_rng(3).normal(size=40)
    assert fit_surrogate(drawn(40), values).told < 0.3
