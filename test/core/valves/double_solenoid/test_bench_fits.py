# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Dynamics and steps of a bench record, and what cannot be evaluated."""

import numpy as np
import pytest

from valve_twin.core.valves.double_solenoid.bench_fits import dynamics, steps
from valve_twin.core.valves.double_solenoid.dynamics_fit import filtered, trapezoid
from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant
from valve_twin.core.valves.double_solenoid.plant_kernel import STEP_S

TRUE_GAIN = 0.045 / 0.028  # of G_A at high frequency


def record(every, sigma=0.0, seed=0):
    source = trapezoid(0.6e-3, 0.8, 2e-3)
    answer = filtered(DoubleSolenoidPlant().current_dynamics(), source)
    noisy = answer + sigma * np.random.default_rng(seed).standard_normal(len(answer))
    time = STEP_S * np.arange(len(source))
    names = ("time", "input", "output")
    return {n: v[::every] for n, v in zip(names, (time, source, noisy), strict=True)}


@pytest.mark.parametrize("every", [1, 2, 4])
def test_the_gain_at_high_frequency_is_found_at_any_sampling(every):
    found = {v.name: v.value for v in dynamics(record(every), {}).values}
    assert found["gain_at_high_frequency"] == pytest.approx(TRUE_GAIN, rel=0.05)


@pytest.mark.no_cover
def test_intervals_hold_the_gain_as_often_as_they_say():
    """95 % of 40 draws at 5 mA of noise; three standard errors: 4 misses and 2 more."""
    hits = 0
    for seed in range(40):
        value = dynamics(record(2, 5e-3, seed), {}).values[-1]
        hits += value.lower <= TRUE_GAIN <= value.upper
    assert hits >= 34


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"time": lambda t: 1.3 * t}, "must be a multiple of 1.25e-05 s"),
        ({"input": lambda u: 0.0 * u}, "the input stands still"),
        ({"time": lambda t: t + 1e-4 * (t > 1e-3)}, "must be sampled evenly"),
    ],
)
def test_what_cannot_be_fitted_is_told(change, line):
    columns = record(2)
    for name, function in change.items():
        columns[name] = function(columns[name])
    with pytest.raises(ValueError, match=line):
        dynamics(columns, {})


def test_a_step_without_a_place_to_go_is_told():
    time = 1e-4 * np.arange(200.0)
    still = np.zeros(200)
    with pytest.raises(ValueError, match="the setpoint stands still"):
        steps({"time": time, "setpoint": still, "position": still}, {})
    noise = 1e-6 * np.random.default_rng(1).standard_normal(200)
    with pytest.raises(ValueError, match=r"step 1 at 0.01 s: .* nothing can be told"):
        steps({"time": time, "setpoint": np.where(time < 0.01, 0, 1e-6), "position": noise}, {})


def test_a_known_step_is_judged():
    time = 1e-4 * np.arange(1000.0)
    setpoint = np.where(time < 0.01, 0.0, 4e-4)
    since = np.maximum(time - 0.01, 0.0)
    found = steps({"time": time, "setpoint": setpoint,
                   "position": 4e-4 * -np.expm1(-since / 5e-3)}, {})  # fmt: skip
    value = {v.name: v.value for v in found.values}
    assert value["rise 1"] == pytest.approx(5e-3 * np.log(9.0), abs=2e-4)
    assert value["settling 1"] == pytest.approx(5e-3 * np.log(50.0), abs=2e-4)
    assert value["overshoot 1"] == 0.0
