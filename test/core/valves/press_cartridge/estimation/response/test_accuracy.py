# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Limits that hold what is wrong in every cycle alike: on plants that are not the model's."""

from dataclasses import replace

import numpy as np
import pytest

from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import Cycle, ParameterValue
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.estimation.response.accuracy import with_limits
from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant
from valve_twin.core.valves.registry import complete_options

SHORT, LONG = 8, 24
"""Plants in `make test` and in `make test-long`."""
CYCLES = 13


def simulation(seed, noise):
    """Return a press of random geometry, pilots, controller and delay; no scatter."""
    rng = np.random.default_rng([7000, seed])
    given = MODEL.simulation()
    plant = given.plant
    assert isinstance(plant, PressCartridgePlant)
    plc = replace(
        plant.plc,
        period_s=float(rng.choice([0.002, 0.005, 0.01, 0.03])),
        gain_in=plant.plc.gain_in * rng.uniform(0.6, 1.5),
        gain_out=plant.plc.gain_out * rng.uniform(0.6, 1.5),
        limit=rng.uniform(0.6, 0.8),
    )
    plant = replace(
        plant,
        area_in=plant.area_in * rng.uniform(0.6, 1.6),
        area_out=plant.area_out * rng.uniform(0.6, 1.6),
        saturation_in=rng.uniform(0.0, 0.2),
        saturation_out=rng.uniform(0.0, 0.4),
        pilot_lag=rng.uniform(3e-3, 0.03),
        leak=plant.leak * rng.uniform(0.4, 3.0),
        area_ratio=rng.uniform(0.93, 0.98),
        bulk_modulus=10.0 ** rng.uniform(8.7, 9.35),
        plc=plc,
    )
    measurement = replace(given.measurement, delay=int(rng.integers(0, 3)), noise=noise)
    return replace(given, plant=plant, measurement=measurement, scatter=())


@pytest.fixture(
    scope="module",
    params=[
        *((noise, SHORT) for noise in (1e-5, 1e-3)),
        *(pytest.param((noise, LONG), marks=pytest.mark.slow) for noise in (1e-5, 1e-3)),
    ],
    ids=lambda given: f"{given[0]:g}-{given[1]}",
)
def last_estimates(request):
    """The last estimates of a short history of each plant, by estimator, and the truth."""
    options = complete_options(MODEL, {"estimators": ("output_error", "kalman")})
    noise, plants = request.param
    found = []
    for seed in range(plants):
        config = simulation(seed, noise)
        memory = Memory.empty()
        for number, block in enumerate(simulate_cycles(config, CYCLES, seed=seed), 1):
            cycle = Cycle(number, config.period_s, to_frames(block))
            estimates, memory = estimate_cycle(MODEL, options, cycle, memory)
        found.append((MODEL.truth(config, config.first_cycle), estimates))
    return found


@pytest.mark.no_cover
@pytest.mark.parametrize("estimator", ["output_error", "kalman"])
def test_limits_hold_the_truth_of_random_plants(last_estimates, estimator):
    """At least 90 % of the plants times three parameters, repeatability alone far fewer."""
    inside, repeatable = [], []
    for truth, estimates in last_estimates:
        values = next(e for e in estimates if e.estimator == estimator)
        for p in values.parameters:
            if p.name in truth and p.usable:
                inside.append(p.lower_95 <= truth[p.name] <= p.upper_95)
                repeatable.append(abs(p.value - truth[p.name]) <= 1.96 * p.standard_error)
    assert len(inside) >= 2.9 * len(last_estimates)
    assert np.mean(inside) >= 0.9
    assert np.mean(repeatable) < np.mean(inside)


def test_both_kinds_of_error_add_as_squares():
    gain = ParameterValue("K_in", 1.0)
    (own,) = with_limits((gain,), {"K_in": 0.1}, {"K_in": 0.3})
    assert own.standard_error == 0.1
    assert own.upper_95 - 1.0 == pytest.approx(np.hypot(0.196, 0.3), rel=1e-3)
    (alike,) = with_limits((gain,), {}, {"K_in": 0.3})
    assert (alike.lower_95, alike.upper_95) == (0.7, 1.3)
    assert np.isnan(alike.standard_error)
