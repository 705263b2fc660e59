# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The hydraulic actuator: what it recovers of a known one, refuses, and how it predicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from test.core.valves import blocks
from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.types import Cycle, EstimateStatus, Frames, ParameterStatus, Validity
from valve_twin.core.valves.hydraulic_actuator import MODEL
from valve_twin.core.valves.hydraulic_actuator.kernels import flow, free_run
from valve_twin.core.valves.hydraulic_actuator.parameters import NAMES
from valve_twin.core.valves.registry import complete_options

PERIOD_S = 0.05
N = 500
TRUTH = {
    "flow_limit_lift": 16.0,
    "flow_limit_lower": 30.0,
    "half_opening_lift": 0.3,
    "half_opening_lower": 0.4,
    "progressivity": 2.0,
    "resonance": 6.0,
    "throttling_lift": 0.006,
    "throttling_lower": 0.003,
    "spool_lag": 0.12,
}
OPTIONS = complete_options(MODEL, {})
COEFFICIENTS = MODEL.coefficients(TRUTH, 0, PERIOD_S, OPTIONS)


def make_opening(seed=3, low=-1.2):
    """Return ramps between random openings."""
    rng = np.random.default_rng(seed)
    corners = np.concatenate(([0.0], rng.uniform(low, 1.2, 24)))
    return np.interp(np.arange(N), np.arange(25) * 21.0, corners)


def run_free(opening, first=0.0):
    out = np.empty(len(opening))
    free_run(COEFFICIENTS, opening, first, out)
    return out


def make_cycle(opening=None, noise=0.02, seed=5, number=1):
    opening = make_opening() if opening is None else opening
    n = len(opening)
    pressure = run_free(opening) + np.random.default_rng(seed).normal(0.0, noise, n)
    stamps = (np.arange(n) * PERIOD_S * 1e9).astype(np.int64) + number * 10**12
    nothing = np.full(n, np.nan)
    valid = np.ones(n, dtype=bool)
    return Cycle(
        number, PERIOD_S, Frames(stamps, pressure, opening[:, None], nothing, nothing, valid)
    )


def estimate(cycle, options=OPTIONS):
    (found,) = MODEL.estimate(cycle, options)
    return found


def predict(cycle, marks, cuts=()):
    """Predict a cycle with the true parameters, in blocks cut where told."""
    return blocks.predict(MODEL, COEFFICIENTS, cycle.frames, marks, cuts)


def marks_of(**marked):
    marks = blocks.marked(N)
    for name, at in marked.items():
        marks[at] = {"cycle": 1, "gap": 2, "bad": 3}[name]
    return marks


def test_the_run_solves_the_equations():
    opening = make_opening()
    t = np.arange(N) * PERIOD_S

    def slopes(now, x):
        p, w, s = x
        k = TRUTH["throttling_lift"] if w > 0 else TRUTH["throttling_lower"]
        return [
            flow(s, COEFFICIENTS) - w,
            TRUTH["resonance"] ** 2 * (p - k * abs(w) * w),
            (np.interp(now, t, opening) - s) / TRUTH["spool_lag"],
        ]

    exact = solve_ivp(
        slopes, (0.0, t[-1]), [0.0, 0.0, opening[0]], t_eval=t, rtol=1e-8, atol=1e-9, max_step=0.02
    )
    error = run_free(opening) - exact.y[0]
    assert np.sqrt(np.mean(error**2)) < 0.003 * exact.y[0].std()


def test_the_parameters_of_a_known_actuator_come_back():
    found = estimate(make_cycle())
    assert found.status is EstimateStatus.ACCEPTED
    for name, value in TRUTH.items():
        assert found.value(name) == pytest.approx(value, rel=0.02), name
    assert 1.0 < found.condition_number < 100.0


@pytest.mark.parametrize("resonance", [2.5, 9.0])
def test_the_frequency_is_found_from_afar(resonance):
    opening = make_opening()
    truth = MODEL.coefficients({**TRUTH, "resonance": resonance}, 0, PERIOD_S, OPTIONS)
    cycle = make_cycle()
    pressure = np.empty(N)
    free_run(truth, opening, 0.0, pressure)
    found = estimate(replace(cycle, frames=replace(cycle.frames, position=pressure)))
    assert found.value("resonance") == pytest.approx(resonance, rel=0.01)


@pytest.mark.parametrize(
    ("sign", "shown", "hidden"), [(1, "lift", "lower"), (-1, "lower", "lift")]
)
def test_a_direction_that_was_not_opened_is_not_published(sign, shown, hidden):
    found = estimate(make_cycle(sign * np.abs(make_opening(low=0.1))))
    by_name = {p.name: p for p in found.parameters}
    assert found.status is EstimateStatus.PARTIAL
    for name in ("flow_limit", "half_opening", "throttling"):
        assert by_name[f"{name}_{hidden}"].status is ParameterStatus.NOT_EXCITED
        assert by_name[f"{name}_{shown}"].usable
        assert f"{name}_{hidden}" in found.reason
    known = {p.name: p.value for p in found.parameters if np.isfinite(p.value)}
    filled = dict(zip(NAMES, MODEL.coefficients(known, 0, PERIOD_S, OPTIONS), strict=False))
    assert all(np.isfinite(v) for v in filled.values())
    assert filled[f"flow_limit_{hidden}"] == known[f"flow_limit_{shown}"]


