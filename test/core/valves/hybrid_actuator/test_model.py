# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The actuator's twin: what it recovers, refuses, predicts and follows over cycles."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import t as student

from test.core.valves import blocks
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.simulation.plant import Drive
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus, Validity
from valve_twin.core.valves.hybrid_actuator import MODEL
from valve_twin.core.valves.hybrid_actuator.plant import HybridActuatorPlant
from valve_twin.core.valves.hybrid_actuator.plant_kernel import IMPACT
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

OPTIONS = complete_options(MODEL, {})
PERIOD_S, STEP_S = 1e-4, 1e-5
SEEDS = 20
AGING = ("resistance_opener", "resistance_closer", "spring_rate", "damping", "magnet_force")


def make_cycles(given=None, cycles=1, seed=0):
    config = configure(get_simulation("hybrid_actuator"), given or {})
    blocks = simulate_cycles(config, cycles, seed)
    return [Cycle(n, PERIOD_S, to_frames(b)) for n, b in enumerate(blocks, 1)]


def values_of(given=None, seed=0):
    (estimate,) = MODEL.estimate(make_cycles(given, 1, seed)[0], OPTIONS)
    assert estimate.status is EstimateStatus.ACCEPTED, estimate.reason
    return {p.name: p.value for p in estimate.parameters}


@cache
def many():
    """Return the estimates of 20 seeds of a new valve, by parameter."""
    rows = [values_of(seed=seed) for seed in range(SEEDS)]
    return {name: np.array([r[name] for r in rows]) for name in rows[0]}


def test_is_registered():
    assert get_model("hybrid_actuator") is MODEL
    assert MODEL.inputs == get_simulation("hybrid_actuator").plant.inputs


@pytest.mark.parametrize(
    ("name", "truth", "bias", "scatter"),
    [
        # measured: bias 0.2, 0.3, 0.2, 0.4, 0.4 %, scatter 0.1, 0.1, 0.6, 0.8, 1.0 %
        ("resistance_opener", 0.34, 0.01, 0.005),
        ("resistance_closer", 0.37, 0.01, 0.005),
        ("spring_rate", 18820.0, 0.01, 0.01),
        ("damping", 3.559, 0.015, 0.015),
        ("magnet_force", 128.0, 0.015, 0.02),
    ],
)
def test_recovers_a_known_valve(name, truth, bias, scatter):
    found = many()[name]
    assert abs(found.mean() / truth - 1.0) < bias
    assert found.std(ddof=1) / truth < scatter


@cache
def contact_speeds():
    """Return the plant's speeds at the first contact with either seat, from the energy lost."""
    plant = HybridActuatorPlant()
    state = plant.initial_state()
    speeds: list[float] = []
    for half in range(2):
        drive = Drive(np.array([1.0 - half]), np.ones(1, dtype=np.bool_), None, np.zeros(1))
        before = state[IMPACT]
        for _ in range(10000):
            plant.run(state, drive, STEP_S)
            if state[IMPACT] > before and len(speeds) == half:
                kept = 1.0 - plant.restitution**2
                speeds.append(float(np.sqrt(2.0 * (state[IMPACT] - before) / (plant.mass * kept))))
    return speeds


@pytest.mark.parametrize(("index", "side"), enumerate(("open", "closed")))
def test_seating_speed_is_that_of_the_plant(index, side):
    truth = contact_speeds()[index]
    found = many()[f"seating_speed_{side}"]
    assert found.mean() == pytest.approx(truth, rel=0.005)
    assert found.std(ddof=1) < 0.01 * truth


def test_derived_values_follow_from_spring_mass_and_damping():
    found = values_of()
    omega = np.sqrt(found["spring_rate"] / 0.12983)
    assert found["natural_frequency"] == pytest.approx(omega, rel=1e-12)
    ratio = found["damping"] / (2.0 * 0.12983 * omega)
    assert found["damping_ratio"] == pytest.approx(ratio, rel=1e-12)
    assert found["damping_ratio"] == pytest.approx(0.036, abs=1e-3)  # equations.md 1.2, item 4


