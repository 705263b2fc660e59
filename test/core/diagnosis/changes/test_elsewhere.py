# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A fault of a product that is not made any more is told while what followed looks like it."""

import numpy as np
import pytest

from valve_twin.core.diagnosis.changes.elsewhere import LOOKED_AT, Elsewhere, followed_by
from valve_twin.core.diagnosis.features import FeatureSet

KIND = FeatureSet(("level", "gain", "free"), across={"level": 0.1, "gain": 0.1})
ONSET, CHANGED = 20, 26


def history(fault, after, cycles=40):
    """Return features: `fault` from cycle 20 to 25 of one product, then `after` of another."""
    vectors = 0.01 * np.random.default_rng(1).standard_normal((cycles, 3))
    vectors[ONSET - 1 : CHANGED - 1] += fault
    vectors[CHANGED - 1 :] += after
    return vectors


def told(fault, after, cycles=40, kind=KIND):
    numbers = np.arange(1, cycles + 1)
    own = numbers < CHANGED
    known = np.ones(cycles, dtype=bool)
    return followed_by(numbers, history(fault, after, cycles), own, ONSET, known, kind)


@pytest.mark.parametrize(
    ("after", "state"),
    [
        ((0.0, 0.0, 5.0), Elsewhere.OVER),  # what is not named tells nothing
        ((0.1, -0.1, 0.0), Elsewhere.OVER),  # what a product does
        ((1.0, 1.0, 0.0), Elsewhere.THERE),
        ((0.9, 1.1, 5.0), Elsewhere.THERE),
        ((0.5, 0.5, 0.0), Elsewhere.UNKNOWN),
    ],
)
def test_what_followed_is_like_before_like_the_fault_or_neither(after, state):
    found = told((1.0, 1.0, 1.0), after)
    assert found.state is state
    assert found.last == CHANGED - 1


def test_a_fault_less_than_what_a_product_does_is_not_decided():
    assert told((0.05, 0.0, 0.0), (0.0, 0.0, 0.0)).state is Elsewhere.UNKNOWN


def test_it_stays_told_until_enough_cycles_followed_and_is_then_settled_for_good():
    last = CHANGED - 1
    few = told((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), last + LOOKED_AT - 1)
    assert (few.state, few.seen) == (Elsewhere.THERE, -1)
    for cycles in (last + LOOKED_AT, 60):
        found = told((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), cycles)
        assert (found.state, found.seen) == (Elsewhere.OVER, last + LOOKED_AT)


def test_where_it_is_not_known_what_a_product_changes_a_fault_stays_told():
    kind = FeatureSet(KIND.names)
    assert told((1.0, 1.0, 0.0), (0.0, 0.0, 0.0), kind=kind).state is Elsewhere.THERE
