# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Command to position lag, found by scanning the fit of the paper's four-term QP (QP4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.constraints import Inequalities, physical_inequalities
from valve_twin.core.estimation.qp import solve_qp
from valve_twin.core.estimation.regression import (
    TERM_SETS,
    TERMS,
    common_rows,
    gram,
    mean_square_error,
)

if TYPE_CHECKING:
    from valve_twin.core.estimation.masks import Masks
    from valve_twin.core.types import FloatArray, Frames

MAX_LAG = 4
"""Default end of the scan [samples]; the lag is the sensor delay + 1 (equations.md 2.4)."""

MIN_ROWS = 12
"""Fewest rows on which lags are compared: three a parameter [1]."""


@dataclass(frozen=True, slots=True)
class LagScan:
    """Outcome of a lag scan.

    Attributes
    ----------
    lag : int
        The lag with the least mean squared error [samples]; -1 where the cycle cannot tell.
    mse : (L,) array
        Mean squared one-step error of QP4 at lags 0, 1, ... on the same rows [1]; NaN where not
        computed.
    sharpness : float
        Least relative rise of the error at any other lag [1]; NaN where there is no lag.
    reason : str
        Why there is no lag; empty where there is one.
    """

    lag: int
    mse: FloatArray
    sharpness: float
    reason: str = ""


def scan_lag(
    frames: Frames,
    masks: Masks,
    *,
    max_lag: int = MAX_LAG,
    keep_stale: bool = True,
    inequalities: Inequalities | None = None,
) -> LagScan:
    """Find the lag between command and position (equations.md 2.4, lag trap).

    Every lag is fitted on the same rows, so that the errors compare. The smallest of equal lags
    wins.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle, inputs (inflow, outflow).
    masks : Masks
        Its masks.
    max_lag : int
        Longest lag tried [samples].
    keep_stale : bool
        Use repeated values, as the paper does.
    inequalities : Inequalities, optional
        Constraints on theta; paper 002, eq. (23) where omitted.
    """
    mse = np.full(max_lag + 1, np.nan)
    rows = common_rows(frames, masks, max_lag, keep_stale=keep_stale)
    if len(rows) < MIN_ROWS:
        return LagScan(-1, mse, float("nan"), f"{len(rows)} usable rows, {MIN_ROWS} needed")
    commands = frames.inputs[int(rows[0]) - max_lag : int(rows[-1]) + 1]
    if not (commands != commands[0]).any():
        return LagScan(-1, mse, float("nan"), "the commands do not change")
    columns = [term - 1 for term in TERM_SETS["4"]]
    limits = (inequalities or physical_inequalities(extended=False)).part(columns)
    for lag in range(max_lag + 1):
        solution = solve_qp(gram(frames, rows, lag).part(TERM_SETS["4"]), limits)
        if solution.solved:
            theta = np.zeros(TERMS)
            theta[columns] = solution.theta
            mse[lag] = mean_square_error(frames, rows, lag, theta)
    if not np.isfinite(mse).all() or mse.max() <= 0.0:
        return LagScan(-1, mse, float("nan"), "no lag could be fitted")
    best = int(np.argmin(mse))
    others = np.delete(mse, best)
    sharpness = (
        float(others.min() / mse[best] - 1.0) if mse[best] > 0.0 and len(others) else np.inf
    )
    return LagScan(best, mse, sharpness)
