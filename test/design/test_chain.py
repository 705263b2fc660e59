# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From a geometry to its closed loop, on a coarse mesh."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import pytest

from valve_twin.core.valves.designed import SCALED, Surroundings, find_designable
from valve_twin.design import chain
from valve_twin.design.geometry import DoubleStroke
from valve_twin.design.map import MapGrid, compute_map

GRID = MapGrid(currents=4, positions=4, fine=0.3)


QUICK = chain.Fidelity(GRID, fine=0.3, step=4e-4)
pytestmark = pytest.mark.usefixtures("transients_once", "maps_once")


def test_a_geometry_becomes_steps_of_its_valve():
    seen = []
    found = chain.evaluate(
        DoubleStroke(),
        find_designable(),
        robust=True,
        fidelity=QUICK,
        advance=lambda: seen.append(1),
    )
    assert len(seen) == 32
    assert len(found.robust) == 2 ** len(SCALED)
    assert found.margin > 0.0
    of_current, of_force = found.dynamics
    assert of_current.fast_gain > 1.0 > of_force.fast_gain
    for share in chain.STEPS:
        of = found.loops[share]
        assert 1e-3 < of.rise_s < 0.012
        assert of.overshoot < 0.05
        assert of.settling_s < 0.012
    assert found.loops[1.0].loss > found.loops[0.1].loss
    scaled = {case[1.0].loss for case in found.robust}
    assert min(scaled) < found.loops[1.0].loss < max(scaled)


def test_figures_of_several_draws_are_their_means_and_a_rise_lies_between_samples():
    design, model = DoubleStroke(), find_designable()
    computed = chain.compute_design(design, fidelity=QUICK)
    numbers = model.of_design(computed[0])
    of = chain.evaluate(design, model, fidelity=replace(QUICK, draws=3), computed=computed)
    each = [model.loop(numbers, 0.25, {}, 0.0, k) for k in range(3)]
    mean = of.loops[0.25]
    assert len({one.overshoot for one in each}) == 3  # the draws are others
    for name in ("overshoot", "settling_s", "graded_s", "error", "loss"):
        assert getattr(mean, name) == pytest.approx(sum(getattr(o, name) for o in each) / 3)
    assert mean.rise_s == pytest.approx(sum(o.rise_s for o in each) / 3, abs=1e-4)
    assert mean.rise_s % 1e-4 > 1e-7
    assert chain.evened(each[:1]) is each[0]


def test_half_the_power_slows_the_largest_step_and_changes_no_field():
    design = DoubleStroke()
    curves = compute_map(design.section(), GRID)
    designed, _ = chain.compute_design(design, curves, QUICK)
    weak = replace(designed, around=replace(design.valve, power=2.0))
    model = find_designable()
    usual, found = model.of_design(designed), model.of_design(weak)
    assert usual.shared == found.shared
    slow = model.loop(found, 1.0, {})
    assert slow.rise_s > model.loop(usual, 1.0, {}).rise_s
    assert max(slow.rows[2][1]["A"]) < 1.2 * (2.0 / design.winding().resistance) ** 0.5


def test_branches_that_grow_are_fitted_to_steps_on_the_mesh_of_their_field(monkeypatch):
    monkeypatch.setattr(import_module("valve_twin.design.dynamics.replay"), "FOLLOWED_S", 0.012)
    grids: list[MapGrid] = []

    def noted(section, grid, advance):
        grids.append(grid)
        return compute_map(section, grid, advance)

    monkeypatch.setattr(chain, "compute_map", noted)
    design, own = DoubleStroke(), replace(QUICK, grid=replace(GRID, skin=QUICK.skin))
    once, _ = chain.compute_design(design, fidelity=own, form="growing")
    again, _ = chain.compute_design(design, fidelity=QUICK, form="growing")
    assert [(of.fine, of.skin) for of in grids] == [(0.3, 1e-3), (0.3, 1.0), (0.3, 1e-3)]
    for of in (once, again):
        gain_1, time_1, gain_2, time_2, growth = of.eddies
        assert min(gain_1, gain_2, growth) > 0.0
        assert time_1 < time_2
    assert find_designable().of_design(once).shared["eddies.growth"] == once.eddies[4]


@pytest.mark.parametrize(
    ("changes", "end"),
    [
        ({}, 3.0),  # power allows 2.78 A
        ({"turns": 260}, 3.6),  # 3.51 A
        ({"valve": Surroundings(power=22.0)}, 3.4),  # 3.36 A
        ({"valve": Surroundings(power=100.0)}, 1700.0 / 375.0),  # 7.2 A
    ],
)
def test_a_map_ends_where_the_power_does(changes, end):
    found = chain.reaching(GRID, replace(DoubleStroke(), **changes))
    assert found == replace(GRID, largest_current=end)


def test_the_map_of_few_turns_leaves_the_force_that_their_power_gives():
    design = DoubleStroke(turns=260)
    model, of = find_designable(), chain.FIDELITIES["search"]
    designed, _ = chain.compute_design(design, fidelity=of)
    by_power = (design.valve.power / design.winding().resistance) ** 0.5
    assert designed.largest_current == by_power
    capped = replace(designed, curves=compute_map(design.section(), of.grid))
    margins = [model.force_margin(model.of_design(each)) for each in (designed, capped)]
    assert margins == pytest.approx([66.0, 50.9], abs=1.0)


def test_current_that_the_power_allows_and_no_step_gets_is_told():
    designed, _ = chain.compute_design(DoubleStroke(), fidelity=QUICK)
    assert chain.short_of_current(designed) == ""
    low = replace(designed, around=Surroundings(span=1.5))
    assert "valve.bias + valve.span = 2 A: the steps get no more" in chain.short_of_current(low)
    strong = replace(designed, around=Surroundings(power=30.0))
    said = chain.short_of_current(strong)
    assert said.startswith("the map ends at 3 A, below the 3.93 A that valve.power = 30 W allows")


def test_a_map_of_another_section_is_refused():
    curves = compute_map(DoubleStroke().section(), GRID)
    with pytest.raises(ValueError, match="the map was computed of another section"):
        chain.compute_design(DoubleStroke(gap_ratio=0.2), curves)