def test_what_says_nothing_is_refused_with_its_reason():
    cycle = make_cycle()
    frames = cycle.frames
    cases = {
        "fewer than min_samples 100": replace(cycle, frames=frames[:60]),
        "less than min_opening 0.1": replace(
            cycle, frames=replace(frames, inputs=0.01 * frames.inputs)
        ),
        "the pressure stayed at 1": replace(cycle, frames=replace(frames, position=np.ones(N))),
        "0 usable samples": replace(cycle, frames=replace(frames, valid=np.zeros(N, dtype=bool))),
    }
    for reason, bad in cases.items():
        found = estimate(bad)
        assert found.status is EstimateStatus.REFUSED
        assert reason in found.reason
        assert all(p.status is ParameterStatus.REFUSED for p in found.parameters)


def test_bad_samples_carry_no_weight():
    cycle = make_cycle()
    pressure = cycle.frames.position.copy()
    pressure[100:110] = np.nan
    valid = np.isfinite(pressure)
    found = estimate(replace(cycle, frames=replace(cycle.frames, position=pressure, valid=valid)))
    assert found.counts.bad == 10
    assert found.value("resonance") == pytest.approx(TRUTH["resonance"], rel=0.02)


def test_only_the_longest_stretch_without_a_gap_is_fitted():
    cycle = make_cycle()
    stamps = cycle.frames.stamp_ns.copy()
    stamps[120:] += 10**10
    found = estimate(replace(cycle, frames=replace(cycle.frames, stamp_ns=stamps)))
    assert found.counts.used == N - 120
    assert found.value("resonance") == pytest.approx(TRUTH["resonance"], rel=0.05)


def test_the_cycle_before_predicts_the_next():
    memory = Memory.empty()
    for number, seed in ((1, 3), (2, 4)):
        (found,), memory = estimate_cycle(
            MODEL, OPTIONS, make_cycle(make_opening(seed), number=number), memory
        )
    assert found.fit_test > 95.0
    force = model_in_force(MODEL, memory, PERIOD_S, OPTIONS)
    assert force is not None
    assert force.residual_sigma < 0.06


@given(cuts=st.lists(st.integers(1, N - 1), max_size=6, unique=True))
@settings(max_examples=20, deadline=None)
def test_blocks_of_any_length_predict_the_same_bits(cuts):
    cycle, marks = make_cycle(), marks_of(cycle=[200], gap=[300], bad=[50, 51, 400])
    whole = predict(cycle, marks)
    for one, other in zip(whole, predict(cycle, marks, sorted(cuts)), strict=True):
        assert one.tobytes() == other.tobytes()


def test_the_marks_do_what_they_say():
    cycle = make_cycle()
    frames = cycle.frames
    predicted, simulated, validity = predict(cycle, marks_of(cycle=[200], gap=[300], bad=[50]))
    assert validity[0] == validity[300] == Validity.STARTING
    assert validity[50] == Validity.BAD_INPUT
    assert np.isnan(predicted[[0, 300]]).all()
    assert np.isfinite(np.delete(predicted, [0, 300])).all()
    assert simulated[200] == frames.position[200]
    assert simulated[300] == frames.position[300]
    good = validity == Validity.VALID
    assert np.sqrt(np.mean((predicted - frames.position)[good][20:200] ** 2)) < 0.06


def test_the_free_run_is_the_one_that_was_fitted():
    cycle = make_cycle()
    _, simulated, _ = predict(cycle, marks_of())
    expected = np.empty(N)
    free_run(COEFFICIENTS, cycle.frames.inputs[:, 0].copy(), cycle.frames.position[0], expected)
    assert simulated.tobytes() == expected.tobytes()


def test_a_run_that_diverges_stays_a_number():
    wild = np.array([1e5, 1e5, 1e-3, 1e-3, 8.0, 1e3, 1e3, 1e3, 1e-3, 1.0])
    out = np.empty(N)
    free_run(wild, make_opening(), 0.0, out)
    assert np.isfinite(out).all()


def test_no_valve_within_the_bounds_of_the_fit_runs_away():
    rng = np.random.default_rng(0)
    low = np.array([1e-3] * 2 + [0.02] * 2 + [1.0, 0.01, 0.0, 0.0, 0.05])
    high = np.array([50.0] * 2 + [1.5] * 2 + [8.0, 1.2, 1e3, 1e3, 20.0])
    largest, out = [], np.empty(500)
    for _ in range(50):
        values = low + (high - low) * rng.random(9) ** 3
        free_run(np.append(values, 1.0), np.repeat(rng.uniform(-1.0, 1.0, 10), 50), 0.0, out)
        largest.append(np.abs(out).max())
    assert max(largest) < 1e5  # half of them came to 1e6
