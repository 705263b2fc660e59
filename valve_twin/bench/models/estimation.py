# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The constrained solve of a cycle against cvxpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.bench.measure import Ratio, Scale, median
from valve_twin.core.estimation.data.masks import find_masks
from valve_twin.core.estimation.data.noise import rest_noise
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.types import EstimateStatus
from valve_twin.core.valves.press_cartridge.estimation.constraints import physical_inequalities
from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions
from valve_twin.core.valves.press_cartridge.estimation.kalman import fit_kalman
from valve_twin.core.valves.press_cartridge.estimation.qp import solve_qp
from valve_twin.core.valves.press_cartridge.estimation.regression import design, gram, usable_rows
from valve_twin.core.valves.registry import get_simulation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.constraints import Inequalities

CYCLE_SAMPLES = 850
"""Samples of a production cycle of the reference experiment."""

KKT_GOAL = 1e-12
"""Largest violation of the optimality conditions: an objective gap below 1e-12 [1]."""


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _constrained_solve(scale.repeats)
    yield from _whitened(scale.repeats)


def _constrained_solve(repeats: int) -> Ratio:
    """Paper 002, (22) with all eight terms: normal equations and exact solve against cvxpy.

    Both begin with the samples of a cycle. The product of the commands is never excited, as in
    any production cycle: the normal equations are singular.
    """
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)
    masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
    rows = usable_rows(frames, masks, 2)
    inequalities = physical_inequalities(v_in_max=0.8, v_out_max=0.8)
    ours = solve_qp(gram(frames, rows, 2), inequalities)
    assert gram(frames, rows, 2).matrix[5, 5] == 0.0
    assert ours.solved
    assert ours.kkt <= KKT_GOAL
    u, y = design(frames, rows, 2)
    peer_theta = solve_in_cvxpy(u, y, inequalities)
    _same_cost(float(np.sum((y - u @ ours.theta) ** 2)), float(np.sum((y - u @ peer_theta) ** 2)))
    return Ratio(
        "exact constrained solve of one cycle",
        "cvxpy rebuilt",
        median(lambda: solve_qp(gram(frames, rows, 2), inequalities), 40 * repeats),
        median(lambda: solve_in_cvxpy(*design(frames, rows, 2), inequalities), 2 * repeats),
        200.0,
    )


def _whitened(repeats: int) -> Iterator[Ratio]:
    """One Kalman-whitened estimate from the samples of a cycle against one solve by cvxpy.

    It searches the noise ratio, and with the pole or for a given one; cvxpy is given both.
    """
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)
    assert len(frames) == CYCLE_SAMPLES
    masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
    rows = usable_rows(frames, masks, 2)
    inequalities = physical_inequalities(v_in_max=0.8, v_out_max=0.8)
    peer = median(lambda: solve_in_cvxpy(*design(frames, rows, 2), inequalities), 2 * repeats)

    def ours(pole: float) -> None:
        masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
        sigma = rest_noise(frames, masks, active_command=0.01).sigma
        options = OutputErrorOptions(lag=2, pole=pole)
        fit = fit_kalman(frames, masks, config.period_s, noise_sigma=sigma, options=options)
        assert fit.status is not EstimateStatus.REFUSED

    for name, pole, goal in (("given pole", 0.0, 1 / 5), ("pole search", -1.0, 1 / 15)):
        yield Ratio(
            f"Kalman-whitened estimate of one cycle, {name}",
            "cvxpy rebuilt, one solve",
            median(lambda: ours(pole), 4 * repeats),  # noqa: B023  called before the next pole
            peer,
            goal,
        )


def solve_in_cvxpy(u: FloatArray, y: FloatArray, limits: Inequalities) -> FloatArray:
    """State the constrained least squares in cvxpy as its documentation does and solve it.

    Its usual tolerances, absolute beside costs of 1e-4, leave 1e-5 of the cost.

    Parameters
    ----------
    u : (R, K) array
        Regressor [1].
    y : (R,) array
        Right-hand side [1].
    limits : Inequalities
        Linear inequalities over the K parameters.
    """
    import cvxpy

    theta = cvxpy.Variable(u.shape[1])
    cost = cvxpy.Minimize(cvxpy.sum_squares(u @ theta - y))  # type: ignore[attr-defined]
    problem = cvxpy.Problem(cost, [cvxpy.Constant(limits.matrix) @ theta <= limits.bound])
    problem.solve(  # type: ignore[no-untyped-call]
        solver=cvxpy.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-9
    )
    return np.asarray(theta.value, float)


def _same_cost(ours: float, peer: float) -> None:
    if not ours <= peer * (1.0 + 1e-6):
        msg = f"the costs differ: ours {ours!r}, cvxpy {peer!r}"
        raise AssertionError(msg)
