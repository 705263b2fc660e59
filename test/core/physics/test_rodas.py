# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Order, stability and solutions inside a step of the Rosenbrock method."""

import numpy as np
import pytest

from valve_twin.core.physics import rodas


def step(y, h, f, jacobian):
    """One step, as a valve's integrator makes it; returns state, increments."""
    k = np.empty((rodas.STAGES, len(y)))
    matrix, pivot, point = np.empty((len(y), len(y))), np.empty(len(y), dtype=np.int64), y.copy()
    rodas.shift(jacobian(y), h, matrix)
    assert rodas.factorise(matrix, pivot)
    for i in range(rodas.STAGES):
        rodas.stage_point(y, k, i, point)
        k[i] = f(point)
        rodas.stage_load(k, i, h)
        rodas.solve(matrix, pivot, k[i])
    return point + k[-1], k


def pendulum(y):
    return np.array([y[1], -np.sin(y[0]) - 0.3 * y[1] ** 3])


def pendulum_jacobian(y):
    return np.array([[0.0, 1.0], [-np.cos(y[0]), -0.9 * y[1] ** 2]])


def swing(steps):
    y = np.array([1.0, 0.5])
    for _ in range(steps):
        y, _ = step(y, 6.0 / steps, pendulum, pendulum_jacobian)
    return y


@pytest.mark.no_cover
def test_is_of_order_4():
    exact = swing(1000)
    errors = [np.abs(swing(n) - exact).max() for n in (20, 40, 80)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders == pytest.approx([4.0, 4.0], abs=0.3)


def test_solution_inside_a_step_is_of_order_3():
    y, point = np.array([1.0, 0.5]), np.empty(2)
    errors = []
    for h in (0.8, 0.4, 0.2):
        middle = y
        for _ in range(200):
            middle, _ = step(middle, 0.5 * h / 200, pendulum, pendulum_jacobian)
        new, k = step(y, h, pendulum, pendulum_jacobian)
        rodas.inside(y, new, k, 0.5, point)
        errors.append(np.abs(point - middle).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (orders > 3.4).all()  # local order 4 of a solution of order 3


def test_damps_what_is_infinitely_stiff():
    rate = 1e12
    new, _ = step(
        np.array([1.0]), 1.0, lambda y: -rate * y, lambda _: np.array([[-rate]])
    )  # one step over 1e12 time constants
    assert abs(new[0]) < 1e-10


@pytest.mark.parametrize("size", [1, 5, 13])
def test_solves_linear_systems_with_exchanged_rows(size):
    rng = np.random.default_rng(size)
    matrix = rng.standard_normal((size, size))
    matrix[0, 0] = 0.0 if size > 1 else 1.0
    right = rng.standard_normal(size)
    expected = np.linalg.solve(matrix, right)
    pivot = np.empty(size, dtype=np.int64)
    assert rodas.factorise(matrix, pivot)
    rodas.solve(matrix, pivot, right)
    np.testing.assert_allclose(right, expected, rtol=1e-10)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_refuses_a_matrix_that_cannot_be_factorised(value):
    matrix = np.full((3, 3), value)
    assert not rodas.factorise(matrix, np.empty(3, dtype=np.int64))


def test_shrinks_a_step_whose_error_is_no_number():
    assert rodas.next_step(1.0, np.nan, 0.0, 1.0) == pytest.approx(0.2)
    assert rodas.next_step(1.0, 0.0, 0.0, 1.0) == pytest.approx(5.0)
    assert rodas.next_step(1.0, 1.0, 0.0, 1.0) == pytest.approx(0.9)


def test_expects_an_error_that_grew_to_go_on_growing():
    steady = rodas.next_step(1.0, 0.5, 1.0, 0.5)
    assert steady == pytest.approx(0.9 * 0.5**-0.25)
    assert rodas.next_step(1.0, 0.5, 1.0, 0.1) < steady
    assert rodas.next_step(1.0, 0.5, 1.0, 0.9) == pytest.approx(steady)
