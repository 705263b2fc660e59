# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled rounds of a search: eight noise ratios, each with the pole of greatest likelihood."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.solvers.small_dense import eliminate
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    list_subset,
    solve_positive,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.lanes import LANES
from valve_twin.core.valves.press_cartridge.estimation.whitened.lanes import (
    AT,
    BY_POLE,
    BY_POLE_TOTAL,
    GRAM,
    LOG_TOTAL,
    POLE,
    RATIO,
    SIZE,
    SQUARES,
    SQUARES_TOTAL,
    whiten_lanes,
)
from valve_twin.core.valves.press_cartridge.estimation.whitened.moments import restricted_value
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import Rows

_NEWTON = 10  # passes until the poles of a round are given up
_LARGEST_STEP = 0.15  # of a pole at once [1]
_MOST = 256  # ratios that are remembered


class Problem(NamedTuple):
    """What is searched.

    Attributes
    ----------
    rows : Rows
        The cycle.
    v_max : float
        Greatest command [1].
    columns : (5,) bool array
        Parameters that are fitted.
    low, high : float
        Limits of the pole; equal = it is given [1].
    """

    rows: Rows
    v_max: float
    columns: BoolArray
    low: float
    high: float


class Lanes(NamedTuple):
    """Eight ratios and what was found there, (8,) each where not said.

    Attributes
    ----------
    work : (SIZE,) array
        Of `whiten_lanes`.
    log_ratio, pole : arrays
        Of the noise ratio its logarithm, and the pole [1].
    likelihood, slope, bend : arrays
        Minus twice the log likelihood, its first and second derivative by the pole [1].
    value, cost : arrays
        Minus twice the log restricted likelihood, and the cost [1].
    p : (8, 5) array
        Parameters [1].
    gram : (8, 7, 7) array
        Normal equations [1].
    kept : int64 array
        Which parameters are positive, a bit each.
    """

    work: FloatArray
    log_ratio: FloatArray
    pole: FloatArray
    likelihood: FloatArray
    slope: FloatArray
    bend: FloatArray
    value: FloatArray
    cost: FloatArray
    p: FloatArray
    gram: FloatArray
    kept: IntArray


class Known(NamedTuple):
    """Ratios that were looked at: logarithm (M,), pole (M,), parameters (M, 5), how many (1,)."""

    log_ratio: FloatArray
    pole: FloatArray
    p: FloatArray
    number: IntArray


@njit(cache=True)
def new_lanes() -> Lanes:
    """Return lanes that hold nothing yet."""
    return Lanes(
        np.zeros(SIZE),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros(LANES),
        np.zeros((LANES, N_LINEAR)),
        np.zeros((LANES, N_COLUMNS, N_COLUMNS)),
        np.zeros(LANES, dtype=np.int64),
    )


@njit(cache=True)
def new_known() -> Known:
    """Return that nothing is known yet."""
    return Known(
        np.zeros(_MOST), np.zeros(_MOST), np.zeros((_MOST, N_LINEAR)), np.zeros(1, dtype=np.int64)
    )


@njit(cache=True, error_model="numpy")
def _bend(lanes: Lanes, i: int, rows: int, total: float) -> float:
    """Return the expected second derivative of a lane's likelihood by the pole.

    Parameters are fitted anew at each pole: what they take of the derivative of the residual is
    taken out. The columns' share in it is that of the sensitivity, with the sign turned.
    """
    gram, work = lanes.gram[i], lanes.work
    factor, x = np.zeros((N_LINEAR, N_LINEAR)), np.zeros(N_LINEAR)
    chosen = np.zeros(N_LINEAR + 1, dtype=np.int64)
    m = list_subset(lanes.kept[i], chosen)
    left = eliminate(gram, chosen[:m], N_LINEAR, work[SQUARES + i], 0.0, factor, x)
    if not left < np.inf:
        return np.nan
    own = 2.0 * rows / lanes.cost[i] * max(left, 0.0)
    return float(own + work[SQUARES_TOTAL + i] - total * total / rows)


@njit(cache=True, error_model="numpy")
def look(problem: Problem, lanes: Lanes) -> int:
    """Evaluate eight ratios at their poles; return the rows.

    The sensitivity to the pole is that of the parameters which the lanes held before.

    Parameters
    ----------
    problem : Problem
        What is searched.
    lanes : Lanes
        Ratios and poles; the rest is overwritten.
    """
    work, rows = lanes.work, problem.rows
    for i in range(LANES):
        work[POLE + i] = lanes.pole[i]
        work[RATIO + i] = np.exp(lanes.log_ratio[i])
        for k in range(N_LINEAR):
            work[AT + LANES * k + i] = lanes.p[i, k]
    count = whiten_lanes(
        rows.y, rows.flags, rows.anchor, rows.v_in, rows.v_out, problem.v_max, work
    )
    for i in range(LANES):
        _judge(problem, lanes, i, count)
    return count


