# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The constrained least squares is exact: enumeration, BVLS, cvxpy, optimality conditions."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from valve_twin.core.valves.press_cartridge.estimation.constraints import (
    Inequalities,
    no_inequalities,
    parse_inequalities,
    physical_inequalities,
)
from valve_twin.core.valves.press_cartridge.estimation.qp import (
    KKT_TOLERANCE,
    column_condition,
    quadratic_cost,
    solve_qp,
    solve_qp_cvxpy,
)
from valve_twin.core.valves.press_cartridge.estimation.regression import Gram

PHYSICS = physical_inequalities()
PAPER = physical_inequalities(extended=False)


def gram_of(u, y):
    return Gram(u.T @ u, u.T @ y, float(y @ y), len(y))


def free(k):
    return no_inequalities(tuple(f"p{i}" for i in range(k)))


def random_problem(seed, k=8, rows=60):
    """Rows of very different scale, with an optimum that violates some of the physics."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(rows, k)) * 10.0 ** rng.uniform(-4, 0, k)
    theta = rng.normal(size=k) / np.linalg.norm(u, axis=0)
    return u, u @ theta + 0.3 * rng.normal(size=rows) * np.linalg.norm(u @ theta) / rows**0.5


def enumerated(u, y, limits):
    """Return the least cost of the feasible solutions on all active sets."""
    length = np.linalg.norm(u, axis=0)
    g, f = (u / length).T @ (u / length), (u / length).T @ y
    a = limits.matrix / length
    norm = np.linalg.norm(a, axis=1)
    a, b = a / norm[:, None], limits.bound / norm
    k, best = len(f), np.inf
    size = np.linalg.norm(y)
    for count in range(min(k, len(b)) + 1):
        for active in itertools.combinations(range(len(b)), count):
            rows = list(active)
            kkt = np.block([[g, a[rows].T], [a[rows], np.zeros((count, count))]])
            s = np.linalg.lstsq(kkt, np.r_[f, b[rows]], rcond=None)[0][:k]
            if (a @ s <= b + 1e-13 * size).all():
                best = min(best, float(np.sum((u @ (s / length) - y) ** 2)))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_cost_is_that_of_enumerating_the_active_sets(seed):
    u, y = random_problem(seed, k=4)
    limits = PHYSICS.part([0, 1, 2, 4])
    solution = solve_qp(gram_of(u, y), limits)
    cost = np.sum((u @ solution.theta - y) ** 2)
    assert solution.solved
    assert abs(cost - enumerated(u, y, limits)) <= 1e-12 * float(y @ y)


@pytest.mark.parametrize("seed", range(20))
def test_bounds_are_those_of_bvls(seed):
    u, y = random_problem(seed)
    solution = solve_qp(gram_of(u, y), PAPER)
    lower = [-1.0, 0.0, -np.inf, -np.inf, 0.0, -np.inf, 0.0, 0.0]
    upper = [0.0, np.inf, 0.0, 0.0, np.inf, np.inf, np.inf, np.inf]
    scale = np.linalg.norm(u, axis=0)
    exact = lsq_linear(
        u / scale, y, (np.array(lower) * scale, np.array(upper) * scale), method="bvls", tol=1e-14
    )
    cost = np.sum((u @ solution.theta - y) ** 2)
    assert cost <= np.sum((u @ (exact.x / scale) - y) ** 2) + 1e-12 * float(y @ y)
    assert solution.theta * scale == pytest.approx(exact.x, abs=1e-7 * float(np.linalg.norm(y)))


@given(st.integers(0, 10**6), st.integers(1, 8), st.booleans())
def test_optimality_conditions_hold_to_rounding(seed, k, singular):
    rng = np.random.default_rng(seed)
    u, y = random_problem(seed, k)
    if singular and k > 1:
        u[:, 0] = 0.0 if seed % 2 else u[:, -1] * 0.5
    limits = PHYSICS.part(sorted(rng.choice(8, k, replace=False)))
    solution = solve_qp(gram_of(u, y), limits)
    assert solution.solved
    assert solution.kkt <= KKT_TOLERANCE
    scale = np.maximum(np.abs(limits.matrix) @ np.abs(solution.theta), np.abs(limits.bound))
    assert (limits.matrix @ solution.theta - limits.bound <= 1e-9 * scale + 1e-15).all()


@given(st.integers(0, 10**6))
def test_constraints_cost_and_a_feasible_optimum_stays(seed):
    u, y = random_problem(seed)
    g = gram_of(u, y)
    least, bounded = solve_qp(g, free(8)), solve_qp(g, PHYSICS)
    slack = 1e-12 * float(y @ y)
    assert quadratic_cost(g, bounded.theta) >= quadratic_cost(g, least.theta) - slack
    inside = Inequalities(
        PHYSICS.names, PHYSICS.matrix, PHYSICS.matrix @ least.theta + 1.0, PHYSICS.labels
    )
    again = solve_qp(g, inside)
    scale = np.linalg.norm(u, axis=0)
    assert again.theta * scale == pytest.approx(least.theta * scale, rel=1e-9, abs=1e-9)
    assert not again.active.any()


@given(st.integers(0, 10**6))
def test_bounds_hold_bit_for_bit(seed):
    u, y = random_problem(seed)
    theta = solve_qp(gram_of(u, y), PHYSICS).theta
    assert -1.0 <= theta[0] <= 0.0
    assert theta[1] >= 0.0 >= theta[2]
    assert theta[4] >= 0.0 >= theta[3]
    assert theta[6] >= 0.0
    assert theta[7] >= 0.0
    for speed in (theta[0], theta[0] + theta[6], theta[0] + theta[7]):
        assert -1.0 <= speed <= 1e-12


@pytest.mark.parametrize("limits", [PAPER, PHYSICS])
@pytest.mark.parametrize("seed", range(6))
def test_cvxpy_states_the_same_problem(seed, limits):
    u, y = random_problem(seed)
    g = gram_of(u, y)
    reference, exact = solve_qp_cvxpy(u, y, limits), solve_qp(g, limits)
    cost = np.sum((u @ exact.theta - y) ** 2)
    assert cost == pytest.approx(reference.cost, rel=1e-6)


@pytest.mark.parametrize("shut", [(2, 4, 5, 7), (1, 3, 5, 6), (5,)])
def test_a_shut_pilot_group_leaves_its_terms_at_zero_in_both(shut):
    u, y = random_problem(3)
    u[:, shut] = 0.0
    exact, reference = solve_qp(gram_of(u, y), PHYSICS), solve_qp_cvxpy(u, y, PHYSICS)
    assert (exact.theta[list(shut)] == 0.0).all()
    assert exact.kkt <= KKT_TOLERANCE
    assert np.sum((u @ exact.theta - y) ** 2) == pytest.approx(reference.cost, rel=1e-6)


def test_dependent_columns_have_the_cost_of_one():
    u, y = random_problem(4, k=3)
    both = np.column_stack([u, 0.4 * u[:, 2]])
    one, two = solve_qp(gram_of(u, y), free(3)), solve_qp(gram_of(both, y), free(4))
    assert two.cost == pytest.approx(one.cost, rel=1e-10)
    assert two.kkt <= KKT_TOLERANCE


def test_no_motion_at_all_is_solved_by_zero():
    solution = solve_qp(Gram(np.zeros((8, 8)), np.zeros(8), 0.0, 100), PHYSICS)
    assert solution.solved
    assert (solution.theta == 0.0).all()


def test_a_users_inequality_binds_exactly():
    u, y = random_problem(5)
    limits = PAPER + parse_inequalities(["theta_2 + 0.3*theta_3 >= 5.0", "theta_2 <= 30"])
    exact, reference = solve_qp(gram_of(u, y), limits), solve_qp_cvxpy(u, y, limits)
    assert exact.solved
    assert exact.theta[1] + 0.3 * exact.theta[2] >= 5.0 - 1e-12
    assert np.sum((u @ exact.theta - y) ** 2) == pytest.approx(reference.cost, rel=1e-6)


def test_an_equation_is_met():
    u, y = random_problem(6, k=3)
    names = ("p0", "p1", "p2")
    solution = solve_qp(gram_of(u, y), parse_inequalities(["p0 - 2*p1 == 0.25"], names))
    assert solution.solved
    assert solution.theta[0] - 2 * solution.theta[1] == pytest.approx(0.25, rel=1e-12)


def test_constraints_that_contradict_each_other_are_a_refusal():
    u, y = random_problem(7)
    impossible = PAPER + parse_inequalities(["theta_2 <= -1"])
    exact, reference = solve_qp(gram_of(u, y), impossible), solve_qp_cvxpy(u, y, impossible)
    assert not exact.solved
    assert exact.reason == "the constraints contradict each other"
    assert np.isnan(exact.theta).all()
    assert not reference.solved
    assert "infeasible" in reference.reason


def test_a_constraint_on_terms_that_are_not_fitted_is_named():
    u, y = random_problem(7, k=2)
    limits = (PAPER + parse_inequalities(["theta_5 >= 0.01"])).part([0, 1])
    solution = solve_qp(gram_of(u, y), limits)
    assert not solution.solved
    assert '"theta_5 >= 0.01"' in solution.reason


def test_condition_number_is_that_of_the_scaled_columns():
    u, _ = random_problem(8, k=4)
    expected = np.linalg.cond(u / np.linalg.norm(u, axis=0))
    assert column_condition(gram_of(u, u[:, 0])) == pytest.approx(expected, rel=1e-9)
    u[:, 1] = 0.0
    kept = np.delete(u, 1, axis=1)
    expected = np.linalg.cond(kept / np.linalg.norm(kept, axis=0))
    assert column_condition(gram_of(u, u[:, 0])) == pytest.approx(expected, rel=1e-9)
    assert column_condition(Gram(np.zeros((2, 2)), np.zeros(2), 0.0, 0)) == float("inf")
