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
from valve_twin.core.valves.press_cartridge.estimation.output_error import fit_output_error
from valve_twin.core.valves.press_cartridge.estimation.qp import solve_qp
from valve_twin.core.valves.press_cartridge.estimation.regression import design, gram, usable_rows
from valve_twin.core.valves.registry import get_simulation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.press_cartridge.estimation.constraints import Inequalities
    from valve_twin.core.valves.press_cartridge.estimation.gains import GainFit

CYCLE_SAMPLES = 850
"""Samples of a production cycle of the reference experiment."""

_SEAT = 0.01  # positions nearer to an end rest on a seat [1]
ALIKE = 0.2
"""Relative difference of gains that count as equal: the peer's do not fall with the command."""

KKT_GOAL = 1e-12
"""Largest violation of the optimality conditions: an objective gap below 1e-12 [1]."""


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _constrained_solve(scale.repeats)
    yield from _whitened(scale.repeats)
    yield _free_run(scale.repeats)


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

    for name, pole, goal in (("given pole", 0.0, 1 / 5), ("pole search", -1.0, 2.0)):
        yield Ratio(
            f"Kalman-whitened estimate of one cycle, {name}",
            "cvxpy rebuilt, one solve",
            median(lambda: ours(pole), 4 * repeats),  # noqa: B023  called before the next pole
            peer,
            goal,
        )


def _free_run(repeats: int) -> Ratio:
    """Fit the free run of a cycle, delay and pole searched, against scipy's least squares.

    The peer is what a user would write: the model as a linear filter, and one trust-region search
    over delay, pole, gains and leak; it begins at our answer and fits no sag of the gains.
    """
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)

    def ours() -> GainFit:
        masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
        sigma = rest_noise(frames, masks, active_command=0.01).sigma
        options = OutputErrorOptions(lag=2)
        return fit_output_error(frames, masks, config.period_s, noise_sigma=sigma, options=options)

    fit = ours()
    assert fit.status is not EstimateStatus.REFUSED
    values = {p.name: p.value for p in fit.parameters}
    start = [values[name] for name in ("delay", "pole", "K_in", "K_out", "leak")]
    found = fit_in_scipy(frames.position, frames.inputs, config.period_s, np.array(start))
    for k, name in ((2, "K_in"), (3, "K_out")):
        if not abs(found[k] / values[name] - 1.0) <= ALIKE:
            msg = f"{name} of scipy differs: {found[k]!r}, ours {values[name]!r}"
            raise AssertionError(msg)
    return Ratio(
        "output error of one cycle, delay and pole searched",
        "scipy least_squares of the same free run",
        median(ours, 10 * repeats),
        median(
            lambda: fit_in_scipy(frames.position, frames.inputs, config.period_s, np.array(start)),
            2 * repeats,
        ),
        6.0,
    )


def fit_in_scipy(
    position: FloatArray, inputs: FloatArray, period_s: float, start: FloatArray
) -> FloatArray:
    """Return delay, pole, K_in, K_out and leak whose free run lies nearest to a cycle: (5,).

    Parameters
    ----------
    position : (N,) array
        Measured position [1].
    inputs : (N, 2) array
        Inflow and outflow [1].
    period_s : float
        Sampling time [s].
    start : (5,) array
        Where the search begins [samples, 1, 1/sample, 1/sample, 1/s].
    """
    from scipy.optimize import least_squares
    from scipy.signal import lfilter

    index = np.arange(len(position), dtype=float)
    free = (position > _SEAT) & (position < 1.0 - _SEAT)

    def residual(x: FloatArray) -> FloatArray:
        acting = [np.interp(index - x[0], index, u) for u in inputs.T]
        drive = x[2] * acting[0] - x[3] * acting[1] - x[4] * period_s
        speed = np.where(free, lfilter([1.0 - x[1]], [1.0, -x[1]], np.where(free, drive, 0.0)), 0)
        level = np.cumsum(speed)
        off = (position - level)[free]
        return np.asarray(off - off.mean())

    bounds = ([0.0, 0.0, 0.0, 0.0, 0.0], [4.0, 0.98, 1.0, 1.0, 1.0])
    return np.asarray(least_squares(residual, start, bounds=bounds, x_scale=start + 1e-3).x)


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
