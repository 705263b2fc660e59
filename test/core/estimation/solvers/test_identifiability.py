# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A ridge is found, its combination is told, the rest is refused."""

import numpy as np
import pytest

from valve_twin.core.estimation.solvers.identifiability import (
    IdentifiabilityOptions,
    assess_identifiability,
    information_root,
)

TIME = np.linspace(0.0, 2.0, 400)
NAMES = ("mass", "stiffness", "damping", "gain")


def creep(p):
    """Return the step response of a spool so light that its mass hardly shows: rate k/d."""
    mass, stiffness, damping, gain = p
    matrix = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
    values, vectors = np.linalg.eig(matrix)
    start = np.linalg.solve(vectors, np.array([-1.0, 0.0]))
    motion = np.exp(np.outer(TIME, values)) @ (start * vectors[0])
    return gain * (1.0 + np.real(motion))


def sensitivity(model, p):
    """Differentiate a model by each of its parameters [unit of the output / own unit]."""
    steps = 1e-5 * np.diag(p)
    return np.column_stack([(model(p + s) - model(p - s)) / (2.0 * s.sum()) for s in steps])


LIGHT = np.array([1e-4, 200.0, 50.0, 0.8])


@pytest.mark.parametrize("rooted", [False, True])
def test_a_light_spool_tells_stiffness_over_damping_only(rooted):
    matrix = sensitivity(creep, LIGHT)
    if rooted:
        matrix = information_root(matrix.T @ matrix)
    found = assess_identifiability(NAMES, LIGHT, matrix, 1e-3)
    assert found.identified.tolist() == [False, False, False, True]
    assert found.reasons[0] == "mass has no effect above the noise"
    (ratio,) = found.combinations
    assert ratio.text == "stiffness/damping"
    assert ratio.exponents == (1.0, -1.0)
    assert ratio.value == pytest.approx(4.0)
    assert ratio.relative_error < 0.01
    assert "stiffness and damping are not told apart; known: stiffness/damping = 4" in found.reason


def test_a_heavy_spool_tells_everything_but_a_common_factor():
    p = np.array([10.0, 200.0, 50.0, 0.8])
    found = assess_identifiability(NAMES, p, sensitivity(creep, p), 1e-3)
    assert found.identified.tolist() == [False, False, False, True]
    assert [c.text for c in found.combinations] == ["mass/damping", "stiffness/damping"]
    assert [c.value for c in found.combinations] == pytest.approx([0.2, 4.0])
    known = assess_identifiability(NAMES[1:], p[1:], sensitivity(creep, p)[:, 1:], 1e-3)
    assert known.identified.all()
    assert known.reason == ""
    assert known.combinations == ()


def test_errors_are_those_of_least_squares():
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(50, 3)) @ np.array([[1, 0.5, 0], [0, 1, 2e-7], [0, 0, 1e-6]])
    values = np.array([2.0, 0.3, 5e4])
    found = assess_identifiability("abc", values, matrix, 0.1)
    covariance = 0.01 * np.linalg.inv(matrix.T @ matrix)
    assert found.errors == pytest.approx(np.sqrt(np.diag(covariance)) / values, rel=1e-8)
    scaled = matrix / np.linalg.norm(matrix, axis=0)
    assert found.condition_number == pytest.approx(np.linalg.cond(scaled))
    assert found.identified.all()


def test_the_published_error_of_a_combination_is_its_scatter():
    rng = np.random.default_rng(2)
    u = rng.normal(size=300)
    matrix = np.column_stack([u, u + 1e-4 * rng.normal(size=300)])
    truth = np.array([3.0, 2.0])
    found = assess_identifiability("ab", truth, matrix, 0.05)
    (product,) = found.combinations
    fits = [
        np.linalg.lstsq(matrix, matrix @ truth + 0.05 * rng.normal(size=300), rcond=None)[0]
        for _ in range(400)
    ]
    # first-order: the logarithm of the product moves with exponents / value
    moves = (np.array(fits) - truth) @ (np.array(product.exponents) / truth)
    assert float(np.std(moves)) == pytest.approx(product.relative_error, rel=0.15)
    assert product.exponents[1] == pytest.approx(2.0 / 3.0, abs=0.01)


def test_a_leak_that_a_constant_command_hides_is_a_sum():
    command = np.full(200, 0.3)
    matrix = np.column_stack([command, -np.ones(200)])
    found = assess_identifiability(
        ("K_in", "leak"), np.array([0.01, 0.0]), matrix, 1e-4, sizes=np.array([0.01, 0.003])
    )
    assert not found.identified.any()
    (speed,) = found.combinations
    assert speed.text == "1*K_in -3.33*leak"
    assert speed.value == pytest.approx(0.01)
    assert speed.relative_error == pytest.approx(1e-4 / np.sqrt(200) / 0.3 / 0.01, rel=1e-6)


def test_two_ridges_are_kept_apart():
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, 100))
    matrix = np.column_stack([a, b, a, c, -b])
    found = assess_identifiability("vwxyz", np.ones(5), matrix, 1e-3)
    assert [c.text for c in found.combinations] == ["v*x", "w/z"]
    assert found.ridges == (("v", "x"), ("w", "z"))
    assert found.identified.tolist() == [False, False, False, True, False]


def test_what_is_weak_by_itself_is_no_ridge():
    found = assess_identifiability("ab", np.ones(2), np.diag([1.0, 1.0]) @ [[9, 0], [0, 2.5]], 2.0)
    assert found.identified.tolist() == [True, False]
    assert (found.ridges, found.combinations) == ((), ())
    assert found.reason == "b has no effect above the noise"
    matrix = np.array([[9.0, 4.0, 4.0], [0.0, 3.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.9]])
    weak = assess_identifiability("abc", np.ones(3), matrix, 1.0)
    assert weak.reason == "c is known to 74% only"


def test_a_record_that_tells_nothing_is_refused_whole():
    found = assess_identifiability("ab", np.ones(2), np.zeros((5, 2)), 1.0)
    assert not found.identified.any()
    assert np.isinf(found.errors).all()
    assert np.isnan(found.condition_number)
    one_row = assess_identifiability("ab", np.ones(2), np.ones((1, 2)), 1e-3)
    assert [c.text for c in one_row.combinations] == ["a*b"]
    loose = IdentifiabilityOptions(max_error=1e9)
    assert assess_identifiability("ab", np.ones(2), np.eye(2), 1.0, options=loose).identified.all()
