# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The estimator `dimensions` on valves whose solenoid wears."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.quantity import describe, replaced
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, MaskCounts
from valve_twin.core.valves.designed import Numbers
from valve_twin.core.valves.double_solenoid import MODEL
from valve_twin.core.valves.double_solenoid.dimensions.estimate import judged
from valve_twin.core.valves.double_solenoid.dimensions.fit import DimensionFit
from valve_twin.core.valves.double_solenoid.dimensions.judge import NONE, REFERENCE_CYCLES
from valve_twin.core.valves.double_solenoid.dimensions.published import DRIFT, ESTIMATOR
from valve_twin.core.valves.double_solenoid.dimensions.table import options_of
from valve_twin.core.valves.double_solenoid.numbers import DoubleSolenoidNumbers
from valve_twin.core.valves.kit.outcome import Evidence, conclude
from valve_twin.core.valves.registry import complete_options, get_simulation

SCATTER = {f"scatter.{n}": 0.002 for n in ("friction", "resistance_a", "resistance_b")}


BRANCHES = {"eddies.gain_1": 0.0121, "eddies.time_1": 4.57e-4,
            "eddies.gain_2": 0.0346, "eddies.time_2": 8.58e-3}  # fmt: skip


def options_for(plant, wear, **given):
    names = [d.name for d in describe(DoubleSolenoidNumbers)]
    numbers = {n: attrgetter(n)(plant) for n in names}
    chosen = {**options_of(wear), "estimators": ("balance", ESTIMATOR), **given}
    return complete_options(MODEL, {**numbers, **chosen})


def cycles_of(plant, count, seed):
    config = replace(configure(get_simulation("double_solenoid"), SCATTER), plant=plant)
    for k, block in enumerate(simulate_cycles(config, count + 1, seed)):
        if k:
            yield Cycle(k, config.period_s, to_frames(block))


def follow(options, plant, count, seed, memory=None):
    """Return the last estimates of some cycles, and what is remembered of them."""
    memory = memory or Memory.empty()
    for cycle in cycles_of(plant, count, seed):
        number = len(memory.of("balance")) + 1
        done, memory = estimate_cycle(MODEL, options, replace(cycle, number=number), memory)
    return {e.estimator: e for e in done}, memory


@pytest.fixture(scope="module")
def new(solenoid):
    """Return options and memory of a valve whose first cycles are known."""
    options = options_for(solenoid.plant, solenoid.wear)
    return options, follow(options, solenoid.plant, REFERENCE_CYCLES, 1)[1]


def later(new, plant, seed):
    """Return the last estimates of as many cycles of another plant."""
    options, memory = new
    return follow(options, plant, REFERENCE_CYCLES, seed, memory)[0]


def named(estimate):
    return {p.name.removeprefix(DRIFT): p for p in estimate.parameters
            if p.name.startswith(DRIFT) and np.isfinite(p.value)}  # fmt: skip


@pytest.mark.no_cover
@pytest.mark.parametrize(("name", "size"), [("gap_b", 0.06), ("rim_a", 0.2), ("turns_a", 0.03)])
def test_the_worn_dimension_is_named(solenoid, new, name, size):
    found = later(new, solenoid.worn(name, size), 2)
    told = found[ESTIMATOR]
    assert told.status is EstimateStatus.ACCEPTED
    assert list(named(told)) == [name], told.reason
    of = named(told)[name]
    assert of.lower_95 <= size <= of.upper_95, told.reason
    assert of.value == pytest.approx(size, rel=0.1)
    assert told.reason.startswith(f"{name} has drifted by")
    (guard,) = found["balance"].guards
    assert not guard.passed
    assert guard.reason == told.reason


@pytest.mark.no_cover
def test_a_spring_that_has_set_is_named(solenoid, new):
    weak = replaced(solenoid.plant, {"preload_1": solenoid.plant.preload_1 - 1.0})
    told = later(new, weak, 4)[ESTIMATOR]
    assert list(named(told)) == ["spring_1"], told.reason
    assert named(told)["spring_1"].value == pytest.approx(1.0, rel=0.05)


@pytest.mark.no_cover
def test_more_friction_names_no_dimension(solenoid, new):
    rough = replaced(solenoid.plant, {"friction": 1.3 * solenoid.plant.friction})
    found = later(new, rough, 6)
    assert not named(found[ESTIMATOR])
    assert found[ESTIMATOR].reason == "no dimension has drifted"
    assert found["balance"].guards[0].passed


