# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signatures of the faults of any valve: where they come from, and what they tell apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from valve_twin.core.diagnosis.generic.faults import FAULTS
from valve_twin.core.diagnosis.generic.features import FEATURE_SET, feature_set
from valve_twin.core.diagnosis.generic.signatures import derive_table, signatures_of
from valve_twin.core.diagnosis.isolability import isolability
from valve_twin.core.valves.registry import get_model, model_names


def table_of(model):
    table = signatures_of(model)
    assert table is not None
    return table


OF_ANY = [n for n in model_names() if get_model(n).feature_set.of_any_valve]
DERIVED = ("first_order", "cycle", "hammerstein", "hydraulic", "integrator")
SHIPPED = [n for n in OF_ANY if not n.startswith(DERIVED)]


def test_a_model_with_signatures_keeps_its_own():
    own = [get_model(n) for n in model_names() if n not in OF_ANY]
    assert own
    for model in own:
        assert signatures_of(model) is model.signatures()


@pytest.mark.no_cover
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_signatures_fit_the_features_and_hold_every_fault(name):
    table = table_of(get_model(name))
    assert table.features == get_model(name).feature_set.names
    assert set(FAULTS) <= set(table.faults)
    assert np.isfinite(table.changes()).all()


@pytest.mark.no_cover
def test_a_valve_without_a_simulation_has_them_from_a_made_up_motion():
    model = SimpleNamespace(
        name="nowhere", feature_set=FEATURE_SET, signatures=lambda: None, simulation=lambda: None
    )
    table = table_of(model)
    assert table_of(model) is table
    assert {*FAULTS, "saturation"} == set(table.faults)
    found = isolability(table)
    apart = found.distance[~np.eye(len(found.faults), dtype=bool)]
    assert np.median(apart) > 10.0
    assert sum(len(c) > 1 for c in found.classes) <= 1


def test_a_model_may_leave_out_which_moves_were_not_followed():
    followed = feature_set(("unfollowed",))
    model = SimpleNamespace(
        name="elsewhere", feature_set=followed, signatures=lambda: None, simulation=lambda: None
    )
    table = table_of(model)
    assert table.features == followed.names
    assert {"slow", "sensor_offset", "lost_motion"} <= set(table.faults)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_signatures_are_what_is_derived(name):
    model = get_model(name)
    again = derive_table(model)
    shipped = table_of(model)
    assert again.faults == shipped.faults
    scale = np.sqrt(np.diag(np.array(shipped.covariance))) + np.array(shipped.floor)
    assert (again.changes() / scale) == pytest.approx(shipped.changes() / scale, rel=0.1, abs=1.0)
