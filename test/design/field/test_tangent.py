# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Factors that serve more than one tangent: fewer of them, the same fields."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.field import Trapezoid, make_model, run_transient, solve_field, tangent
from valve_twin.design.field.tangent import Tangent
from valve_twin.design.geometry import DoubleStroke


@pytest.fixture(scope="module")
def coarse():
    return make_model(DoubleStroke().section(), 0.3)


@pytest.fixture
def factorised(monkeypatch):
    """Collect the factors that are made."""
    made, make = [], tangent._factorised

    def counted(matrix):
        made.append(make(matrix))
        return made[-1]

    monkeypatch.setattr(tangent, "_factorised", counted)
    return made


def test_a_transient_needs_half_the_factors_and_finds_the_same(coarse, factorised, monkeypatch):
    time_s, currents = Trapezoid(slope=1e-3, hold=1e-3, step=2.5e-4).record(2)
    kept = run_transient(coarse, time_s, currents)
    few = len(factorised)
    monkeypatch.setattr(tangent, "_MANY", -1)
    monkeypatch.setattr(tangent, "_MOST", 0)  # every tangent gets its own
    own = run_transient(coarse, time_s, currents)
    assert 2 * few < len(factorised) - few
    assert kept.force == pytest.approx(own.force, abs=1e-7)
    assert kept.flux == pytest.approx(own.flux, abs=1e-11)


def test_slopes_over_currents_by_factors_of_another_field_are_those_by_own(coarse, factorised):
    near = Tangent(coarse)
    first = solve_field(coarse, (2.0, 0.5), 0.3e-3, tangent=near)
    few = len(factorised)
    again = solve_field(coarse, (2.02, 0.5), 0.3e-3, first.potential, near)
    assert len(factorised) == few
    own = solve_field(coarse, (2.02, 0.5), 0.3e-3)
    assert again.inductance == pytest.approx(own.inductance, rel=1e-6)
    assert again.inductance[0, 1] == pytest.approx(again.inductance[1, 0], rel=1e-6)
    assert again.force_slope == pytest.approx(own.force_slope, rel=1e-5)
    assert again.coenergy == pytest.approx(own.coenergy, rel=1e-12)


def test_a_tangent_that_differs_much_gets_factors_of_its_own(coarse, factorised):
    held = Tangent(coarse)
    right = np.ones(coarse.unknowns)
    entries = np.zeros(len(coarse.rows))
    entries[coarse.rows == np.repeat(np.arange(coarse.unknowns), np.diff(coarse.columns))] = 1.0
    held.take(entries)
    held.solve(right, 1e-4)
    uneven = entries * np.geomspace(1.0, 1e6, len(entries))
    held.take(uneven)
    found = held.solve(right, 1e-4)
    assert len(factorised) == 2
    diagonal = uneven[uneven > 0.0]
    assert found == pytest.approx(right / diagonal, rel=1e-9)
