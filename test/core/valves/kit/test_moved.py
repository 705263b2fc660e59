# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Tolerances of constants by estimating again: intervals, reasons, what is exact stays exact."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from valve_twin.core.quantity import quantity
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.simulation.settings import configure
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, ParameterValue
from valve_twin.core.valves.interface import ModelOptions
from valve_twin.core.valves.kit.moved import moves_of, with_tolerances
from valve_twin.core.valves.kit.tolerances import tolerance_section
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation


@dataclass(frozen=True, slots=True)
class Numbers:
    a: float = quantity(2.0, "kg", "Mass", 0.0, 10.0)
    b: float = quantity(0.0, "m", "Seat", -1.0, 1.0)


Relative = tolerance_section("Relative", __name__, Numbers, {"a": 0.03, "b": 0.1})
Absolute = tolerance_section("Absolute", __name__, Numbers, {"a": 0.03, "b": 0.1}, absolute=True)


@dataclass(frozen=True, slots=True)
class Options(Numbers, ModelOptions):
    estimators: tuple[str, ...] = ("one", "features")
    tolerances: object = field(default_factory=Relative)


def said(options):
    """Return an estimate with x = 3 a + 4 b, y = 5, and one of another estimator."""
    assert options.estimators in (("one", "features"), ("one",))
    values = (ParameterValue("x", 3.0 * options.a + 4.0 * options.b), ParameterValue("y", 5.0))
    made = Estimate(
        model="m", estimator="one", cycle=1, start_ns=0, end_ns=1, parameters=values,
        status=EstimateStatus.ACCEPTED, reason="accepted",
    )  # fmt: skip
    return made, replace(made, estimator="features")


def test_a_relative_tolerance_of_a_constant_that_is_0_is_none():
    moves = moves_of(Options(), absolute=False)
    assert moves.names == ("a",)
    assert moves.values[0] == pytest.approx((2.0 + 0.06 / np.sqrt(3.0),))


def test_a_place_is_moved_to_both_sides_inside_its_limits():
    by = 0.1 / np.sqrt(3.0)
    assert moves_of(Options(tolerances=Absolute()), absolute=True).values[1] == (
        pytest.approx((by, -by))
    )
    at_its_limit = Options(b=1.0, tolerances=Absolute())
    assert moves_of(at_its_limit, absolute=True).values[1] == pytest.approx((1.0 - by,))
    heaviest = Options(a=10.0)
    assert moves_of(heaviest, absolute=False).values[0] == pytest.approx(
        (10.0 - 0.3 / np.sqrt(3.0),)
    )


def test_what_moves_a_value_on_one_side_only_widens_its_interval():
    def stopped(options):
        one = said(options)[0]
        x, y = one.parameters
        x = replace(x, value=3.0 + min(options.b, 0.0))  # nothing runs into what lies higher
        return (replace(one, parameters=(x, y)),)

    options = Options(tolerances=Absolute())
    (x, _) = with_tolerances(options, stopped, ("one",), absolute=True)[0].parameters
    assert x.upper_95 - x.value == pytest.approx(1.959964 * 0.1 / np.sqrt(3.0), rel=1e-6)
    assert x.reason == "limited by the tolerance of b (100 %)"


def test_the_interval_holds_what_the_constants_change_and_the_reason_names_them():
    options = Options(tolerances=Absolute())
    one, other = with_tolerances(options, said, ("one",), absolute=True)
    x, y = one.parameters
    half = 1.959964 * np.hypot(3.0 * 0.03, 4.0 * 0.1) / np.sqrt(3.0)
    assert x.upper_95 - x.value == pytest.approx(half, rel=1e-6)
    assert x.value - x.lower_95 == pytest.approx(half, rel=1e-6)
    assert x.reason == "limited by the tolerance of b (95 %)"
    assert y == ParameterValue("y", 5.0)
    assert other == said(options)[1]


def test_constants_that_are_exact_cost_no_further_estimate():
    calls = []

    def once(options):
        calls.append(options)
        return said(options)

    exact = Options(tolerances=Relative(**{"a": 0.0, "b": 0.0}))
    assert with_tolerances(exact, once, ("one",)) == said(exact)
    assert len(calls) == 1


def test_nothing_is_estimated_again_where_no_estimate_is_widened():
    calls = []

    def once(options):
        calls.append(options)
        return said(options)

    options = Options(tolerances=Absolute())
    assert with_tolerances(options, once, ("another",), absolute=True) == said(options)
    assert len(calls) == 1


