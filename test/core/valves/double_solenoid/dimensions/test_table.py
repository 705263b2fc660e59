# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Changes of the coenergy as options, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.quantity import replaced
from valve_twin.core.valves.double_solenoid.dimensions.table import options_of, table_of
from valve_twin.core.valves.double_solenoid.parameters import DoubleSolenoidOptions


def test_options_hold_every_change(solenoid):
    table = table_of(replaced(DoubleSolenoidOptions(), options_of(solenoid.wear)))
    assert table.names == tuple(w.name for w in solenoid.wear)
    currents, x = np.array([[1.2, 0.4], [9.0, 0.1]]), np.array([3e-4, -5e-3])
    inside = np.array([[1.2, 0.4], [3.0, 0.1]]), np.array([3e-4, -1e-3])
    for k, of in enumerate(solenoid.wear):
        assert table.forces(currents, x)[k] == pytest.approx(
            of.change.force(*inside), rel=1e-6, abs=1e-7
        )
        for coil in (0, 1):
            found = table.fluxes(currents, x, coil)[k]
            assert found == pytest.approx(of.change.flux(*inside)[:, coil], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"dimension_names": ()}, "design export --faults writes"),
        ({"dimension_names": ("gap",)}, "'gap' must be one of gap_a"),
        ({"dimension_current": (1.0, 0.5)}, "dimension_current has 2 values: must be 2 or more"),
        ({"dimension_coenergy": (1.0,)}, "dimension_coenergy has 1 values: must be 3528"),
    ],
)
def test_lists_that_do_not_fit_are_named(solenoid, changes, said):
    options = replaced(DoubleSolenoidOptions(), options_of(solenoid.wear[:1]))
    with pytest.raises(ValueError, match=said):
        table_of(replace(options, **changes))


def test_what_is_no_dimension_or_stands_elsewhere_is_refused(solenoid):
    one, other = solenoid.wear[:2]
    with pytest.raises(ValueError, match="no worn dimension"):
        options_of([])
    with pytest.raises(ValueError, match="'yoke': must be one of gap_a"):
        options_of([replace(one, name="yoke")])
    far = replace(other.change, positions=2.0 * other.change.positions)
    with pytest.raises(ValueError, match="'gap_b' stands on other nodes than 'gap_a'"):
        options_of([one, replace(other, change=far)])
