# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The compiled solver is exact: certificates in rational arithmetic, degenerate and singular too.

A solution is proved optimal by solving its active set in fractions of integers and checking every
sign there; the objective gap is then a difference of exact numbers.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from valve_twin.core.valves.press_cartridge.estimation.constraints import (
    Inequalities,
    parse_inequalities,
    physical_inequalities,
)
from valve_twin.core.valves.press_cartridge.estimation.qp import solve_qp, solve_qp_general
from valve_twin.core.valves.press_cartridge.estimation.regression import Gram
from valve_twin.core.valves.press_cartridge.estimation.solvers.small_qp import (
    NOT_FOUND,
    SOLVED,
    solve_small,
)

PHYSICS = physical_inequalities(v_in_max=0.75, v_out_max=0.75)
GAP = 1e-12
"""Largest gap of the objective relative to its optimum."""


def gram_of(u, y):
    return Gram(u.T @ u, u.T @ y, float(y @ y), len(y))


def exact(values):
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(values)]


def eliminated(matrix, right):
    """Solve a rational system; free unknowns are zero; None where it has no solution."""
    rows = [[*row, r] for row, r in zip(matrix, right, strict=True)]
    n, pivots, at = len(matrix[0]), [], 0
    for column in range(n):
        pivot = next((i for i in range(at, len(rows)) if rows[i][column]), None)
        if pivot is None:
            continue
        rows[at], rows[pivot] = rows[pivot], rows[at]
        rows[at] = [x / rows[at][column] for x in rows[at]]
        for i in range(len(rows)):
            if i != at and rows[i][column]:
                factor = rows[i][column]
                rows[i] = [x - factor * p for x, p in zip(rows[i], rows[at], strict=True)]
        pivots.append(column)
        at += 1
    if any(row[-1] for row in rows[at:]):
        return None
    solution = [Fraction(0)] * n
    for row, column in zip(rows, pivots, strict=False):
        solution[column] = row[-1]
    return solution


def certified_cost(gram, limits, active):
    """Return the exact optimum on an active set after proving every sign, None if one is wrong."""
    g, v = exact(gram.matrix), exact(gram.vector)[0]
    a, b = exact(limits.matrix), exact(limits.bound)[0]
    k, rows = len(v), [i for i, on in enumerate(active) if on]
    kkt = [g[i] + [a[r][i] for r in rows] for i in range(k)]
    kkt += [a[r] + [Fraction(0)] * len(rows) for r in rows]
    solution = eliminated(kkt, v + [b[r] for r in rows])
    if solution is None or any(x < 0 for x in solution[k:]):
        return None
    theta = solution[:k]
    for row, limit in zip(a, b, strict=True):
        if sum(c * t for c, t in zip(row, theta, strict=True)) > limit:
            return None
    return exact_cost(gram, theta)


def exact_cost(gram, theta):
    g, v = exact(gram.matrix), exact(gram.vector)[0]
    theta = [Fraction(float(t)) if not isinstance(t, Fraction) else t for t in theta]
    k = range(len(v))
    quadratic = sum(theta[i] * g[i][j] * theta[j] for i in k for j in k)
    return Fraction(gram.power) - 2 * sum(v[i] * theta[i] for i in k) + quadratic


def compiled(gram, limits):
    """Return what the compiled solver says, without the general path behind it."""
    theta, active = np.empty(len(gram.vector)), np.empty(len(limits.bound), bool)
    found, cost, kkt = solve_small(
        np.array(gram.matrix, order="C"),
        gram.vector,
        gram.power,
        np.array(limits.matrix, order="C"),
        np.array(limits.bound),
        theta,
        active,
    )
    return found, theta, active, cost, kkt


