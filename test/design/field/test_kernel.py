# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled steel curve: field, slope and energy of one table agree."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.design.field.kernel import steel_at
from valve_twin.design.field.model import steel_table
from valve_twin.design.materials import Steel

TABLE = ((0.0, 60.0, 120.0, 318.0, 796.0, 3183.0, 15900.0, 79600.0),
         (0.0, 0.06, 0.2, 0.865, 1.331, 1.60, 1.905, 2.165))  # fmt: skip


@pytest.mark.parametrize("steel", [Steel(), Steel(table_h=TABLE[0], table_b=TABLE[1])])
def test_energy_and_slope_belong_to_the_field(steel):
    table, per_tesla = steel_table(steel)
    b = np.linspace(0.0, 2.6, 1301)
    h, slope, energy = np.array([steel_at(table, per_tesla, float(x)) for x in b]).T
    assert (slope > 0.0).all()
    step = b[1]
    middle = slice(1, -1)
    assert np.gradient(energy, step)[middle] == pytest.approx(h[middle], rel=2e-2, abs=1.0)
    assert np.diff(energy) == pytest.approx(step * 0.5 * (h[1:] + h[:-1]), rel=2e-2)
    assert np.diff(h) == pytest.approx(step * 0.5 * (slope[1:] + slope[:-1]), rel=5e-2)


def test_the_table_follows_the_closed_form_and_ends_in_vacuum():
    steel = Steel()
    table, per_tesla = steel_table(steel)
    h = np.geomspace(50.0, 1e5, 60)
    found = [steel_at(table, per_tesla, float(b))[0] for b in steel.flux_density(h)]
    assert found == pytest.approx(h, rel=0.01)
    ends = [steel_at(table, per_tesla, b)[0] for b in (4.0, 4.5)]
    assert ends[1] - ends[0] == pytest.approx(0.5 / (4e-7 * np.pi), rel=1e-9)
