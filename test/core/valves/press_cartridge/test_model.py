# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press valve's model: prediction kernel, options, and cycles that say nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from test.core.valves import blocks
from test.core.valves.press_cartridge.generator import Truth, generate_cycle
from valve_twin.core.estimation.cycle.memory import Memory
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.quantity import describe
from valve_twin.core.types import Cycle, EstimateStatus, ParameterStatus, Validity
from valve_twin.core.valves.press_cartridge import MODEL
from valve_twin.core.valves.registry import complete_options, get_model

PERIOD_S = 0.03
OPTIONS = complete_options(MODEL, {})
QUIET = Truth(sigma=0.0, process_noise=0.0)


def make_cycle(truth=QUIET, seed=0, number=1):
    return generate_cycle(truth, np.random.default_rng(seed), number=number)


def predict(cycle, coefficients, restart=None, cuts=()):
    restart = blocks.marked(len(cycle.frames)) if restart is None else restart
    return blocks.predict(MODEL, coefficients, cycle.frames, restart, cuts)


def gains(truth):
    """Return the published parameters of a truth."""
    return {
        "pole": truth.pole,
        "K_in": truth.k_in,
        "K_in_slope": 0.0,
        "v_in_mean": 0.5,
        "K_out": truth.k_out,
        "K_out_slope": truth.k_out_slope,
        "leak": truth.leak / truth.period_s,
    }


def test_registered():
    assert get_model("press_cartridge") is MODEL