def cycle_problem(seed, *, shut="", rows=80):
    """Regressor (R, 8) of a cycle, quantised so that the normal equations hold no rounding.

    shut leaves one pilot group ("in", "out") without a command, or both never on together
    ("product"): the normal case of a production cycle.
    """
    rng = np.random.default_rng(seed)
    dx = rng.integers(-64, 65, rows) / 64.0
    v_in, v_out = rng.integers(0, 17, (2, rows)) / 16.0
    if shut in ("in", "product"):
        v_in[: rows if shut == "in" else rows // 2] = 0.0
    if shut in ("out", "product"):
        v_out[0 if shut == "out" else rows // 2 :] = 0.0
    u = np.column_stack([dx, v_in, v_out, v_in**2, v_out**2, v_in * v_out, v_in * dx, v_out * dx])
    theta = rng.normal(size=8) * [1, 1, 1, 1, 1, 0, 1, 1] + [-0.5, 0.7, -0.7, 0, 0, 0, 0, 0]
    y = np.round(64.0 * (u @ theta + 0.3 * rng.normal(size=rows))) / 64.0
    return u, y


@pytest.mark.parametrize("shut", ["", "in", "out", "product"])
@pytest.mark.parametrize("seed", range(6))
def test_objective_gap_is_below_1e_12_of_the_optimum_proved_in_fractions(shut, seed):
    gram = gram_of(*cycle_problem(seed, shut=shut))
    found, theta, active, _, kkt = compiled(gram, PHYSICS)
    assert found == SOLVED
    assert kkt <= 1e-13
    best = certified_cost(gram, PHYSICS, _positive(gram, PHYSICS, theta, active))
    assert best is not None
    assert best > 0
    assert abs(exact_cost(gram, theta) / best - 1) <= GAP


def _positive(gram, limits, theta, active):
    """Return the active set without the rows whose multiplier is zero: they prove nothing."""
    unit = np.sqrt(np.where(np.diag(gram.matrix) > 0.0, np.diag(gram.matrix), 1.0))
    rows = np.flatnonzero(active)
    force = (gram.vector - gram.matrix @ theta) / unit
    multipliers = _nonnegative((limits.matrix[rows] / unit).T, force)
    kept = np.zeros(len(active), bool)
    kept[rows[multipliers > 1e-9 * max(1.0, np.abs(force).max())]] = True
    return kept


def _nonnegative(matrix, right):
    from scipy.optimize import nnls

    return nnls(matrix, right)[0] if matrix.shape[1] else np.zeros(0)


@given(st.integers(0, 10**6), st.sampled_from(["", "in", "out", "product"]))
def test_the_compiled_path_answers_every_cycle_of_the_physical_problem(seed, shut):
    gram = gram_of(*cycle_problem(seed, shut=shut, rows=40))
    found, theta, _, cost, kkt = compiled(gram, PHYSICS)
    assert found == SOLVED
    assert kkt <= 1e-12
    general = solve_qp_general(gram, PHYSICS)
    assert cost == pytest.approx(general.cost, rel=1e-9, abs=1e-12 * gram.power)
    assert theta[0] <= 0.0 <= theta[1]


@given(st.integers(0, 10**6), st.integers(2, 8), st.integers(0, 14))
def test_both_paths_agree_under_random_inequalities(seed, k, m):
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=(30, k)), rng.normal(size=30)
    rows = np.where(rng.random((m, k)) < 0.5, 0.0, rng.normal(size=(m, k)))
    bound = rng.normal(size=m) * rng.integers(0, 2, m)
    limits = Inequalities(
        tuple(f"p{i}" for i in range(k)), rows, bound, tuple(str(i) for i in range(m))
    )
    gram = gram_of(u, y)
    ours, general = solve_qp(gram, limits), solve_qp_general(gram, limits)
    assert ours.solved == general.solved
    if ours.solved:
        assert ours.cost == pytest.approx(general.cost, rel=1e-10)
        assert ours.theta == pytest.approx(general.theta, rel=1e-7, abs=1e-8)


def test_a_bound_through_the_free_optimum_is_active_without_a_multiplier():
    u, y = np.eye(3), np.array([0.5, -0.25, 2.0])
    limits = parse_inequalities(["p0 <= 0.5", "p1 >= -0.25", "p2 <= 1"], ("p0", "p1", "p2"))
    found, theta, active, cost, kkt = compiled(gram_of(u, y), limits)
    assert found == SOLVED
    assert theta.tolist() == [0.5, -0.25, 1.0]
    assert active.all()
    assert (cost, kkt <= 1e-15) == (1.0, True)


def test_redundant_and_repeated_inequalities_change_nothing():
    u, y = cycle_problem(3)
    twice = PHYSICS + PHYSICS + parse_inequalities(["2*theta_2 >= 0", "theta_1 + theta_3 <= 1e3"])
    _, once, *_ = compiled(gram_of(u, y), PHYSICS)
    found, theta, _, _, kkt = compiled(gram_of(u, y), twice)
    assert found == SOLVED
    assert kkt <= 1e-13
    assert theta == pytest.approx(once, rel=1e-12, abs=1e-14)


def test_as_many_active_inequalities_as_parameters_leave_a_corner():
    u, y = cycle_problem(4)
    corner = np.array([-0.5, 0.25, -0.25, -0.125, 0.125, 0.0, 0.25, 0.25])
    rows = np.vstack([np.eye(8), -np.eye(8)])
    labels = tuple(str(i) for i in range(16))
    limits = Inequalities(PHYSICS.names, rows, np.concatenate([corner, -corner]), labels)
    found, theta, active, _, kkt = compiled(gram_of(u, y), limits)
    assert found == SOLVED
    assert (theta == corner).all()
    assert active.all()
    assert kkt <= 1e-13


def test_dependent_columns_are_solved_to_the_same_residual():
    u, y = cycle_problem(5)
    u[:, 3] = 0.5 * u[:, 1]
    found, theta, _, cost, kkt = compiled(gram_of(u, y), PHYSICS)
    assert found == SOLVED
    assert kkt <= 1e-12
    general = solve_qp_general(gram_of(u, y), PHYSICS)
    assert cost == pytest.approx(general.cost, rel=1e-10)
    assert np.abs(theta).max() < 1e3


def test_what_no_point_meets_is_not_found():
    u, y = cycle_problem(6)
    impossible = PHYSICS + parse_inequalities(["theta_2 <= -1"])
    assert compiled(gram_of(u, y), impossible)[0] == NOT_FOUND or not (
        compiled(gram_of(u, y), impossible)[4] <= 1e-6
    )
    assert solve_qp(gram_of(u, y), impossible).reason == "the constraints contradict each other"


def test_an_unexcited_parameter_that_an_inequality_drives_away_takes_the_general_path():
    u, y = cycle_problem(7)
    u[:, 4] = 0.0
    limits = PHYSICS + parse_inequalities(["theta_5 >= 0.125"])
    solution = solve_qp(gram_of(u, y), limits)
    assert solution.solved
    assert solution.theta[4] == 0.125


def test_the_same_problem_gives_the_same_bits():
    gram = gram_of(*cycle_problem(8))
    one, two = solve_qp(gram, PHYSICS), solve_qp(gram, PHYSICS)
    assert one.theta.tobytes() == two.theta.tobytes()
    assert (one.cost, one.kkt) == (two.cost, two.kkt)