@pytest.mark.parametrize("kernel", ["linear", "saturating_fit"])
def test_recovers_a_valve_of_another_kernel(kernel):
    cycle = make_cycles({"plant.kernel": kernel})[0]
    (estimate,) = MODEL.estimate(cycle, replace(OPTIONS, kernel=kernel))
    assert estimate.value("resistance_opener") == pytest.approx(0.34, rel=0.01)
    assert estimate.value("spring_rate") == pytest.approx(18820.0, rel=0.04)
    assert estimate.value("damping") == pytest.approx(3.559, rel=0.05)


@pytest.mark.no_cover
@pytest.mark.parametrize("drift", [-0.15, 0.15])
@pytest.mark.parametrize("name", AGING)
@pytest.mark.parametrize("seeds", [8, pytest.param(SEEDS, marks=pytest.mark.slow)])
def test_a_drift_of_15_percent_is_found_inside_its_interval(name, drift, seeds):
    """The mean over the seeds, within its 95 % interval and the bias stated above."""
    given = {
        f"aging.{name}.law": "step",
        f"aging.{name}.rate": drift,
        f"aging.{name}.start_cycle": 1,
    }
    aged = np.array([values_of(given, seed)[name] for seed in range(seeds)])
    found = aged / many()[name][:seeds] - 1.0
    half = student.ppf(0.975, seeds - 1) * found.std(ddof=1) / np.sqrt(seeds)
    assert abs(found.mean() - drift) < half + 0.01
    assert np.all(np.abs(found - drift) < 0.06)


def test_the_model_in_force_predicts_the_next_cycle():
    memory, estimates = Memory.empty(), []
    for cycle in make_cycles(cycles=4, seed=1):
        (estimate,), memory = estimate_cycle(MODEL, OPTIONS, cycle, memory)
        estimates.append(estimate)
    for estimate in estimates[1:]:
        assert estimate.fit_test > 99.5
        assert np.sqrt(estimate.mse_test) < 1.6 * 3.75e-4  # of the noise


def run(cycle, values, cuts=(), restart=None, position=None):
    c = MODEL.coefficients(values, 0, PERIOD_S, OPTIONS)
    restart = blocks.marked(len(cycle.frames)) if restart is None else restart
    return blocks.predict(MODEL, c, cycle.frames, restart, cuts, position)


