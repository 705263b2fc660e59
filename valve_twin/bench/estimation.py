# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The constrained solve of a cycle against cvxpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from valve_twin.bench.measure import Ratio, Scale, median
from valve_twin.core.estimation.constraints import physical_inequalities
from valve_twin.core.estimation.masks import find_masks
from valve_twin.core.estimation.qp import solve_qp, solve_qp_cvxpy
from valve_twin.core.estimation.regression import design, gram, usable_rows
from valve_twin.core.simulation import simulate_cycles, to_frames
from valve_twin.core.valves.registry import get_simulation

if TYPE_CHECKING:
    from collections.abc import Iterator


def compare(scale: Scale) -> Iterator[Ratio]:
    """Yield the comparisons of this area."""
    yield _constrained_solve(scale.repeats)


def _constrained_solve(repeats: int) -> Ratio:
    """Paper 002, (22) with all eight terms: our exact solver against cvxpy, rebuilt each cycle."""
    config = get_simulation("press_cartridge")
    (block,) = simulate_cycles(config, 1, seed=1)
    frames = to_frames(block)
    masks = find_masks(frames, config.period_s, push=(1.0, -1.0))
    rows = usable_rows(frames, masks, 2)
    inequalities = physical_inequalities(v_in_max=0.8, v_out_max=0.8)
    u, y = design(frames, rows, 2)
    equations = gram(frames, rows, 2)
    ours, peer = solve_qp(equations, inequalities), solve_qp_cvxpy(u, y, inequalities)
    _same_cost(ours.cost, peer.cost)
    return Ratio(
        "constrained solve of one cycle",
        "cvxpy",
        median(lambda: solve_qp(equations, inequalities), 10 * repeats),
        median(lambda: solve_qp_cvxpy(u, y, inequalities), repeats),
        20.0,
    )


def _same_cost(ours: float, peer: float) -> None:
    if not ours <= peer * (1.0 + 1e-6):
        msg = f"the costs differ: ours {ours!r}, cvxpy {peer!r}"
        raise AssertionError(msg)
