# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The minimum on an interval, in few evaluations."""

import numpy as np
import pytest

from valve_twin.core.valves.press_cartridge.estimation.solvers.line_search import (
    BEST,
    BEST_VALUE,
    line_next,
    line_start,
    line_update,
)


def search(function, low, high, start, width=1e-3):
    """Return the best place, its value, and the places tried."""
    state = line_start(low, high, start, function(start))
    tried = [start]
    while not np.isnan(at := line_next(state, width)):
        line_update(state, at, function(at))
        tried.append(at)
        assert low <= at <= high
        assert len(tried) < 60
    return state[BEST], state[BEST_VALUE], tried


@pytest.mark.parametrize(
    ("function", "truth", "most"),
    [
        (lambda x: (x - 0.3) ** 2, 0.3, 8),
        (lambda x: np.cosh(4.0 * (x - 0.62)), 0.62, 12),
        (lambda x: abs(x - 0.41), 0.41, 25),
        (lambda x: -x, 1.0, 18),
        (np.sqrt, 0.0, 18),
        (lambda x: x**8, 0.0, 40),
    ],
    ids=["parabola", "smooth", "kink", "upper end", "lower end", "flat"],
)
def test_the_minimum_is_found(function, truth, most):
    place, value, tried = search(function, 0.0, 1.0, 0.5)
    flat = 0.3 if function(0.1) < 1e-7 else 3e-3
    assert place == pytest.approx(truth, abs=flat)
    assert value == function(place) == min(function(x) for x in tried)
    assert len(tried) <= most


def test_a_search_may_begin_at_an_end():
    place, _, tried = search(lambda x: (x - 0.3) ** 2, 0.0, 1.0, 0.0)
    assert place == pytest.approx(0.3, abs=3e-3)
    assert search(lambda x: x, 0.2, 0.4, 0.2)[0] == 0.2
    assert len(tried) < 12


def test_an_interval_without_width_is_its_own_minimum():
    assert search(lambda x: x, 0.5, 0.5, 0.5) == (0.5, 0.5, [0.5])
