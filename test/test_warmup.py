# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What was run once needs no compiler any more."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from valve_twin import warmup
from valve_twin.core.estimation.cycle import scatter
from valve_twin.core.operation.counters import Counters
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_simulation, model_names
from valve_twin.warmup import predict_once, simulate_once

SCRIPT = """
from valve_twin.core.simulation import SimulatedValve
from valve_twin.core.valves.registry import get_simulation
from valve_twin.warmup import compiled, simulate_once

simulation = get_simulation("first_order")
with compiled() as before:
    simulate_once(simulation)
with compiled() as after:
    SimulatedValve(simulation, seed=3).advance(simulation.cycle_samples + 1)
print(before.kernels > 0, after.kernels)
"""


def test_two_samples_compile_all_that_a_cycle_of_the_simulation_needs(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["True", "0"]


def test_a_simulation_with_an_external_controller_is_run_as_well():
    simulate_once(replace(get_simulation("first_order"), controller="external"))


@pytest.mark.parametrize(
    ("words", "valves"), [([], set(model_names())), (["--demo", "double_solenoid"], None)]
)
def test_predictions_are_compiled_ahead_for_valves_that_can_be_simulated(
    words, valves, monkeypatch
):
    predicted: set[str] = set()
    shown: set[str] = set()
    for name in ("run_once", "_estimate_wave", "_warm_up_design"):
        monkeypatch.setattr(warmup, name, lambda *_: None)
    monkeypatch.setattr(warmup, "predict_once", lambda name, _: predicted.add(name))
    monkeypatch.setattr(warmup, "_simulate_shown", shown.add)
    monkeypatch.setattr("valve_twin.core.aging.cutting.ahead.warm_up", lambda: None)
    warmup.main(words)
    assert predicted == (valves or {"double_solenoid"})
    assert shown == {"double_solenoid"}  # the one that is shown by another file than its own


def test_what_a_cycle_adds_to_the_counters_is_compiled_ahead(monkeypatch):
    counted, after = [], Counters.after

    def noted(self, duty):
        counted.append(after(self, duty))
        return counted[-1]

    monkeypatch.setattr(Counters, "after", noted)
    warmup.run_once("first_order", CycleRule.COUNTER)
    assert counted
    assert counted[-1].movements > 0
    assert counted[-1].hours[1] > 0.0


def test_the_scatter_that_a_tenth_cycle_asks_for_is_compiled_ahead(monkeypatch):
    asked = []

    def measured(values, outlier):
        asked.append((len(values), values.dtype, outlier))
        return 0.0, len(values) - 2

    monkeypatch.setattr(scatter, "scatter_about_line", measured)
    warmup.run_once("first_order", CycleRule.WINDOW)
    assert [(n, str(kind)) for n, kind, _ in asked] == [(scatter.MIN_CYCLES, "float64")]


@pytest.mark.parametrize("name", model_names())
def test_every_model_predicts_two_samples_of_rest(name):
    predict_once(name, CycleRule.WINDOW)
