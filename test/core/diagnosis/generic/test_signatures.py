# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Signatures of the faults of any valve: where they come from, and what they tell apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from valve_twin.core.diagnosis.config import OF_ANY_VALVE
from valve_twin.core.diagnosis.detection import detect
from valve_twin.core.diagnosis.generic.faults import FAULTS
from valve_twin.core.diagnosis.generic.features import (
    FEATURE_SET,
    Record,
    cycle_features,
    feature_set,
)
from valve_twin.core.diagnosis.generic.motion import Motion
from valve_twin.core.diagnosis.generic.signatures import derive_table, own_table, signatures_of
from valve_twin.core.diagnosis.isolability import isolability
from valve_twin.core.types import ParameterValue
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
    followed = get_model(name).feature_set
    assert table.features == followed.names
    assert (table.gains, table.slopes) == (followed.gains, followed.slopes)
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


COARSE = Motion(0.5, 1e-3, 1e-3, (0.0, 60.0, 76.0, 140.0, 154.0, 220.0), (0, 0, 1.0, 1.0, 0, 0))
"""Strokes of an on/off valve in 8 and 7 s, sampled every 0.5 s."""


def coarse(late):
    """Return features of cycles (N, F) whose strokes (N, 2) come so many samples later."""
    own, followed = COARSE.positions(), get_model("first_order").feature_set
    t, rows = np.arange(len(own), dtype=np.float64), []
    for cycle, (up, down) in enumerate(late):
        chance = np.random.default_rng([5, cycle])
        y = np.interp(t - np.where(t < 110.0, up, down), t, own)
        y = np.round((y + 1e-3 * chance.standard_normal(len(y))) / 1e-3) * 1e-3
        found = cycle_features(Record(y, own, COARSE.period_s, np.zeros((len(y), 0))))
        rows.append(followed.vector(ParameterValue(n, v) for n, v in found.items()))
    return np.array(rows)


@pytest.mark.no_cover
def test_two_cycles_with_a_stroke_one_sample_later_are_no_fault():
    late = np.random.default_rng(2).uniform(-0.1, 0.1, (60, 2))
    table, cycles = own_table("first_order", COARSE), np.arange(1, 61)
    late[50:52, 1] += 1.0
    assert not detect(cycles, coarse(late), table, OF_ANY_VALVE).findings
    late[50:] += 4.0
    assert detect(cycles, coarse(late), table, OF_ANY_VALVE).findings[0].onset == 51


def test_what_the_logger_does_not_resolve_is_scatter_of_sound_cycles():
    table = own_table("first_order", COARSE)
    place = table.features.index("lag_up")
    assert table.least()[place] == pytest.approx(0.5 / 6.0**0.5, rel=0.35)