@pytest.mark.no_cover
@pytest.mark.parametrize("share", [0.93, 1.05])
def test_another_supply_names_no_dimension(solenoid, new, share):
    other = replaced(solenoid.plant, {"supply_voltage": share * solenoid.plant.supply_voltage})
    told = later(new, other, 9)[ESTIMATOR]
    assert told.reason == "no dimension has drifted"
    known = {p.name: p.value for p in told.parameters}
    assert known["cycle.supply"] == pytest.approx(share - 1.0, abs=5e-3)


def test_maintenance_renews_what_is_compared(solenoid):
    of = np.array([0.0, 0.0, 0.0, 0.0, 0.1, *np.zeros(6)])
    fit = DimensionFit(of, np.diag(np.full(len(of), 1e-6)), np.zeros(3), 1.0)
    rng = np.random.default_rng(1)
    names = tuple(w.name for w in solenoid.wear)
    frames = next(cycles_of(solenoid.plant, 1, 1)).frames
    earlier: list[Estimate] = []
    said = {}
    for number in range(1, 41):
        part = (number > 16) * of + 1e-3 * rng.standard_normal(len(of))
        since = 0 if number < 30 else 17  # told late, of a cycle that is over
        cycle = Cycle(number, 1e-4, frames, since=since)
        values, drift, line = judged(replace(fit, values=part), names, earlier, cycle)
        said[number] = drift.name, line, {p.name: p.value for p in values}.get("first.cycle")
        estimate = conclude("double_solenoid", ESTIMATOR, cycle, values,
                            (EstimateStatus.ACCEPTED, line), Evidence(MaskCounts(1)))  # fmt: skip
        earlier.append(estimate)
    assert said[8] == (NONE, "no dimension has drifted", 1.0)
    assert said[29][0] == "gap_a"
    assert said[29][2] == 1.0
    assert {said[n] for n in range(30, 41)} == {(NONE, "no dimension has drifted", 17.0)}


def test_without_its_lists_the_estimator_says_what_to_do(solenoid):
    options = options_for(solenoid.plant, solenoid.wear, dimension_names=())
    found, _ = follow(options, solenoid.plant, 1, 7)
    assert found["balance"].status is EstimateStatus.ACCEPTED
    assert found[ESTIMATOR].status is EstimateStatus.REFUSED
    assert "design export --faults" in found[ESTIMATOR].reason


@pytest.mark.no_cover
def test_assumed_curves_of_one_coil_are_not_enough(solenoid):
    plain = {"map_current": (), "map_position": (), "map_coenergy": ()}
    options = options_for(replaced(solenoid.plant, plain), solenoid.wear)
    told = follow(options, replaced(solenoid.plant, plain), 1, 8)[0][ESTIMATOR]
    assert told.status is EstimateStatus.REFUSED
    assert "needs a map of both coils" in told.reason


def test_what_a_cycle_tells_apart(solenoid):
    shared = {n: getattr(solenoid.plant, n) for n in DoubleSolenoidNumbers.__dataclass_fields__}
    found = MODEL.told_apart(Numbers(shared, {}), solenoid.wear)
    assert found.causes[:2] == ("gap_a", "gap_b")
    at = {n: k for k, n in enumerate(found.causes)}
    assert found.leaves[at["spring_1"], at["spring_2"]] == 1.0  # opposite directions
    assert 0.0 < found.leaves[at["gap_a"], at["turns_a"]] < 1.0
    assert found.leaves.diagonal() == pytest.approx(0.0, abs=1e-9)
    assert all(len(group) > 1 for group in found.together)


def test_dynamics_that_are_not_the_valves_are_refused_with_the_reason(solenoid, capfd):
    """A zero column became NaN, at which LAPACK writes to stdout and numpy raises."""
    lossy = replaced(solenoid.plant, BRANCHES)
    found, _ = follow(options_for(solenoid.plant, solenoid.wear), lossy, 1, 3)
    told = found[ESTIMATOR]
    assert told.status is EstimateStatus.REFUSED
    assert "it asks for a friction of -" in told.reason
    assert found["balance"].status is EstimateStatus.PARTIAL
    assert capfd.readouterr().out == ""
