# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The recursive adaptation beside padasip: both learn the same before their times are compared."""

import numpy as np
import pytest

from valve_twin.bench.measure import Scale
from valve_twin.bench.models import recursion
from valve_twin.core.estimation.recursive.estimator import Structure


def test_padasip_is_the_peer():
    assert recursion.peer()[1] == "padasip"


@pytest.mark.parametrize("order", [1, 2, 3])
def test_all_ways_learn_the_same_parameters(order):
    y, u = recursion.record()
    rows, outputs = recursion.regression(y, u, order)
    structure = Structure(na=order, nb=order)
    theirs = recursion.peer()[0](rows, outputs)
    for ours in (
        recursion.identified(structure, y, u),
        recursion.stepped(structure, y, u),
        recursion.learn_in_numpy(rows, outputs),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-6)


def test_times_of_different_results_are_not_compared(monkeypatch):
    monkeypatch.setattr(recursion, "identified", lambda *_: np.zeros(4))
    with pytest.raises(AssertionError, match="the parameters differ"):
        next(recursion.compare(Scale(True, 1)))
