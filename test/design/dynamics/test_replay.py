# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A step in the moving field: slow motion is static, a short record asks for its signals."""

from __future__ import annotations

import numpy as np
import pytest

from valve_twin.core.physics.coenergy import linear_map
from valve_twin.core.valves.designed import Loop
from valve_twin.design.dynamics import replay, step_record
from valve_twin.design.dynamics.replay import evened
from valve_twin.design.field import make_model, static_force
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid, compute_map
from valve_twin.design.materials import Steel

FINE = 0.3
TIME_S = np.arange(0.0, 0.0301, 1e-3)
PART = np.sin(np.pi * TIME_S / 0.03) ** 2


def loop(force, linked=(0.04, 0.04), **without):
    rows = {
        "current [A]": {"A": 1.0 + PART, "B": 1.0 - 0.5 * PART},
        "force [N]": {"F": force},
        "flux linkage [mWb]": {
            "A": 1e3 * np.full(31, linked[0]),
            "B": 1e3 * np.full(31, linked[1]),
        },
        "position [mm]": {"x": 0.4 * PART, "setpoint": PART},
    }
    shown = tuple((k, v) for k, v in rows.items() if k not in without)
    return Loop(TIME_S, shown, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_without_eddy_currents_the_field_has_the_static_force():
    section = DoubleStroke(steel=Steel(conductivity=1.0)).section()
    curves = compute_map(section, MapGrid(currents=5, positions=5, fine=FINE))
    currents = np.column_stack([1.0 + PART, 1.0 - 0.5 * PART])
    linked = curves.flux(currents[:1], np.zeros(1))[0]
    static = curves.force(currents, 0.4e-3 * PART)
    found = replay(section, curves, loop(0.9 * static, linked), FINE)
    means = evened(currents)
    assert found.static == pytest.approx(curves.force(means, 0.4e-3 * PART), abs=1e-6)
    same_mesh = static_force(make_model(section, FINE, 1e-3), means, 0.4e-3 * PART)
    assert found.field == pytest.approx(same_mesh, abs=1e-3)
    assert found.lumped == pytest.approx(evened(0.9 * static))
    assert found.fit < found.without
    assert found.error == pytest.approx(np.sqrt(np.mean((found.lumped - found.field) ** 2)))


def test_eddy_currents_delay_the_force():
    section = DoubleStroke().section()
    curves = compute_map(section, MapGrid(currents=4, positions=4, fine=FINE))
    found = replay(section, curves, loop(np.zeros(len(TIME_S))), FINE)
    assert np.argmax(found.field) > np.argmax(found.static)
    assert found.refitted > found.without


def test_a_start_beyond_the_map_begins_with_the_measured_current():
    section = DoubleStroke(steel=Steel(conductivity=1.0)).section()
    curves = compute_map(section, MapGrid(currents=4, positions=4, fine=FINE))
    model = make_model(section, FINE, 1e-3)
    within, beyond = (
        step_record(model, curves, loop(PART, (0.04, b))).currents for b in (0.02, -0.05)
    )
    means = evened(np.column_stack([1.0 + PART, 1.0 - 0.5 * PART]))
    assert beyond[0] == pytest.approx(means[1])
    assert within[1:] == pytest.approx(beyond[1:])
    assert abs(within[0, 1] - beyond[0, 1]) > 0.1


def test_missing_signals_are_named():
    section = DoubleStroke().section()
    curves = linear_map(0.04, -8e-3, 2.5e-3, 4, 4)
    with pytest.raises(ValueError, match="the loop shows no 'force"):
        replay(section, curves, loop(PART, **{"force [N]": 1}))


def test_what_alternates_from_one_sample_to_the_next_goes():
    values = 1.0 + 0.1 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    assert evened(values)[1:] == pytest.approx(np.ones(5))
