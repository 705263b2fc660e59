# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Bounded Levenberg-Marquardt against scipy's trust region, and the scaling it stands on."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from valve_twin.core.estimation.solvers.least_squares import (
    column_condition,
    damped_step,
    gram_condition,
    minimise,
    minimise_residuals,
)
from valve_twin.core.estimation.solvers.least_squares import sensitivities as differences
from valve_twin.core.simulation import configure, simulate_cycles, to_frames
from valve_twin.core.types import Cycle
from valve_twin.core.valves.positioner.fit import bounds, fit_free_run
from valve_twin.core.valves.positioner.kernels import normal_equations
from valve_twin.core.valves.positioner.record import prepare
from valve_twin.core.valves.registry import complete_options, get_model, get_simulation

T = np.linspace(0.0, 3.0, 60)
MEASURED = 2.0 * np.exp(-1.3 * T) + 0.4 + 0.01 * np.sin(37.0 * T)
FREE = np.full(3, -np.inf), np.full(3, np.inf)


def model(p):
    return p[0] * np.exp(-p[1] * T) + p[2]


def miss(p):
    return model(p) - MEASURED


def sensitivities(p):
    decay = np.exp(-p[1] * T)
    return np.column_stack([decay, -p[0] * T * decay, np.ones_like(T)])


def normal(p):
    r, j = MEASURED - model(p), sensitivities(p)
    return float(r @ r), j.T @ r, j.T @ j


def test_differences_find_the_minimum_of_known_derivatives_and_stay_inside_bounds():
    limits, steps = (np.array([-10.0, 0.0, 0.0]), np.array([1.5, 1.1, 0.6])), np.full(3, 1e-6)
    seen = []

    def watched(p):
        seen.append(p.copy())
        return miss(p)

    start = np.array([1.0, 0.5, 0.5])
    found = minimise_residuals(watched, start, limits, steps=steps, iterations=60)
    known = minimise(normal, start, limits, iterations=60)
    assert found.parameters == pytest.approx(known.parameters, rel=1e-6)
    assert found.cost == pytest.approx(known.cost, rel=1e-9)
    assert all((limits[0] <= p).all() and (p <= limits[1]).all() for p in seen)
    off, j = differences(miss, found.parameters, limits, steps)
    assert off == pytest.approx(miss(found.parameters))
    assert j == pytest.approx(sensitivities(found.parameters), rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        ([-10.0, 0.0, -10.0], [10.0, 10.0, 10.0]),
        ([-10.0, 0.0, 0.45], [10.0, 10.0, 10.0]),
        ([-10.0, 0.0, 0.0], [1.5, 1.1, 0.6]),
    ],
)
def test_finds_the_minimum_of_a_trust_region_inside_bounds(lower, upper):
    limits = np.array(lower), np.array(upper)
    found = minimise(normal, np.array([1.0, 0.5, 0.5]), limits, iterations=60)
    other = least_squares(
        miss,
        np.clip([1.0, 0.5, 0.5], limits[0] + 1e-6, limits[1] - 1e-6),
        sensitivities,
        bounds=limits,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert found.cost <= 2.0 * other.cost * (1.0 + 1e-9)
    assert (limits[0] <= found.parameters).all()
    assert (found.parameters <= limits[1]).all()
    np.testing.assert_allclose(found.parameters, other.x, rtol=1e-5)


def test_a_parameter_without_effect_keeps_its_start():
    def blind(p):
        cost, gradient, gram = normal(p[:3])
        wide = np.zeros((4, 4))
        wide[:3, :3] = gram
        return cost, np.append(gradient, 0.0), wide

    limits = np.append(FREE[0], -1.0), np.append(FREE[1], 1.0)
    found = minimise(blind, np.array([1.0, 0.5, 0.5, 0.25]), limits, iterations=60)
    assert found.parameters[3] == 0.25
    np.testing.assert_allclose(found.parameters[:2], [2.0, 1.3], rtol=0.02)


def test_a_start_outside_the_bounds_is_clipped():
    limits = np.array([0.0, 0.0, 0.0]), np.array([3.0, 3.0, 3.0])
    found = minimise(normal, np.array([9.0, -1.0, 0.5]), limits, iterations=1)
    assert (found.parameters >= limits[0]).all()
    assert (found.parameters <= limits[1]).all()


def test_the_positioner_ends_where_a_trust_region_ends():
    """The costs agree to 1e-9, the parameters to 1e-3 of their standard errors."""
    config = configure(get_simulation("positioner"), {})
    block = next(iter(simulate_cycles(config, 1, 3)))
    cycle = Cycle(1, config.period_s, to_frames(block))
    record = prepare(cycle, complete_options(get_model("positioner"), {})).record
    limits = bounds(config.period_s, min_slew=0.0, max_dead_band=0.05)
    found = fit_free_run(record, max_lag=5, limits=limits)
    assert found.lag > 0

    def length(p):
        gradient, active, gram = np.empty(5), np.empty(5), np.empty((5, 5))
        cost = normal_equations(
            p, record.position, record.command, record.used, record.period_s, found.lag,
            record.stops, gradient, gram, active,
        )  # fmt: skip
        return np.sqrt(cost)

    at = found.parameters
    errors = np.sqrt(np.diag(np.linalg.inv(found.hessian)) * found.cost / record.used.sum())
    for j in range(len(at)):
        for sign in (-1.0, 1.0):
            aside = at.copy()
            aside[j] += sign * 1e-3 * errors[j]
            inside = (limits[0] <= aside).all() and (aside <= limits[1]).all()
            assert not inside or length(aside) ** 2 >= found.cost * (1.0 - 1e-9)


def test_damping_shortens_the_step_and_turns_it_to_the_gradient():
    _, gradient, gram = normal(np.array([1.0, 0.5, 0.5]))
    newton = damped_step(gram, gradient, 0.0)
    np.testing.assert_allclose(gram @ newton, gradient, rtol=1e-9)
    assert np.linalg.norm(damped_step(gram, gradient, 10.0)) < np.linalg.norm(newton)


def test_condition_numbers_do_not_see_units():
    j = sensitivities(np.array([2.0, 1.3, 0.4]))
    scaled = j * [1e6, 1e-6, 1.0]
    assert column_condition(scaled) == pytest.approx(column_condition(j), rel=1e-9)
    assert gram_condition(scaled.T @ scaled) == pytest.approx(column_condition(j), rel=1e-6)


def test_condition_numbers_tell_what_has_no_effect():
    j = np.column_stack([T, np.zeros_like(T)])
    assert column_condition(j) == np.inf
    assert gram_condition(j.T @ j) == 1.0
    assert np.isnan(gram_condition(np.zeros((2, 2))))
