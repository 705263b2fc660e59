# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
from collections import Counter

from valve_twin.validation.damadics.scenarios import healthy_day, long_scenarios, scenarios


def test_there_are_44_scenarios_34_of_them_abrupt():
    found = {s.name: s for s in scenarios()}
    assert Counter(name[-1] for name in found) == {"S": 10, "M": 10, "B": 14, "I": 10}
    assert {s.number for s in found.values()} == set(range(1, 20))


def test_horizons_and_directions_are_those_of_the_benchmark():
    found = {s.name: s for s in scenarios()}
    horizons = {"f1S": 1500.0, "f13I": 2400.0, "f4I": 5100.0, "f17I": 5100.0, "f9I": 85500.0}
    assert {name: found[name].horizon_s for name in horizons} == horizons
    assert found["f12M"].faults[0].strength == -0.5
    assert found["f2I"].faults[0].rise_s == 86400.0
    assert [s.name for s in found.values() if s.consistent] == ["f4I"]


def test_seven_last_a_day_as_the_healthy_one_does():
    names = [s.name for s in long_scenarios()]
    assert names == ["f2I", "f3I", "f5I", "f6I", "f9I", "f11I", "f18I"]
    assert {s.horizon_s for s in long_scenarios()} == {healthy_day().horizon_s}


def test_a_later_onset_moves_the_horizon_with_it():
    later = scenarios()[0].later(50.0)
    assert (later.onset_s, later.horizon_s) == (950.0, 1550.0)