def test_an_interval_of_the_model_s_own_is_widened():
    def given(options):
        x, y = said(options)[0].parameters
        x = replace(x, standard_error=0.1, lower_95=x.value - 0.2, upper_95=x.value + 0.2)
        return (replace(said(options)[0], parameters=(x, y)),)

    (x, _) = with_tolerances(Options(), given, ("one",))[0].parameters
    half = np.hypot(0.2, 1.959964 * 3.0 * 0.06 / np.sqrt(3.0))
    assert x.upper_95 - x.value == pytest.approx(half, rel=1e-6)
    assert x.standard_error == 0.1


def test_a_parameter_that_is_lost_with_the_constant_is_withheld_by_its_name():
    def lost(options):
        one = said(options)[0]
        x, y = one.parameters
        if options.a > 2.0:
            x = replace(x, value=float("nan"))
        return (replace(one, parameters=(x, y)),)

    x, _ = with_tolerances(Options(), lost, ("one",))[0].parameters
    assert not x.usable
    assert "a moved by its tolerance" in x.reason


def estimated(name, changes, options, seed=5):
    model, simulation = get_model(name), configure(get_simulation(name), changes)
    *_, block = simulate_cycles(simulation, 2, seed)
    cycle = Cycle(2, simulation.period_s, to_frames(block))
    done = model.estimate(cycle, complete_options(model, options))
    truth = model.truth(simulation, simulation.first_cycle)
    return {p.name: p for p in done[0].parameters}, truth


@pytest.mark.parametrize("scale", [0.9985, 1.0015])
def test_steps_that_are_longer_than_said_stay_inside_the_edges_of_the_stepper_valve(scale):
    found, truth = estimated("stepper_servo", {"plant.count_scale": scale}, {})
    for name in ("band_lower", "band_upper", "backlash"):
        assert found[name].lower_95 <= truth[name] <= found[name].upper_95, name
    assert "step_size" in found["band_lower"].reason
    exact, _ = estimated(
        "stepper_servo", {"plant.count_scale": scale}, {"tolerances.step_size": 0.0}
    )
    assert not exact["band_lower"].lower_95 <= truth["band_lower"] <= exact["band_lower"].upper_95


def test_pilots_that_open_later_than_said_stay_inside_the_gains_of_the_press_valve():
    changes = {"plant.offset_in": 0.02, "plant.offset_out": 0.02}
    given = {f"tolerances.v_offset_{way}": 0.03 for way in ("in", "out")}
    found, truth = estimated("press_cartridge", changes, given)
    for name in ("K_in", "K_out"):
        assert found[name].lower_95 <= truth[name] <= found[name].upper_95, name
    assert "v_offset_in" in found["K_in"].reason
    exact, _ = estimated("press_cartridge", changes, {})
    assert not exact["K_in"].lower_95 <= truth["K_in"] <= exact["K_in"].upper_95


def told_of_a_stop(at, **options):
    """Return what is told of a positioner that runs into a stop."""
    changes = {"program.targets": (0.1, 0.95, 0.9, 0.3, 0.95, 0.95, 0.4, 0.1)}
    simulation = configure(get_simulation("positioner"), changes)
    *_, block = simulate_cycles(simulation, 2, 5)
    frames, model = to_frames(block), get_model("positioner")
    frames = replace(frames, position=np.minimum(frames.position, at))
    done = model.estimate(Cycle(2, simulation.period_s, frames), complete_options(model, options))
    return {p.name: p for p in done[0].parameters}


def test_a_stop_that_may_stand_elsewhere_limits_what_the_positioner_tells():
    """The position runs into the stop of the options: where it stands tells how fast it came."""
    found = told_of_a_stop(0.93, upper_stop=0.93, **{"tolerances.upper_stop": 0.01})
    assert any("upper_stop" in p.reason for p in found.values())
    exact = told_of_a_stop(0.93, upper_stop=0.93)
    assert not any("upper_stop" in p.reason for p in exact.values())
    widths = [p["rate_rising"].upper_95 - p["rate_rising"].value for p in (found, exact)]
    assert widths[0] > widths[1]


@pytest.mark.no_cover
def test_a_stop_that_stands_lower_than_said_is_inside_its_tolerance():
    """Nothing reaches the stop of the options, but the valve's own, which stands lower."""
    found = told_of_a_stop(0.94, upper_stop=0.96, **{"tolerances.upper_stop": 0.03})
    assert "upper_stop" in found["rate_rising"].reason
    assert found["rate_rising"].lower_95 <= 4.0 <= found["rate_rising"].upper_95
    assert found["rate_falling"].lower_95 <= 3.0 <= found["rate_falling"].upper_95
