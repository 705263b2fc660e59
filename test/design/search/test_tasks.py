# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Evaluation of one design as a task."""

from __future__ import annotations

import pickle

import pytest

from valve_twin.design.chain import Fidelity
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid
from valve_twin.design.search import tasks
from valve_twin.design.search.tasks import DesignTask, evaluate_task, lost_design, surface_of
from valve_twin.design.search.variables import changed

QUICK = Fidelity(MapGrid(currents=4, positions=4, fine=0.3), fine=0.3, step=4e-4)


@pytest.mark.slow
def test_a_task_travels_and_gives_the_figures_of_the_chain(monkeypatch):
    task = DesignTask("a", DoubleStroke(), {"turns": 375.0}, given=QUICK)
    found = evaluate_task(pickle.loads(pickle.dumps(task)))
    assert found.error == ""
    assert found.values == {"turns": 375.0}
    f = found.figures
    assert 2e-3 < f["rise_s"] < f["settling_s"] < 0.01
    assert f["overshoot"] < 0.05
    assert f["error"] < 0.02
    assert f["heating"] == pytest.approx(f["loss"] / (12.0 * surface_of(DoubleStroke())), rel=0.4)
    assert f["current_pole_1_hz"] < f["current_pole_2_hz"]
    assert len(found.curves["force"]) == len(found.curves["flux"]) == 20
    assert pickle.loads(pickle.dumps(found)) == found
    monkeypatch.setattr(tasks, "compute_design", None)  # springs ask for no new fields
    softer = changed(DoubleStroke(), {"valve.spring_rate": 5e3, "valve.horizon": 20.0})
    again = evaluate_task(DesignTask("b", softer, given=QUICK))
    assert again.error == ""
    assert again.figures["loss"] < f["loss"]
    assert again.curves == found.curves


def test_power_reaches_the_map(monkeypatch):
    asked = []

    def fields_of(solenoid, fidelity, like):
        asked.append(fidelity.grid.largest_current)
        raise ValueError

    monkeypatch.setattr(tasks, "_fields_of", fields_of)
    for power in (15.0, 30.0):
        strong = changed(DoubleStroke(), {"valve.power": power})
        evaluate_task(DesignTask("a", strong, given=QUICK))
    assert asked == [3.0, 4.0]


def test_only_a_sensitivity_stretches_the_mesh_of_what_it_changes(monkeypatch):
    asked = []

    def fields_of(solenoid, fidelity, like):
        asked.append(like)
        raise ValueError

    monkeypatch.setattr(tasks, "_fields_of", fields_of)
    start = DoubleStroke()
    changes = {"gap_ratio": 0.2, "valve.preload": 10.0}
    for name in ("evened", "search"):
        evaluate_task(DesignTask("a", changed(start, changes), changes, "", name, like=start))
    assert asked == [start, None]


def test_a_broken_geometry_is_a_line_with_its_amount_and_costs_nothing():
    found = evaluate_task(DesignTask("a", DoubleStroke(turns=500)))
    assert found.error.startswith("winding height = 0.0118516: must be 0 to 0.0095")
    assert found.broken == pytest.approx(0.0118516 / 0.0095 - 1.0, rel=1e-4)
    assert found.cpu_s == 0.0


def test_a_valve_that_takes_no_design_is_a_line():
    found = evaluate_task(DesignTask("a", DoubleStroke(), valve="first_order"))
    assert "takes no designed solenoid" in found.error


def test_a_design_whose_process_died_is_a_line():
    task = DesignTask("a", DoubleStroke(), {"turns": 375.0})
    assert lost_design(task, "its process was killed").error == "its process was killed"


def test_the_surface_is_that_of_a_cylinder():
    # yoke 24.5 mm, half length 27 mm
    assert surface_of(DoubleStroke()) == pytest.approx(0.01208, rel=0.01)
