# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What position a healthy valve has, learnt from a healthy record: a polynomial of the past.

Two of them: a free one of command and pressures alone, which shows steady deviations, and one
step ahead, of the last measured position as well, which shows how the valve moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

CV, P1, P2, T1, X, F = range(6)
"""Columns of the official signals."""

_LAGS_1, _LAGS_2 = 4, 3  # samples of each pressure, those of now included, assumed
_INSIDE = 5e-4  # quantile of the healthy inputs at which they are clipped, assumed [1]
_MARGIN = 0.05  # of their range beyond it, assumed [1]
_RIDGE = 1e-7  # of the normal equations, relative to their diagonal, assumed
_ROWS = 8192  # features held at once


@dataclass(frozen=True, slots=True)
class MotionModel:
    """Position as a cubic polynomial of clipped and scaled inputs.

    Attributes
    ----------
    steps : int
        How many past positions are inputs: 0 = free, 1 = one step ahead.
    lower, upper : (n,) arrays
        Range of each input in the healthy record; they are clipped to it [1].
    weights : (m,) array
        Of the monomials [1].
    """

    steps: int
    lower: FloatArray
    upper: FloatArray
    weights: FloatArray

    def residual(self, signals: FloatArray) -> FloatArray:
        """Return measured less expected position (N,) [1] of signals (N, 6) [1]."""
        inputs = _scaled(_inputs(signals, self.steps), self.lower, self.upper)
        expected = np.empty(len(signals))
        _evaluate(inputs, self.weights, expected)
        out: FloatArray = signals[:, X] - expected
        return out


def learn_motion(signals: FloatArray, steps: int, settled: int) -> MotionModel:
    """Learn the position of a healthy valve by least squares.

    Parameters
    ----------
    signals : (N, 6) array
        Official signals of a healthy record [1].
    steps : int
        How many past positions are inputs.
    settled : int
        Samples at its start that are left out.
    """
    inputs = _inputs(signals, steps)[settled:]
    lower, upper = np.quantile(inputs, (_INSIDE, 1.0 - _INSIDE), axis=0)
    margin = _MARGIN * (upper - lower) + 1e-9
    lower, upper = lower - margin, upper + margin
    z = _scaled(inputs, lower, upper)
    m = monomials(z.shape[1])
    gram, moment = np.zeros((m, m)), np.zeros(m)
    for first in range(0, len(z), _ROWS):
        part = z[first : first + _ROWS]
        a = np.empty((len(part), m))
        _expand(part, a)
        gram += a.T @ a
        moment += a.T @ signals[settled + first : settled + first + len(part), X]
    gram[np.diag_indices(m)] *= 1.0 + _RIDGE
    weights = np.asarray(np.linalg.solve(gram, moment), dtype=np.float64)
    return MotionModel(steps, lower, upper, weights)


def monomials(n: int) -> int:
    """Return how many monomials up to the third degree n inputs have."""
    return (n + 1) * (n + 2) * (n + 3) // 6


def lagged(x: FloatArray, samples: int) -> FloatArray:
    """Return a signal (N,) of some samples ago; before its start, its first value."""
    return np.concatenate([np.full(samples, x[0]), x[: len(x) - samples]])


def _inputs(signals: FloatArray, steps: int) -> FloatArray:
    command = signals[:, CV]
    columns = [command, command - lagged(command, 1)]
    columns += [lagged(signals[:, P1], k) for k in range(_LAGS_1)]
    columns += [lagged(signals[:, P2], k) for k in range(_LAGS_2)]
    columns += [lagged(signals[:, X] - command, k) for k in range(1, steps + 1)]
    return np.column_stack(columns)


def _scaled(inputs: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    clipped = np.clip(inputs, lower, upper)
    out: FloatArray = 2.0 * (clipped - lower) / (upper - lower) - 1.0
    return np.ascontiguousarray(out)


@njit(cache=True)
def _expand(z: FloatArray, out: FloatArray) -> None:
    """Write the monomials up to the third degree of (N, n) inputs into (N, m)."""
    n = z.shape[1]
    for row in range(len(z)):
        k = 1
        out[row, 0] = 1.0
        for a in range(n):
            out[row, k] = z[row, a]
            k += 1
            for b in range(a, n):
                square = z[row, a] * z[row, b]
                out[row, k] = square
                k += 1
                for c in range(b, n):
                    out[row, k] = square * z[row, c]
                    k += 1


@njit(cache=True)
def _evaluate(z: FloatArray, weights: FloatArray, out: FloatArray) -> None:
    """Write the polynomial of (N, n) inputs into (N,); monomials as in `_expand`."""
    n = z.shape[1]
    for row in range(len(z)):
        k = 1
        total = weights[0]
        for a in range(n):
            total += weights[k] * z[row, a]
            k += 1
            for b in range(a, n):
                square = z[row, a] * z[row, b]
                total += weights[k] * square
                k += 1
                for c in range(b, n):
                    total += weights[k] * square * z[row, c]
                    k += 1
        out[row] = total
