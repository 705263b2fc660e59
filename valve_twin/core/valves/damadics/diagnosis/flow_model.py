# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What flow a healthy valve passes at its measured position and pressures, learnt likewise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.damadics.diagnosis.motion_model import P1, P2, F, X

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

TOP = 0.97
"""Flow above which its sensor may be saturated, assumed [1]."""
_BEYOND = 0.01  # beyond the learnt positions in which the flow is still known, assumed [1]
_LEAST = 0.003  # flow and pressure drop below which no logarithm is taken, assumed [1]


@dataclass(frozen=True, slots=True)
class FlowResidual:
    """How a measured flow departs from the expected one.

    Attributes
    ----------
    ratio : (N,) array
        Logarithm of measured over expected flow, both cut at `TOP` [1].
    weight : (N,) array
        1 / variance of a healthy `ratio`, 0 where both flows are above `TOP` or the position
        is none of those learnt [1].
    expected : (N,) array
        Expected flow [1].
    below : (N,) bool array
        Whether both are below `TOP` and the position is known.
    """

    ratio: FloatArray
    weight: FloatArray
    expected: FloatArray
    below: BoolArray


@dataclass(frozen=True, slots=True)
class FlowModel:
    """Logarithm of the flow as a polynomial of position and of the logarithm of the drop.

    Attributes
    ----------
    lower, upper : float
        Range of positions in the healthy record that show the flow; clipped to it [1].
    drop : float
        Mean pressure drop there [1].
    weights : (7,) array
        Of the terms [1].
    spread : (2,) array
        Variance of the residual = spread[0] + spread[1] / expected flow^2.
    """

    lower: float
    upper: float
    drop: float
    weights: FloatArray
    spread: FloatArray

    def residual(self, signals: FloatArray) -> FlowResidual:
        """Return how the flow of signals (N, 6) [1] departs from the expected one."""
        expected = _terms(signals, self.lower, self.upper, self.drop) @ self.weights
        variance = self.spread[0] + self.spread[1] * np.exp(-2.0 * expected)
        measured = np.log(np.maximum(signals[:, F], _LEAST))
        top = np.log(TOP)
        known = signals[:, X] < self.upper + _BEYOND
        known &= (signals[:, X] > self.lower) | (measured < top)
        known &= (measured < top) | (expected < top)
        return FlowResidual(
            ratio=np.minimum(measured, top) - np.minimum(expected, top),
            weight=np.where(known, 1.0 / variance, 0.0),
            expected=np.exp(expected),
            below=known & (measured < top) & (expected < top),
        )


def learn_flow(signals: FloatArray, settled: int) -> FlowModel:
    """Learn the flow of a healthy valve by least squares.

    Parameters
    ----------
    signals : (N, 6) array
        Official signals of a healthy record [1].
    settled : int
        Samples at its start that are left out.

    Raises
    ------
    ValueError
        If the flow is nowhere below the top of its span.
    """
    part = signals[settled:]
    part = part[(part[:, F] < TOP) & (part[:, F] > _LEAST)]
    if len(part) < 100:
        message = f"{len(part)} samples of a flow below {TOP:g} of its span: at least 100 needed"
        raise ValueError(message)
    lower, upper = float(part[:, X].min()), float(part[:, X].max())
    drop = float(np.mean(part[:, P1] - part[:, P2]))
    terms = _terms(part, lower, upper, drop)
    flow = np.log(part[:, F])
    weights = np.asarray(np.linalg.lstsq(terms, flow, rcond=None)[0], dtype=np.float64)
    expected = terms @ weights
    error = (flow - expected) ** 2
    parts = np.column_stack([np.ones(len(part)), np.exp(-2.0 * expected)])
    spread = np.maximum(np.linalg.lstsq(parts, error, rcond=None)[0], 0.0)
    floor = 0.1 * float(error.mean())
    return FlowModel(lower, upper, drop, weights, spread + np.array([floor, 0.0]))


def _terms(signals: FloatArray, lower: float, upper: float, drop: float) -> FloatArray:
    x = 4.0 * (np.clip(signals[:, X], lower, upper) - 0.5)
    d = np.log(np.maximum(signals[:, P1] - signals[:, P2], _LEAST) / drop)
    return np.column_stack([np.ones(len(x)), x, x**2, x**3, x**4, d, d * x])
