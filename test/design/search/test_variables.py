# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Numbers that a search changes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.search.variables import changed, dimensions, key_of, make_variable, value_of


@given(st.floats(0.0, 1.0))
@pytest.mark.parametrize(("low", "high"), [(1e-7, 1e-4), (2.0, 3.0), (-1.0, 1.0)])
def test_shares_of_the_way_and_values_belong_to_each_other(low, high, share):
    from valve_twin.design.search.variables import Variable

    variable = Variable("x", low, high)
    assert low <= variable.at(share) <= high
    assert variable.share(variable.at(share)) == pytest.approx(share, abs=2e-5)


def test_whole_numbers_stay_whole_and_wide_ranges_are_logarithmic():
    start = DoubleStroke()
    turns = make_variable(start, "turns", 300, 400)
    assert turns.at(0.333) == 333.0
    effort = make_variable(start, "valve.effort", 1e-8, 1e-4)
    assert effort.at(0.5) == pytest.approx(1e-6)


def test_a_changed_design_keeps_its_stroke_unless_that_is_changed():
    start = DoubleStroke()
    found = changed(start, {"gap_ratio": 0.2, "turns": 350.0, "valve.preload": 12.0})
    assert found.stroke == pytest.approx(start.stroke)
    assert (found.turns, found.valve.preload) == (350, 12.0)
    assert isinstance(found.turns, int)
    assert changed(start, {"stroke_ratio": 0.5}).stroke == pytest.approx(0.5 * start.gap)


def test_designs_that_agree_in_six_digits_are_one():
    assert key_of({"b": 1.0, "a": 0.12345678}) == key_of({"a": 0.1234570001, "b": 1.0})
    assert key_of({"a": 0.12345}) != key_of({"a": 0.12346})


def test_the_dimensions_leave_out_what_comes_in_sizes():
    names = dimensions(DoubleStroke())
    assert {"armature_radius", "turns", "spool_mass"} <= set(names)
    assert not {"wire", "wire_grade", "wire_overall", "steel.conductivity"} & set(names)
    assert all(value_of(DoubleStroke(), name) for name in names)


@pytest.mark.parametrize(
    ("name", "low", "high", "said"),
    [
        ("gap_ration", 0.1, 0.2, "'gap_ration' is no number .*did you mean 'gap_ratio'"),
        ("gap_ratio", 0.3, 0.2, "gap_ratio: bounds 0.3 to 0.2: the lower must be below"),
        ("gap_ratio", 0.001, 0.2, "gap_ratio: bounds 0.001 to 0.2: must lie in 0.02 to 1"),
    ],
)
def test_bad_bounds_are_one_line(name, low, high, said):
    with pytest.raises(ValueError, match=said):
        make_variable(DoubleStroke(), name, low, high)
