# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press valve's promises: drift and gains against a truth that is known beforehand.

The reference experiment of equations.md 2.3 and 2.5 (105 cycles, filling pilot area -15 %, supply
pressure scatter 0.4 %) and the model-consistent generator of 2.6. Seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest

from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import AgingRule, configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.press_cartridge.truth import cycle_truth
from valve_twin.core.valves.registry import complete_options

CYCLES = 105
PERIOD_S = 0.03


def aging_experiment(**layer):
    config = configure(MODEL.simulation(), {"measurement": layer})
    return replace(config, aging=(AgingRule("area_in", "linear", -0.15 / (CYCLES - 1), 2),))


def estimates_of(config, seed, options):
    given = complete_options(MODEL, options)
    for number, block in enumerate(simulate_cycles(config, CYCLES, seed), 1):
        yield MODEL.estimate(Cycle(number, PERIOD_S, to_frames(block)), given)


def published_trend(history, parameter):
    """Return the trend as the aging monitor publishes it."""
    config = AgingConfig(parameters=(parameter,))
    return assess(history, (), config, parameters=MODEL.parameters).trends[0]


@pytest.mark.no_cover
@pytest.mark.parametrize(
    ("seeds", "least"), [(6, 5), pytest.param(20, 17, marks=pytest.mark.slow)]
)
def test_finds_the_drift_of_the_inflow_gain_within_a_point_and_covers_it(seeds, least):
    config = aging_experiment(noise=1e-3, delay=1)
    first, last = (cycle_truth(config, cycle).gains[0] for cycle in (1, CYCLES))
    truth = 100.0 * (last / first - 1.0)

    trends = [
        published_trend(
            [e for (e,) in estimates_of(config, seed, {"estimators": ["output_error"]})], "K_in"
        )
        for seed in range(seeds)
    ]

    # one history in a hundred is cut by mistake; of the others the drift is from first to last
    whole = [t for t in trends if t.segments == 1]
    assert len(whole) >= seeds - 1
    assert np.mean([t.drift_segment for t in whole]) == pytest.approx(truth, abs=1.0)
    covered = [t.drift_segment_lower_95 <= truth <= t.drift_segment_upper_95 for t in whole]
    assert sum(covered) >= least  # of a 95 % interval: fewer in 2 to 3 % of campaigns


@pytest.mark.no_cover
@pytest.mark.parametrize("seeds", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_reproduces_the_paper_under_a_slow_noisy_sensor(seeds):
    config = aging_experiment(noise=4e-3, delay=0, refresh=4)
    # the paper takes the commands two samples back (eq. (19)); it does not search the lag
    options = {"estimators": ["output_error", "equation_error_qp4"], "lag": 2}

    drifts = []
    for seed in range(seeds):
        paper = [both[1] for both in estimates_of(config, seed, options)]
        assert all(abs(e.value("theta_1") + 1.0) <= 1e-3 for e in paper)
        followed = [replace(e, used_by_trend=True) for e in paper]
        drifts.append(published_trend(followed, "theta_2").drift_segment)

    assert np.mean(drifts) == pytest.approx(-14.1, abs=2.5)


@pytest.fixture(scope="module")
def generated():
    """Return 210 generated cycles' estimates, the first 10 of which calibrate the intervals."""
    truth, rng, memory = Truth(), np.random.default_rng(11), Memory.empty()
    options = complete_options(MODEL, {"estimators": ["output_error"]})
    history = []
    for number in range(1, 211):
        cycle = generate_cycle(truth, rng, number=number, start_ns=number * 25_500_000_000)
        (estimate,), memory = estimate_cycle(MODEL, options, cycle, memory)
        history.append(estimate)
    return truth, history


@pytest.mark.no_cover
def test_inflow_gain_is_unbiased_under_process_noise_and_leak(generated):
    truth, history = generated
    mean = np.mean([e.value("K_in") for e in history[:40]])
    assert mean == pytest.approx(truth.k_in, rel=0.01)


@pytest.mark.parametrize("name", ["K_in", "K_out", "leak"])
def test_published_intervals_cover_the_truth(generated, name):
    truth, history = generated
    true = {"K_in": truth.k_in, "K_out": truth.k_out, "leak": truth.leak / truth.period_s}[name]
    values = [next(p for p in e.parameters if p.name == name) for e in history[10:]]
    covered = [p.lower_95 <= true <= p.upper_95 for p in values]
    assert len(covered) == 200
    assert np.mean(covered) >= 0.88
