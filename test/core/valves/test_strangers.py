# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.core.simulation.settings import configure
from valve_twin.core.valves.registry import get_model, model_names
from valve_twin.core.valves.strangers import DRAWN, score_strangers

VALVES = (
    "double_solenoid",
    "first_order",
    "hammerstein_wiener",
    "hybrid_actuator",
    "integrator",
    "positioner",
    "press_cartridge",
    "servo_system",
    "stepper_servo",
)


@pytest.mark.parametrize("valve", VALVES)
def test_a_valve_has_at_least_twenty_strangers(valve):
    assert len(get_model(valve).strangers()) >= 20


@pytest.mark.parametrize("valve", model_names())
def test_the_strangers_are_settings_of_the_simulation(valve):
    """A name that the simulation does not have would be a stranger like the valve itself."""
    model, simulation = get_model(valve), get_model(valve).simulation()
    strangers = model.strangers()
    assert simulation is not None or not strangers
    for name, changes in strangers.items():
        assert simulation is not None
        assert configure(simulation, changes) != simulation, name


def test_soft_edges_and_uneven_screws_are_withheld_or_inside():
    asked = ("edges", "backlash varies")
    scored = score_strangers("stepper_servo", drawn=0, seed_base=100, only=asked)
    scores = {s.name: s for s in scored}
    assert {next(a for a in asked if name.startswith(a)) for name in scores} == set(asked)
    for name, score in scores.items():
        assert score.outside == 0, name
    assert scores["edges of power 1.5"].withheld >= 3


@pytest.mark.no_cover
def test_constants_inside_their_tolerances_are_inside():
    scores = list(score_strangers("hybrid_actuator", drawn=3, seed_base=100, only=(DRAWN,)))
    assert [s.name for s in scores] == [DRAWN] * 3
    assert sum(s.outside for s in scores) <= 1
    assert sum(s.inside for s in scores) >= 9
