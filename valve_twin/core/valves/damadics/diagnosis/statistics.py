# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Sliding statistics of the residuals: what is compared with its healthy limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.damadics.diagnosis.flow_model import (
    FlowModel,
    FlowResidual,
    learn_flow,
)
from valve_twin.core.valves.damadics.diagnosis.motion_model import (
    CV,
    P1,
    P2,
    T1,
    MotionModel,
    lagged,
    learn_motion,
)

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

SETTLED = 30
"""Samples after a start from rest that say nothing, assumed."""
WINDOWS = (5, 20, 100, 600)
"""Windows of the position's statistics, assumed [samples]."""
FLOW_WINDOWS = (10, 60, 600)
"""Windows of the flow's mean, assumed [samples]."""
INPUT_WINDOW = 10
"""Window of the means of pressures and temperature, assumed [samples]."""
PATTERN_WINDOWS = (100, 600)
"""Windows of the patterns over the quarters of the motion, assumed [samples]."""
QUARTERS = 4
"""Rising below and above the middle of the command, falling above and below it."""

_LEAST_IN_QUARTER = 5  # samples


@dataclass(frozen=True, slots=True)
class Models:
    """What a healthy valve does, learnt from one healthy record.

    Attributes
    ----------
    free, step : MotionModel
        Position from command and pressures alone, and one step ahead.
    flow : FlowModel
        Flow from position and pressures.
    middle : float
        Middle of the command [1].
    """

    free: MotionModel
    step: MotionModel
    flow: FlowModel
    middle: float


@dataclass(frozen=True, slots=True)
class Residuals:
    """What is left of N samples: (N,) each, positions [1]; quarter of the motion 0 .. 3."""

    free: FloatArray
    step: FloatArray
    flow: FlowResidual
    quarter: FloatArray


@dataclass(frozen=True, slots=True)
class Statistics:
    """Sliding statistics of N samples; NaN where their window is not full.

    Attributes
    ----------
    values : (N, K) array
        Means and root mean squares of the residuals of position, means of that of the flow, means
        of pressures and temperature [1].
    patterns : (2, N, 8) array
        By window, mean of both residuals of position in every quarter of the motion [1].
    """

    values: FloatArray
    patterns: FloatArray


MOTION_VALUES = 4 * len(WINDOWS)
"""Columns of `values` that come from the position; `SCALES` are those that scale them."""
FREE_SCALE, STEP_SCALE = 2 * len(WINDOWS) - 1, 4 * len(WINDOWS) - 1
"""Columns of the root mean squares over the longest window."""


def learn_models(signals: FloatArray) -> Models:
    """Learn from the official signals (N, 6) of a healthy record [1]."""
    return Models(
        free=learn_motion(signals, 0, SETTLED),
        step=learn_motion(signals, 1, SETTLED),
        flow=learn_flow(signals, SETTLED),
        middle=float(np.median(signals[:, CV])),
    )


def residuals(models: Models, signals: FloatArray) -> Residuals:
    """Return the residuals of signals (N, 6) [1]."""
    command = signals[:, CV]
    rising, above = command > lagged(command, 1), command > models.middle
    quarter = np.where(rising, np.where(above, 1, 0), np.where(above, 2, 3)).astype(np.float64)
    return Residuals(
        models.free.residual(signals),
        models.step.residual(signals),
        models.flow.residual(signals),
        quarter,
    )


def statistics(found: Residuals, signals: FloatArray) -> Statistics:
    """Return the sliding statistics of residuals and signals (N, 6) [1]."""
    known = np.arange(len(signals)) >= SETTLED
    columns = []
    for r in (found.free, found.step):
        columns += [_mean(r, known, w) for w in WINDOWS]
        columns += [np.sqrt(_mean(r**2, known, w)) for w in WINDOWS]
    weight = np.where(known, found.flow.weight, 0.0)
    for w in FLOW_WINDOWS:
        total = _mean(weight, known, w)
        mean = _mean(weight * found.flow.ratio, known, w) / np.where(total > 0.0, total, np.nan)
        columns.append(mean)
    columns += [_mean(signals[:, c], known, INPUT_WINDOW) for c in (P1, P2, T1)]
    patterns = np.stack([_patterns(found, known, w) for w in PATTERN_WINDOWS])
    return Statistics(np.ascontiguousarray(np.column_stack(columns)), patterns)


def _patterns(found: Residuals, known: BoolArray, window: int) -> FloatArray:
    columns = []
    for r in (found.free, found.step):
        for quarter in range(QUARTERS):
            there = known & (found.quarter == quarter)
            count = window * _mean(there.astype(np.float64), known, window)
            total = window * _mean(np.where(there, r, 0.0), known, window)
            enough = count >= _LEAST_IN_QUARTER
            columns.append(np.where(enough, total / np.where(enough, count, 1.0), np.nan))
    return np.column_stack(columns)


def _mean(x: FloatArray, known: BoolArray, window: int) -> FloatArray:
    """Return the mean over the last samples, NaN where not all of them are known."""
    sums = np.concatenate([np.zeros(1), np.cumsum(np.where(known, x, 0.0))])
    counts = np.concatenate([np.zeros(1), np.cumsum(known)])
    last = np.arange(1, len(x) + 1)
    first = np.maximum(last - window, 0)
    mean = (sums[last] - sums[first]) / window
    mean = np.where(np.abs(mean) < 1e-15, 0.0, mean)
    return np.where(counts[last] - counts[first] == window, mean, np.nan)
