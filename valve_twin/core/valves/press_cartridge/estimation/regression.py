# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The linear regression of paper 002, eq. (17)-(19), at any lag between command and position.

y[n] = x[n] - 2 x[n-1] + x[n-2] = theta . u[n],
u[n] = [dx, vi, vo, vi^2, vo^2, vi vo, vi dx, vo dx], dx = x[n-1] - x[n-2], commands at n - lag
(the paper: lag 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.kernels import mark_rows
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.estimation.data.masks import Masks
    from valve_twin.core.types import FloatArray, Frames, IntArray

TERMS = 8
"""Number of terms of paper 002, eq. (19)."""


@dataclass(frozen=True, slots=True)
class Gram:
    """Normal equations of all eight terms over the rows used.

    Attributes
    ----------
    matrix : (8, 8) array
        Sum of u u^T.
    vector : (8,) array
        Sum of u y.
    power : float
        Sum of y^2 [1].
    rows : int
        Number of rows.
    """

    matrix: FloatArray
    vector: FloatArray
    power: float
    rows: int

    def part(self, terms: tuple[int, ...]) -> Gram:
        """Return the normal equations of some terms, numbered from 1 as in the paper."""
        k = np.asarray(terms, np.int64) - 1
        return Gram(self.matrix[k[:, None], k], self.vector[k], self.power, self.rows)


def usable_rows(frames: Frames, masks: Masks, lag: int, *, keep_stale: bool = False) -> IntArray:
    """Return the samples n whose row is measured, in one piece and off the masks: (R,) int64.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle; only the first two inputs are used.
    masks : Masks
        Its masks.
    lag : int
        Command to position lag [samples]; the rows can be used at each shorter one, too.
    keep_stale : bool
        Use the repeated values of a slow sensor as if they were measured, as the paper does:
        without them a sensor refreshed every second sample or slower leaves no row at all. A
        single freeze is always left out.
    """
    rows = np.empty(len(masks.bad), np.int64)
    count = mark_rows(
        masks.seat,
        masks.stuck,
        masks.stale,
        masks.bad,
        masks.gap,
        keep_stale and masks.refresh_period > 1.0,
        max(2, lag),
        rows,
    )
    return rows[:count]


def design(frames: Frames, rows: IntArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """Return regressor (R, 8) and right-hand side (R,) of paper 002, eq. (17) and (19) [1].

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    rows : (R,) int array
        Samples n that are used.
    lag : int
        Command to position lag [samples].
    """
    x, n = frames.position, rows
    dx = x[n - 1] - x[n - 2]
    vi, vo = frames.inputs[n - lag, 0], frames.inputs[n - lag, 1]
    u = np.column_stack([dx, vi, vo, vi * vi, vo * vo, vi * vo, vi * dx, vo * dx])
    return u, x[n] - 2.0 * x[n - 1] + x[n - 2]


def gram(frames: Frames, rows: IntArray, lag: int) -> Gram:
    """Return the normal equations of all eight terms in one compiled pass.

    Parameters
    ----------
    frames : Frames
        Samples of one cycle.
    rows : (R,) int64 array
        Rows to use, each at least max(2, lag).
    lag : int
        Command to position lag [samples].
    """
    matrix, vector = np.zeros((TERMS, TERMS)), np.zeros(TERMS)
    x = np.ascontiguousarray(frames.position)
    power = gram_kernel(x, np.ascontiguousarray(frames.inputs), rows, lag, matrix, vector)
    return Gram(matrix, vector, float(power), len(rows))


def mean_square_error(frames: Frames, rows: IntArray, lag: int, theta: FloatArray) -> float:
    """Return the mean of (y - theta . u)^2 over the rows [1]; NaN without rows.

    Paper 002, eq. (24), formed sample by sample: the same from the normal equations would cancel
    on precise data.

    Parameters
    ----------
    frames, rows, lag : Frames, (R,) int array, int
        Same as `design` takes.
    theta : (8,) array
        Parameters [1].
    """
    if len(rows) == 0:
        return float("nan")
    x = np.ascontiguousarray(frames.position)
    inputs = np.ascontiguousarray(frames.inputs)
    return float(residual_kernel(x, inputs, rows, lag, theta)) / len(rows)


@njit(cache=True)
def gram_kernel(
    x: FloatArray,
    inputs: FloatArray,
    rows: IntArray,
    lag: int,
    matrix: FloatArray,
    vector: FloatArray,
) -> float:
    """Fill the normal equations of all eight terms; return the sum of y^2.

    Parameters
    ----------
    x : (N,) array
        Position [1].
    inputs : (N, 2) array
        Commands [1].
    rows : (R,) int64 array
        Rows to use, each at least max(2, lag).
    lag : int
        Command to position lag [samples].
    matrix, vector : (8, 8) array, (8,) array
        Zeros, to which the sums are added [1].
    """
    u, on = np.empty(8), np.empty(8, np.int64)
    power = 0.0
    for n in rows:
        dx = x[n - 1] - x[n - 2]
        vi = inputs[n - lag, 0]
        vo = inputs[n - lag, 1]
        u[0] = dx
        u[1] = vi
        u[2] = vo
        u[3] = vi * vi
        u[4] = vo * vo
        u[5] = vi * vo
        u[6] = vi * dx
        u[7] = vo * dx
        y = x[n] - 2.0 * x[n - 1] + x[n - 2]
        power += y * y
        # most rows have one command at zero or both: their zeros would add nothing
        count = 0
        for i in range(8):
            if u[i] != 0.0:
                on[count] = i
                count += 1
        for c in range(count):
            i = on[c]
            vector[i] += u[i] * y
            for d in range(c + 1):
                j = on[d]
                matrix[i, j] += u[i] * u[j]
    for i in range(8):
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return power


@njit(cache=True)
def residual_kernel(
    x: FloatArray, inputs: FloatArray, rows: IntArray, lag: int, theta: FloatArray
) -> float:
    """Return the sum of (y - theta . u)^2 [1].

    Parameters
    ----------
    x, inputs, rows, lag : (N,) array, (N, 2) array, (R,) int64 array, int
        Same as `gram_kernel` takes.
    theta : (8,) array
        Parameters [1].
    """
    power = 0.0
    for n in rows:
        dx = x[n - 1] - x[n - 2]
        vi = inputs[n - lag, 0]
        vo = inputs[n - lag, 1]
        speed = theta[0] + theta[6] * vi + theta[7] * vo
        flow_in = vi * (theta[1] + theta[3] * vi)
        flow_out = vo * (theta[2] + theta[4] * vo)
        r = x[n] - 2.0 * x[n - 1] + x[n - 2]
        r -= speed * dx + flow_in + flow_out + theta[5] * vi * vo
        power += r * r
    return power