@njit(cache=True, error_model="numpy")
def _judge(problem: Problem, lanes: Lanes, i: int, rows: int) -> None:
    """Solve one lane and write what it shows."""
    work, gram, p = lanes.work, lanes.gram[i], lanes.p[i]
    at = 0
    for j in range(N_COLUMNS):
        for k in range(j + 1):
            gram[j, k] = gram[k, j] = work[GRAM + LANES * at + i]
            at += 1
    before = p.copy()
    cost = solve_positive(gram, problem.columns, p)
    least = max(cost, 1e-300)
    lanes.cost[i] = cost
    kept, moved, were = 0, 0.0, gram[-1, -1]
    for k in range(N_LINEAR):
        kept |= (1 << k) * (p[k] > 0.0)
        moved += (p[k] - before[k]) * gram[N_LINEAR, k]
        were -= 2.0 * before[k] * gram[k, -1]
        for j in range(N_LINEAR):
            were += before[k] * before[j] * gram[k, j]
    lanes.kept[i] = kept
    total = work[LOG_TOTAL + i]
    by_total = work[BY_POLE_TOTAL + i]
    lanes.likelihood[i] = rows * np.log(least / max(rows, 1)) + total
    lanes.slope[i] = rows / least * (work[BY_POLE + i] + 2.0 * moved) + by_total
    lanes.bend[i] = _bend(lanes, i, rows, by_total)
    searched = problem.high > problem.low
    lanes.value[i] = restricted_value(gram, p, rows, total, cost, searched)


@njit(cache=True)
def begin(known: Known, lanes: Lanes) -> None:
    """Give each lane pole and parameters from the known ratios on either side of its own.

    Parameters
    ----------
    known : Known
        What was found before.
    lanes : Lanes
        Poles and parameters are overwritten.
    """
    for i in range(LANES):
        at = lanes.log_ratio[i]
        below, above = -1, -1
        for m in range(known.number[0]):
            place = known.log_ratio[m]
            if place <= at and (below < 0 or place > known.log_ratio[below]):
                below = m
            if place >= at and (above < 0 or place < known.log_ratio[above]):
                above = m
        below, above = (above if below < 0 else below), (below if above < 0 else above)
        width = known.log_ratio[above] - known.log_ratio[below]
        share = (at - known.log_ratio[below]) / width if width > 0.0 else 0.0
        lanes.pole[i] = (1.0 - share) * known.pole[below] + share * known.pole[above]
        for k in range(N_LINEAR):
            lanes.p[i, k] = (1.0 - share) * known.p[below, k] + share * known.p[above, k]


@njit(cache=True)
def remember(known: Known, lanes: Lanes) -> None:
    """Add eight ratios to the known ones.

    Parameters
    ----------
    known : Known
        Added to, as far as there is room.
    lanes : Lanes
        What was found.
    """
    for i in range(LANES):
        m = known.number[0]
        if m < _MOST:
            known.log_ratio[m], known.pole[m] = lanes.log_ratio[i], lanes.pole[i]
            known.p[m, :] = lanes.p[i]
            known.number[0] = m + 1


@njit(cache=True, error_model="numpy")
def settle(problem: Problem, lanes: Lanes, width: float) -> int:
    """Move each lane's pole to the greatest likelihood; return the rows, negative = not settled.

    The curvature is the expected one first, then that between two passes.

    Parameters
    ----------
    problem : Problem
        What is searched.
    lanes : Lanes
        Ratios, and poles to begin at; the rest is overwritten.
    width : float
        Largest step of a pole that ends it [1].
    """
    low, high = problem.low, problem.high
    if not high > low:
        return look(problem, lanes)
    last, slope = lanes.pole.copy(), np.zeros(LANES)
    for number in range(_NEWTON):
        rows = look(problem, lanes)
        largest = 0.0
        for i in range(LANES):
            at, bend = lanes.pole[i], lanes.bend[i]
            if number > 0 and at != last[i]:
                seen = (lanes.slope[i] - slope[i]) / (at - last[i])
                if 0.2 * bend < seen < 5.0 * bend:
                    bend = seen
            step = -lanes.slope[i] / bend
            if not bend > 0.0:
                step = -_LARGEST_STEP * np.sign(lanes.slope[i])
            if not abs(step) < np.inf:
                return -1
            step = min(max(step, -_LARGEST_STEP), _LARGEST_STEP)
            to = min(max(at + step, low), high)
            if (
                number > 0
                and (to - at) * (at - last[i]) < 0.0
                and abs(to - at) > abs(at - last[i])
            ):
                to = 0.5 * (at + last[i])  # it swings
            last[i], slope[i] = at, lanes.slope[i]
            largest = max(largest, abs(to - at))
            lanes.pole[i] = to
        if number > 0 and largest <= width:
            for i in range(LANES):
                lanes.pole[i] = last[i]
            return rows
    return -1
