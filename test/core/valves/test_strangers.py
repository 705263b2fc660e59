# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
import pytest

from valve_twin.core.valves.registry import get_model
from valve_twin.core.valves.strangers import DRAWN, score_strangers

VALVES = ("double_solenoid", "hybrid_actuator", "servo_system", "stepper_servo")


@pytest.mark.parametrize("valve", VALVES)
def test_a_valve_has_at_least_twenty_strangers(valve):
    assert len(get_model(valve).strangers()) >= 20


def test_soft_edges_and_uneven_screws_are_withheld_or_inside():
    scores = {s.name: s for s in score_strangers("stepper_servo", drawn=0, seed_base=100)}
    for name, score in scores.items():
        if name.startswith(("edges", "backlash varies")):
            assert score.outside == 0, name
    assert scores["edges of power 1.5"].withheld >= 3


def test_constants_inside_their_tolerances_are_inside():
    scores = [
        s for s in score_strangers("hybrid_actuator", drawn=3, seed_base=100) if s.name == DRAWN
    ]
    assert sum(s.outside for s in scores) <= 1
    assert sum(s.inside for s in scores) >= 9