@pytest.mark.parametrize("pole", [0.0, 0.1, 0.4])
@pytest.mark.parametrize("lag", [0, 1, 2, 4])
def test_one_step_prediction_and_free_run_are_exact_without_noise(pole, lag):
    truth = replace(QUIET, pole=pole, lag=lag)
    cycle = make_cycle(truth)
    coefficients = MODEL.coefficients(gains(truth), lag, PERIOD_S, OPTIONS)
    predicted, simulated, validity = predict(cycle, coefficients)
    position = cycle.frames.position
    known = validity != Validity.STARTING
    assert np.count_nonzero(~known) == max(2, lag)
    np.testing.assert_allclose(predicted[known], position[known], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(simulated, position, rtol=0.0, atol=1e-12)


@given(st.data())
def test_blocks_of_any_length_give_the_same_bits(data):
    cycle = make_cycle(Truth(), seed=3)
    n = len(cycle.frames)
    cuts = data.draw(st.lists(st.integers(0, n), max_size=12))
    restart = np.array(
        data.draw(st.lists(st.sampled_from([0, 0, 0, 1, 2, 3]), min_size=40, max_size=40))
    )
    restart = np.resize(restart, n).astype(np.uint8)
    coefficients = MODEL.coefficients(gains(Truth()), 2, PERIOD_S, OPTIONS)
    whole = predict(cycle, coefficients, restart)
    parts = predict(cycle, coefficients, restart, cuts)
    for a, b in zip(whole, parts, strict=True):
        assert a.tobytes() == b.tobytes()


def test_prediction_uses_the_past_only():
    cycle = make_cycle(Truth(), seed=1)
    coefficients = MODEL.coefficients(gains(Truth()), 2, PERIOD_S, OPTIONS)
    before = predict(cycle, coefficients)[0]
    changed = cycle.frames.position.copy()
    changed[100] += 0.5
    after = predict(replace(cycle, frames=replace(cycle.frames, position=changed)), coefficients)[
        0
    ]
    np.testing.assert_array_equal(before[:101], after[:101])
    assert after[101] != before[101]


def test_free_run_stays_between_the_seats():
    truth = replace(QUIET, leak=1e-3)
    cycle = make_cycle(truth)
    inputs = cycle.frames.inputs.copy()
    inputs[300:600] = [0.8, 0.0]
    coefficients = MODEL.coefficients(gains(truth), 2, PERIOD_S, OPTIONS)
    pushed = replace(cycle, frames=replace(cycle.frames, inputs=inputs))
    simulated = predict(pushed, coefficients)[1]
    assert simulated.min() == 0.0
    assert simulated.max() == 1.0


def test_marks_what_a_prediction_is_worth():
    cycle = make_cycle(Truth(), seed=2)
    frames = cycle.frames
    position = frames.position.copy()
    position[40] = position[39]  # the sensor repeats a value in motion
    position[50] = np.nan
    restart = blocks.marked(len(position), {50: 3, 60: 2})
    coefficients = MODEL.coefficients(gains(Truth()), 2, PERIOD_S, OPTIONS)
    predicted, _, validity = predict(
        replace(cycle, frames=replace(frames, position=position)), coefficients, restart
    )
    assert list(validity[:3]) == [Validity.STARTING, Validity.STARTING, Validity.AT_SEAT]
    assert validity[39:41].tolist() == [Validity.VALID, Validity.STALE]
    assert validity[50] == Validity.BAD_INPUT
    assert np.isfinite(predicted[50:60]).all()  # the gap in the position is bridged
    assert validity[60:63].tolist() == [Validity.STARTING, Validity.STARTING, Validity.VALID]
    assert np.isnan(predicted[60:62]).all()


def test_a_new_cycle_starts_the_free_run_and_keeps_the_past():
    cycle = make_cycle(Truth(), seed=4)
    restart = blocks.marked(len(cycle.frames), {300: 1})
    coefficients = MODEL.coefficients(gains(Truth()), 2, PERIOD_S, OPTIONS)
    plain = predict(cycle, coefficients)
    cut = predict(cycle, coefficients, restart)
    np.testing.assert_array_equal(plain[0], cut[0])
    assert cut[1][300] == cycle.frames.position[300]


def test_theta_predicts_as_the_paper_says():
    theta = {"theta_1": -0.9, "theta_2": 0.0091, "theta_3": -0.0505, "theta_5": 0.025}
    coefficients = MODEL.coefficients(theta, 2, PERIOD_S, OPTIONS)
    cycle = make_cycle(Truth(), seed=5)
    x, (v_in, v_out) = cycle.frames.position, cycle.frames.inputs.T
    n = np.arange(2, len(x))
    u = np.stack([x[n - 1] - x[n - 2], v_in[n - 2], v_out[n - 2], v_out[n - 2] ** 2])
    expected = 2 * x[n - 1] - x[n - 2] + np.array(list(theta.values())) @ u  # paper 002, eq. (32)
    got = predict(cycle, coefficients)[0][2:]
    np.testing.assert_allclose(got, np.clip(expected, 0.0, 1.0), rtol=0.0, atol=1e-15)


def test_a_gain_never_estimated_makes_no_model():
    values = gains(Truth())
    del values["K_out"]
    assert not np.isfinite(MODEL.coefficients(values, 2, PERIOD_S, OPTIONS)).all()


def test_every_estimator_publishes_declared_parameters():
    names = [c for d in describe(MODEL.options) if d.name == "estimators" for c in d.choices]
    options = complete_options(MODEL, {"estimators": names})
    estimates = MODEL.estimate(make_cycle(Truth(), seed=6), options)
    declared = {p.name for p in MODEL.parameters}
    assert [e.estimator for e in estimates] == names
    for estimate in estimates:
        assert estimate.status is not EstimateStatus.REFUSED
        assert {p.name for p in estimate.parameters} <= declared


def test_the_trend_has_its_estimator_whatever_is_configured():
    options = complete_options(MODEL, {"estimators": ["equation_error_ls3"]})
    estimates = MODEL.estimate(make_cycle(Truth(), seed=6), options)
    assert [e.estimator for e in estimates] == ["output_error", "equation_error_ls3"]


def test_without_the_output_error_only_what_is_listed_is_estimated_and_nothing_judged():
    options = complete_options(
        MODEL, {"estimators": ["equation_error_qp8"], "output_error": False, "lag": 2}
    )
    memory = Memory.empty()
    for number in range(1, 13):
        (estimate,), memory = estimate_cycle(
            MODEL, options, make_cycle(Truth(), seed=number, number=number), memory
        )
        assert estimate.estimator == "equation_error_qp8"
        assert np.isfinite(estimate.value("theta_1"))
        assert np.isnan(estimate.mse_test)
        assert not estimate.used_by_trend
    assert memory == Memory.empty()
    with_all, _ = estimate_cycle(
        MODEL, replace(options, output_error=True), make_cycle(Truth()), memory
    )
    alone, _ = estimate_cycle(MODEL, options, make_cycle(Truth()), memory)
    assert [p.value for p in with_all[1].parameters] == [p.value for p in alone[0].parameters]


def test_further_constraints_bind_the_equation_error():
    text = "theta_2 <= 0.005"
    options = complete_options(MODEL, {"constraints": [text]})
    estimate = MODEL.estimate(make_cycle(Truth(), seed=7), options)[-1]
    assert estimate.value("theta_2") == pytest.approx(0.005, abs=1e-12)
    limited = next(p for p in estimate.parameters if p.name == "theta_2")
    assert limited.status is ParameterStatus.AT_BOUND


def broken_cycles():
    cycle = make_cycle(Truth(), seed=8)
    frames, n = cycle.frames, len(cycle.frames)
    yield "one sample", frames[:1]
    yield "two samples", frames[:2]
    yield "at rest", frames[:30]
    yield "constant", replace(frames, position=np.full(n, 0.3))
    yield "position nan", replace(frames, position=np.full(n, np.nan))
    yield "inputs nan", replace(frames, inputs=np.full((n, 2), np.nan))
    yield "infinite", replace(frames, position=np.where(np.arange(n) % 2, np.inf, frames.position))
    yield "not valid", replace(frames, valid=np.zeros(n, bool))
    yield "no commands", replace(frames, inputs=np.zeros((n, 2)))
    yield "huge", replace(frames, position=frames.position * 1e100)


@pytest.mark.parametrize(
    ("what", "frames"), list(broken_cycles()), ids=lambda v: v if isinstance(v, str) else ""
)
def test_refuses_a_cycle_that_says_nothing(what, frames):
    options = complete_options(
        MODEL, {"estimators": ["output_error", "equation_error_ls3", "equation_error_qp8"]}
    )
    for estimate in MODEL.estimate(Cycle(1, PERIOD_S, frames), options):
        assert estimate.reason
        if what != "huge":
            assert estimate.status is EstimateStatus.REFUSED
            assert all(np.isnan(p.value) for p in estimate.parameters)
