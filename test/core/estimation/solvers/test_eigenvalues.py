# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Eigenvalues of a scaled Gram matrix are those of LAPACK."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.estimation.solvers.eigenvalues import extreme_eigenvalues

SEEDS = st.integers(0, 10**6)


@given(SEEDS, st.integers(1, 8))
def test_extreme_eigenvalues_are_those_of_lapack(seed, k):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(30, k)) * 10.0 ** rng.uniform(-4, 4, k)
    gram = u.T @ u
    length = np.sqrt(np.diag(gram))
    eigen = np.linalg.eigvalsh(gram / np.outer(length, length))
    assert extreme_eigenvalues(gram) == pytest.approx((eigen[0], eigen[-1]), rel=1e-9)
    assert extreme_eigenvalues(np.zeros((k, k))) == (0.0, 0.0)
