# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The conformance test: every valve of ours, and valves that break one promise each."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves import check
from valve_twin.core.valves.check import check_valve
from valve_twin.core.valves.first_order import VALVE
from valve_twin.core.valves.kit import Valve
from valve_twin.core.valves.registry import model_names

WITHOUT = ("cycle_timing", "damadics", "hydraulic_actuator")
"""Valves without a simulation, or with one whose numbers are not those that are followed."""


def findings(name, seeds=1):
    ticks = count()
    return {f.check: f for f in check_valve(name, lambda: 1e-9 * next(ticks), seeds=seeds)}


@pytest.mark.no_cover
@pytest.mark.parametrize("name", model_names())
def test_every_valve_of_ours_keeps_the_protocol(name):
    found = findings(name, seeds=0)
    found.pop("recovery")  # by the next test
    assert [f.check for f in found.values() if f.passed is not True] == []


LENGTHY = [pytest.param(n, marks=pytest.mark.slow) for n in model_names() if n != "first_order"]


@pytest.mark.no_cover
@pytest.mark.parametrize("name", ["first_order", *LENGTHY])
def test_the_intervals_hold_the_parameters_of_the_valve_s_own_simulation(name):
    found = findings(name, seeds=20)["recovery"]
    assert found.passed is (True if name not in WITHOUT else None), found.text


class Broken(Valve):
    """A valve of the kit with one fault, chosen by `broken`."""

    broken = ""

    def predict(self, state, c, position, inputs, restart, predicted, simulated, validity):
        if self.broken == "not a number":
            restart = np.where(restart == 3, 0, restart).astype(np.uint8)
        super().predict(state, c, position, inputs, restart, predicted, simulated, validity)
        if self.broken == "blocks":
            predicted[:] += 1e-12 * len(predicted)
        if self.broken == "one-step prediction":
            predicted[:] = position
        if self.broken == "restart BAD":
            validity[:] = 0

    def estimate(self, cycle, options, earlier=()):
        if self.broken == "failure" and len(cycle.frames) < 100:
            int("nothing")
        (found,) = super().estimate(cycle, options, earlier)
        if self.broken == "refusals":
            return (replace(found, status=EstimateStatus.ACCEPTED),)
        if self.broken == "recovery":
            moved = [replace(p, upper_95=p.lower_95) for p in found.parameters]
            return (replace(found, parameters=tuple(moved)),)
        return (found,)


@pytest.mark.parametrize(
    "broken",
    ["blocks", "restart BAD", "not a number", "one-step prediction", "refusals", "recovery"],
)
def test_a_broken_promise_is_found(monkeypatch, broken):
    valve = Broken(VALVE.name, VALVE.inputs, VALVE.output, VALVE.law, VALVE.program)
    object.__setattr__(valve, "broken", broken)
    monkeypatch.setattr(check, "get_model", lambda name: valve)
    assert findings("first_order")[broken].passed is False


def test_code_that_fails_on_a_bad_cycle_is_found(monkeypatch):
    valve = Broken(VALVE.name, VALVE.inputs, VALVE.output, VALVE.law, VALVE.program)
    object.__setattr__(valve, "broken", "failure")
    monkeypatch.setattr(check, "get_model", lambda name: valve)
    found = findings("first_order")["refusals"]
    assert found.passed is False
    assert "ValueError in estimate, line" in found.text


def test_a_valve_of_another_name_is_told(monkeypatch):
    monkeypatch.setattr(check, "get_model", lambda name: VALVE)
    assert findings("mine")["name"].text == "registered as 'mine', named 'first_order'"
