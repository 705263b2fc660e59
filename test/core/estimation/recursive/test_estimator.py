# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Recursive Hammerstein-Wiener identification: closed forms, published numbers, bias, speed."""

from __future__ import annotations

import itertools
from statistics import median
from time import process_time

import numpy as np
import pytest

from valve_twin.core.estimation.recursive.estimator import (
    Adaptation,
    Structure,
    adapt,
    adapt_corrected,
    fits,
    free_run,
    identify,
    project_stable,
    reset_gain,
    start,
    start_corrected,
)
from valve_twin.core.estimation.recursive.kernel import is_stable
from valve_twin.core.prediction import fit_percent

KNOWN = Structure(na=2, nb=2, nk=1, nl=3)
TRUTH = np.array([-1.5, 0.7, 0.12, 0.06, 0.05, 0.02, -0.03, -0.02])
PAPER = Structure(na=3, nb=2, nk=2, nl=3)
PRINTED = np.array(
    [-0.8512, -0.1351, -0.03855, -0.1675, -0.1039, 0.59831, -0.00047669, 0.030651, -0.042948]
)
"""Paper 004, eq. (11)-(13)."""


def make_record(seed, noise, n=3000):
    """Return input, noise-free and measured output of the known system."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 10 + 1), 10)[:n] + 0.3 * rng.standard_normal(n)
    clean = free_run(TRUTH, KNOWN, np.zeros(n), u)
    clean[np.isnan(clean)] = 0.0
    return u, clean, clean + noise * rng.standard_normal(n)


def regressors(y, u):
    """Return the rows (N - 2, 4) and outputs of a plain ARX(2, 2) without powers."""
    rows = np.column_stack([-y[1:-1], -y[:-2], u[1:-1], u[:-2]])
    return rows, y[2:]


def learn_in_numpy(y, u, gain):
    """Recursive least squares as libraries write it: the peer of the speed test."""
    theta, f = np.zeros(4), gain * np.eye(4)
    rows, outputs = regressors(y, u)
    for phi, output in zip(rows, outputs, strict=True):
        f -= np.dot(np.dot(np.dot(f, phi[:, None]), phi[None, :]), f) / (1.0 + phi @ f @ phi)
        theta += np.dot(f, phi) * (output - np.dot(theta, phi))
    return theta


def test_without_output_powers_it_is_batch_least_squares():
    u, _, y = make_record(1, 0.05, n=400)
    got = identify(
        Structure(2, 2), y, u, adaptation=Adaptation(initial_gain=1e12), corrected=False
    )
    rows, outputs = regressors(y, u)
    batch = np.linalg.lstsq(rows, outputs, rcond=None)[0]
    assert got.state.theta == pytest.approx(batch, abs=1e-9)
    assert got.state.gain == pytest.approx(np.linalg.inv(rows.T @ rows), rel=1e-6)


def test_the_factors_follow_the_printed_gain_update():
    u, _, y = make_record(2, 0.02, n=60)
    state = start(Structure(2, 2), Adaptation(initial_gain=5.0))
    f = 5.0 * np.eye(4)
    rows, _ = regressors(y, u)
    for phi in rows:
        f -= np.outer(f @ phi, phi @ f) / (1.0 + phi @ f @ phi)
    got = adapt(Structure(2, 2), Adaptation(initial_gain=5.0), state, y, u).state
    assert got.gain == pytest.approx(f, rel=1e-9)


def test_learns_a_known_system_exactly_without_noise():
    u, clean, _ = make_record(3, 0.0)
    got = identify(KNOWN, clean, u, adaptation=Adaptation(initial_gain=1e6), corrected=False)
    assert got.state.theta == pytest.approx(TRUTH, abs=2e-3)


@pytest.mark.no_cover
@pytest.mark.parametrize("seeds", [6, pytest.param(20, marks=pytest.mark.slow)])
def test_the_corrected_variant_runs_free_within_2_percent_of_the_noise_free_output(seeds):
    corrected, literal, ceiling = [], [], []
    for seed in range(seeds):
        u, clean, y = make_record(seed, 0.02)
        got = identify(KNOWN, y, u).state.theta
        corrected.append(fit_percent(clean, free_run(got, KNOWN, clean, u)))
        biased = identify(KNOWN, y, u, corrected=False)
        literal.append(fits(KNOWN, biased, y, u, skip=200).free_run)
        ceiling.append(fit_percent(y, clean))
    assert np.mean(corrected) >= 98.0  # measured 99.8
    assert 92.0 <= np.mean(literal) <= 94.5  # the published kind of fit, measured 93.6
    assert np.mean(ceiling) == pytest.approx(96.5, abs=0.5)


def test_the_literal_parameters_are_biased_and_the_corrected_are_not():
    u, _, y = make_record(5, 0.05)
    literal = identify(KNOWN, y, u, corrected=False).state.theta
    corrected = identify(KNOWN, y, u).state.theta
    assert abs(literal[0] - TRUTH[0]) > 0.2
    assert abs(corrected[0] - TRUTH[0]) < 0.01


def test_three_fits_are_kept_apart():
    u, _, y = make_record(6, 0.05)
    got = fits(KNOWN, identify(KNOWN, y, u, corrected=False), y, u, skip=500)
    assert got.a_posteriori > got.a_priori > got.free_run
    assert max(got.a_posteriori, got.a_priori, got.free_run) <= 100.0


@pytest.mark.parametrize("corrected", [False, True])
def test_blocks_of_any_length_give_the_same_bits(corrected):
    u, _, y = make_record(7, 0.02, n=600)
    how = Adaptation(forgetting=0.995)
    learn = adapt_corrected if corrected else adapt
    state = start(KNOWN, how)
    if corrected:
        state = start_corrected(KNOWN, how, state)
    whole = learn(KNOWN, how, state, y, u)
    prior = []
    for a, b in itertools.pairwise((0, 1, 2, 150, 151, 600)):
        part = learn(KNOWN, how, state, y[a:b], u[a:b])
        state = part.state
        prior.append(part.prior)
    assert np.array_equal(np.concatenate(prior), whole.prior, equal_nan=True)
    assert np.array_equal(state.theta, whole.state.theta)
    assert np.array_equal(state.upper, whole.state.upper)


def test_forgetting_follows_a_change_and_stays_bounded_at_rest():
    structure = Structure(1, 1)
    rng = np.random.default_rng(8)
    n = 4000
    u = rng.standard_normal(n)
    u[1000:3000] = 0.0  # nothing excites: unbounded forgetting would blow the gain up
    y = np.zeros(n)
    for t in range(1, n):
        gain = 0.5 if t < 3000 else 0.6
        y[t] = 0.8 * y[t - 1] + gain * u[t - 1]
    how = Adaptation(forgetting=0.98, max_trace=10.0)
    resting = identify(structure, y[:3000], u[:3000], adaptation=how, corrected=False).state
    assert np.trace(resting.gain) <= 10.0 * (1 + 1e-9)
    assert resting.diagonal.min() > 0.0
    moved = adapt(structure, how, resting, y[3000:], u[3000:]).state
    assert moved.theta == pytest.approx([-0.8, 0.6], abs=1e-3)


def test_a_reset_of_the_gain_lets_an_old_adaptation_follow_again():
    u, _, y = make_record(9, 0.0)
    how = Adaptation()
    old = adapt(Structure(2, 2), how, start(Structure(2, 2), how), y, u).state
    stiff = adapt(Structure(2, 2), how, old, 2.0 * y[:300], u[:300]).state
    agile = adapt(Structure(2, 2), how, reset_gain(old, 1e3), 2.0 * y[:300], u[:300]).state
    rows, outputs = regressors(2.0 * y[:300], u[:300])
    new = np.linalg.lstsq(rows, outputs, rcond=None)[0]
    assert np.linalg.norm(agile.theta - new) < 0.05 * np.linalg.norm(stiff.theta - new)


def test_the_printed_transfer_function_is_unstable_and_is_projected():
    poles = np.roots(np.concatenate([[1.0], PRINTED[:3]]))
    assert np.abs(poles).max() == pytest.approx(1.02059, abs=1e-4)  # 004-pole
    assert not is_stable(PRINTED, 3, 1.0)
    safe = project_stable(PRINTED, PAPER, radius=0.99)
    assert np.abs(np.roots(np.concatenate([[1.0], safe[:3]]))).max() == pytest.approx(0.99)
    assert is_stable(safe, 3, 0.991)
    assert np.array_equal(safe[3:], PRINTED[3:])


def test_a_free_run_that_diverges_has_a_bad_fit_and_no_overflow():
    n = 4000
    u = np.random.default_rng(13).standard_normal(n)
    y = np.cumsum(u) / n
    simulated = free_run(PRINTED, PAPER, y, u)
    assert np.abs(simulated[-100:]).max() == 1e9
    assert -1e15 < fit_percent(y, simulated) < -1e6


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_the_schur_recursion_agrees_with_the_roots(order):
    rng = np.random.default_rng(order)
    for _ in range(200):
        roots = rng.uniform(-1.3, 1.3, order)
        a = np.asarray(np.poly(roots)[1:], dtype=np.float64)
        assert is_stable(a, order, 1.0) == (np.abs(roots).max() < 1.0)


def test_a_gap_forgets_the_past_and_not_the_parameters():
    u, _, y = make_record(10, 0.02, n=1000)
    y[500] = np.nan
    got = identify(KNOWN, y, u, corrected=False)
    assert np.isnan(got.prior[500:503]).all()
    assert np.isfinite(got.prior[503:]).all()
    assert np.isfinite(got.state.theta).all()


def test_the_corrected_variant_survives_what_it_cannot_model():
    rng = np.random.default_rng(11)
    y = np.cumsum(rng.standard_normal(2000)) * 10.0
    got = identify(KNOWN, y, rng.standard_normal(2000))
    assert np.isfinite(got.state.theta).all()
    assert is_stable(got.state.theta, 2, 1.0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Structure(0, 1), r"Structure\.na = 0: must be at least 1"),
        (lambda: Adaptation(forgetting=1.5), r"Adaptation\.forgetting = 1\.5: must be from 0\.5"),
    ],
)
def test_refuses_what_is_no_model(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_sample_costs_less_than_half_of_a_numpy_one():
    u, _, y = make_record(12, 0.02, n=2000)
    how = Adaptation(initial_gain=100.0)
    ours, peers = [], []
    for _ in range(5):
        began = process_time()
        got = identify(Structure(2, 2), y, u, adaptation=how, corrected=False)
        between = process_time()
        peer = learn_in_numpy(y, u, 100.0)
        ours.append(between - began)
        peers.append(process_time() - between)
    assert got.state.theta == pytest.approx(peer, abs=1e-6)
    assert median(ours) < 0.5 * median(peers)
