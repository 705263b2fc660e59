# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was found in the same values is not sought again, in others it is."""

import numpy as np

from valve_twin.core.diagnosis.changes.kept import MOST, kept


def counted():
    """Return a function that is kept, and the list of what it was called with."""
    calls = []

    @kept
    def total(values, factor):
        calls.append((values.shape, factor))
        return factor * float(values.sum())

    return total, calls


def test_the_same_values_are_looked_at_once():
    total, calls = counted()
    values = np.arange(6.0).reshape(3, 2)
    assert total(values, 2.0) == 30.0
    assert total(values.copy(), 2.0) == 30.0
    assert total(np.asfortranarray(values), 2.0) == 30.0
    assert len(calls) == 1


def test_other_values_shapes_and_factors_are_others():
    total, calls = counted()
    values = np.arange(6.0).reshape(3, 2)
    total(values, 2.0)
    assert total(values + 1.0, 2.0) == 42.0
    assert total(values, 3.0) == 45.0
    assert total(values.reshape(2, 3), 2.0) == 30.0
    assert calls == [((3, 2), 2.0), ((3, 2), 2.0), ((3, 2), 3.0), ((2, 3), 2.0)]


def test_values_that_are_none_are_the_same_again():
    total, calls = counted()
    values = np.array([np.nan, 1.0])
    total(values, 1.0)
    total(values.copy(), 1.0)
    assert len(calls) == 1


def test_whole_numbers_and_arrays_of_nothing_are_taken_as_they_are():
    total, calls = counted()
    assert total(np.arange(3), 2.0) == 6.0
    assert total(np.zeros((4, 0)), 2.0) == 0.0
    assert calls == [((3,), 2.0), ((4, 0), 2.0)]


def test_what_changes_later_does_not_change_what_is_kept():
    total, calls = counted()
    values = np.arange(3.0)
    total(values, 1.0)
    values[0] = 9.0
    assert total(values, 1.0) == 12.0
    assert total(np.arange(3.0), 1.0) == 3.0
    assert len(calls) == 2


def test_no_more_than_the_newest_are_kept():
    total, calls = counted()
    for k in range(MOST + 1):
        total(np.array([float(k)]), 1.0)
    total(np.array([float(MOST)]), 1.0)
    assert len(calls) == MOST + 1
    total(np.array([0.0]), 1.0)
    assert len(calls) == MOST + 2