def test_any_block_length_predicts_the_same_bits():
    cycle = make_cycles(seed=2)[0]
    whole = run(cycle, {})
    for one, other in zip(whole, run(cycle, {}, (1, 2, 60, 61, 1200)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_prediction_uses_earlier_positions_only():
    cycle = make_cycles(seed=2)[0]
    changed = cycle.frames.position.copy()
    changed[60] += 0.01
    before, after = run(cycle, {})[0], run(cycle, {}, position=changed)[0]
    np.testing.assert_array_equal(before[:61], after[:61])
    assert before[61] != after[61]


def test_marks_what_a_prediction_is_worth():
    cycle = make_cycles(seed=2)[0]
    restart = blocks.marked(len(cycle.frames), {80: 3, 500: 2})
    position = cycle.frames.position.copy()
    position[80] = np.nan
    predicted, _, validity = run(cycle, {}, restart=restart, position=position)
    assert validity[0] == validity[500] == Validity.STARTING
    assert np.isnan(predicted[[0, 500]]).all()
    assert validity[80] == Validity.BAD_INPUT
    assert np.isfinite(predicted[81])
    assert validity[10] == Validity.AT_SEAT
    assert validity[60] == Validity.VALID


def refusal(cycle, options=OPTIONS):
    (estimate,) = MODEL.estimate(cycle, options)
    assert estimate.status is EstimateStatus.REFUSED
    assert all(p.status is not ParameterStatus.OK for p in estimate.parameters)
    return estimate.reason


def changed(cycle, **arrays):
    return replace(cycle, frames=replace(cycle.frames, **arrays))


def test_refuses_sampling_that_is_too_slow():
    slow = replace(make_cycles()[0], period_s=1e-3)
    assert "period_s = 0.001: must be at most 0.00025 [s]" in refusal(slow)


def test_refuses_a_gap_at_the_pole_of_the_kernel():
    options = replace(OPTIONS, kernel="saturating_fit", residual_gap=5e-5)
    reason = refusal(make_cycles()[0], options)
    assert "residual_gap = 5e-05: must be a number from 0.0001" in reason
    assert np.isnan(MODEL.coefficients({}, 0, PERIOD_S, options)).all()


def test_refuses_a_cycle_without_pulse_or_stroke():
    cycle = make_cycles()[0]
    still = changed(cycle, inputs=np.zeros((2000, 4)), position=np.zeros(2000))
    assert refusal(still) == "neither pulse nor stroke in the cycle"


@pytest.mark.parametrize("column", range(5))
def test_not_a_number_in_any_signal_is_left_out(column):
    cycle = make_cycles(seed=3)[0]
    inputs, position = cycle.frames.inputs.copy(), cycle.frames.position.copy()
    if column < 4:
        inputs[70:75, column] = np.nan
    else:
        position[70:75] = np.nan
    (estimate,) = MODEL.estimate(changed(cycle, inputs=inputs, position=position), OPTIONS)
    assert estimate.counts.bad == 5
    assert estimate.value("spring_rate") == pytest.approx(18820.0, rel=0.04)


def test_refuses_a_record_of_nothing_but_not_a_number():
    cycle = changed(make_cycles()[0], position=np.full(2000, np.nan))
    assert refusal(cycle) == "0 usable samples, fewer than 50"


def test_refuses_gaps():
    cycle = make_cycles()[0]
    stamps = cycle.frames.stamp_ns.copy()
    stamps[50:] += 1_000_000
    assert "1 gaps" in refusal(changed(cycle, stamp_ns=stamps))


def test_a_stroke_that_is_not_caught_has_no_seating_speed():
    given = {"plant.catch_share": 0.0, "plant.damping": 12.0}
    (estimate,) = MODEL.estimate(make_cycles(given)[0], OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert estimate.status is EstimateStatus.PARTIAL
    assert by_name["seating_speed_open"].status is ParameterStatus.NOT_EXCITED
    assert by_name["seating_speed_open"].reason == "no stroke reached the open seat"
    assert by_name["spring_rate"].value == pytest.approx(18820.0, rel=0.02)
    assert by_name["damping"].value == pytest.approx(12.0, rel=0.02)


@pytest.mark.parametrize(
    "given", [{"plant.gas_force": 20.0}, {"plant.magnet_coupling": 0.6}, {"measurement.delay": 1}]
)
def test_a_force_or_delay_that_is_not_in_the_model_is_seen_in_the_flights(given):
    """Taken for a new valve, 20 N of gas would look like half the spring and no damping."""
    (estimate,) = MODEL.estimate(make_cycles(given)[0], OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert estimate.status is EstimateStatus.PARTIAL
    for name in ("spring_rate", "damping", "magnet_force"):
        assert by_name[name].status is ParameterStatus.REFUSED
        assert "a force is missing or an option is wrong" in by_name[name].reason
    assert by_name["resistance_opener"].value == pytest.approx(0.34, rel=0.01)


def test_a_known_gas_force_is_taken_into_account():
    cycle = make_cycles({"plant.gas_force": 20.0})[0]
    (estimate,) = MODEL.estimate(cycle, replace(OPTIONS, gas_force=20.0))
    assert estimate.status is EstimateStatus.ACCEPTED
    assert estimate.value("spring_rate") == pytest.approx(18820.0, rel=0.03)
    assert estimate.value("damping") == pytest.approx(3.559, rel=0.04)
    assert estimate.value("magnet_force") == pytest.approx(128.0, rel=0.05)


@pytest.mark.no_cover
@pytest.mark.parametrize("noise", [0.0, 1.1e-3])
def test_the_check_of_the_flights_knows_the_noise(noise):
    cycles = [make_cycles({"measurement.noise": noise}, seed=s)[0] for s in range(10)]
    for cycle in cycles:
        (estimate,) = MODEL.estimate(cycle, OPTIONS)
        assert estimate.status is EstimateStatus.ACCEPTED, estimate.reason


def test_a_record_of_noise_is_estimated_with_a_bounded_effort():
    rng = np.random.default_rng(0)
    cycle = make_cycles()[0]
    walk = np.clip(0.5 + np.cumsum(rng.normal(0.0, 0.1, 2000)), -0.1, 1.1)
    noise = changed(cycle, position=walk, inputs=rng.uniform(-1.0, 1.0, (2000, 4)))
    (estimate,) = MODEL.estimate(noise, OPTIONS)
    by_name = {p.name: p for p in estimate.parameters}
    assert by_name["spring_rate"].status is not ParameterStatus.OK
    assert estimate.counts.used <= 6 * 300  # six flights of 30 ms
