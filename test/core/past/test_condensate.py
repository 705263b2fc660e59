# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""An hour of cycles is what its values were, and says how many could not be used."""

import math

import pytest

from test.core.past.test_state import trends
from valve_twin.core.past.condensate import DAY_S, HOUR_S, Condenser

MINUTE_NS = 60 * 10**9


def condensed(values, **options):
    condenser = Condenser(**options)
    for n, value in enumerate(values):
        condenser.add(n, n * MINUTE_NS, n * MINUTE_NS + 5, "e", {"gain": value})
    return list(condenser.result())


def test_values_are_divided_by_the_hour_and_day_in_which_their_cycle_began():
    found = condensed([float(n) for n in range(150)])
    assert [(c.span_s, c.cycle, c.last_cycle, c.count) for c in found] == [
        (HOUR_S, 0, 59, 60),
        (DAY_S, 0, 149, 150),
        (HOUR_S, 60, 119, 60),
        (HOUR_S, 120, 149, 30),
    ]
    assert [(c.start_ns, c.end_ns) for c in found[:2]] == [
        (0, 59 * MINUTE_NS + 5),
        (0, 149 * MINUTE_NS + 5),
    ]


def test_quantiles_lie_on_lines_between_neighbours():
    (found,) = condensed([4.0, 1.0, 2.0, 3.0, 0.0], spans=(DAY_S,))
    assert (found.minimum, found.maximum, found.mean, found.median) == (0.0, 4.0, 2.0, 2.0)
    assert (found.quantile_25, found.quantile_75) == (1.0, 3.0)
    assert (found.quantile_05, found.quantile_95) == pytest.approx((0.2, 3.8))


def test_what_cannot_be_used_counts_and_no_more():
    (found,) = condensed([1.0, math.nan, 3.0], spans=(HOUR_S,))
    assert (found.count, found.usable, found.minimum, found.mean) == (3, 2, 1.0, 2.0)
    (found,) = condensed([math.nan], spans=(HOUR_S,))
    assert (found.count, found.usable) == (1, 0)
    assert all(map(math.isnan, (found.minimum, found.maximum, found.mean, found.median)))


def test_an_estimate_is_condensed_by_its_parameters():
    condenser = Condenser((HOUR_S,))
    for estimate in trends([1.0, 2.0, 6.0]):
        condenser.add_estimate(estimate)
    found = {c.parameter: (c.count, c.mean) for c in condenser.result()}
    assert (3, 3.0) in found.values()
