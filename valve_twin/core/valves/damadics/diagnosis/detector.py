# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Detection: statistics beyond their limits of a healthy day, as such or against the last hour.

A slow departure shows in what a statistic is ("absolute"), a sudden one in how it differs from its
own sliding mean ("jump"), which stands still while there is an alarm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.valves.damadics.diagnosis.statistics import (
    FREE_SCALE,
    MOTION_VALUES,
    PATTERN_WINDOWS,
    QUARTERS,
    STEP_SCALE,
    Models,
    Residuals,
    learn_models,
    residuals,
    statistics,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray
    from valve_twin.core.valves.damadics.diagnosis.statistics import Statistics

MODEL_SAMPLES = 14400
"""Samples at the start of the healthy record from which the models are learnt, assumed."""
COMMISSIONED = 7200
"""Samples at its start whose mean is what a new valve shows, assumed."""
MEMORY = 3600.0
"""Time constant of the sliding mean, assumed [samples]."""
FIRST_MEMORY = 900.0
"""The same at the start of a record, assumed [samples]: a valve's own past soon counts."""
HOLD = 100
"""Samples that an alarm outlives what raised it, assumed: a period of the command."""
MARGIN = 2.5
"""Limits beyond the extremes of the healthy record, in standard deviations, assumed [1]."""
PATTERN_MARGIN = 1.4
"""Limits of the patterns over the extremes of the healthy record, assumed [1]."""
PATIENCE = 3600
"""Samples of an alarm after which the sliding means go on, assumed."""
INPUT_MARGIN = 0.25
"""Part of the healthy range of a pressure or temperature that it may leave it, assumed [1]."""

_INPUTS = 3  # the last columns of the values


class Limits(NamedTuple):
    """Healthy limits: of K values (K,) as they are and of their jumps, of the patterns (2,).

    `centre` (K,) and `mean` (2, 8) are of a new valve, `whole` and `sudden` (2, 8, 8) inverse
    covariances of the patterns and of their jumps.
    """

    centre: FloatArray
    lower: FloatArray
    upper: FloatArray
    jump_lower: FloatArray
    jump_upper: FloatArray
    mean: FloatArray
    whole: FloatArray
    whole_limit: FloatArray
    sudden: FloatArray
    sudden_limit: FloatArray


@dataclass(frozen=True, slots=True)
class Alarms:
    """What the detector says of N samples.

    Attributes
    ----------
    high : (N,) bool array
        Detection decision.
    cause : (N,) array
        What raised it: 0 nothing, 1 + k value k, 101 + k its jump, 201 + i pattern i, 211 + i
        its jump.
    pattern : (N, 8) array
        Sliding mean of the patterns over the longest window before the alarm [1].
    residuals : Residuals
        Behind it.
    """

    high: BoolArray
    cause: FloatArray
    pattern: FloatArray
    residuals: Residuals


@dataclass(frozen=True, slots=True)
class Detector:
    """A valve that was healthy, and how far a healthy one strays."""

    models: Models
    limits: Limits

    def detect(self, signals: FloatArray) -> Alarms:
        """Watch the official signals (N, 6) [1]; every decision rests on what was before it."""
        found = residuals(self.models, signals)
        seen = statistics(found, signals)
        n = len(signals)
        cause, pattern = np.zeros(n), np.empty((n, 2 * QUARTERS))
        _watch(seen.values, seen.patterns, self.limits, cause, pattern)
        return Alarms(_held(cause > 0.0), cause, pattern, found)


def learn(signals: FloatArray) -> Detector:
    """Learn a detector from the official signals (N, 6) of a healthy record, best of a day.

    Parameters
    ----------
    signals : (N, 6) array
        Official signals [1].

    Raises
    ------
    ValueError
        If the record is too short.
    """
    if len(signals) < 2 * COMMISSIONED:
        message = f"a healthy record of {len(signals)} samples: {2 * COMMISSIONED} are needed"
        raise ValueError(message)
    models = learn_models(signals[:MODEL_SAMPLES])
    seen = statistics(residuals(models, signals), signals)
    return Detector(models, _limits(seen))


def _limits(seen: Statistics) -> Limits:
    values = seen.values
    centre = np.nanmean(values[:COMMISSIONED], axis=0)
    base = _slid(values, centre)
    jumps = (values - base) / _scales(base)
    mean = np.nanmean(seen.patterns[:, :COMMISSIONED], axis=1)
    whole: list[FloatArray] = []
    sudden: list[FloatArray] = []
    limits: list[float] = []
    for i in range(len(PATTERN_WINDOWS)):
        pattern = seen.patterns[i]
        scale = np.repeat(base[:, [FREE_SCALE, STEP_SCALE]], QUARTERS, axis=1)
        apart = (pattern - mean[i], (pattern - _slid(pattern, mean[i])) / scale)
        for d, into in zip(apart, (whole, sudden), strict=True):
            finite = d[np.isfinite(d).all(axis=1)]
            into.append(np.linalg.inv(finite.T @ finite / len(finite)))
            far = np.einsum("ni,ij,nj->n", finite, into[-1], finite)
            limits.append(PATTERN_MARGIN**2 * float(far.max()))
    lower, upper = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    span = INPUT_MARGIN * (upper - lower)[-_INPUTS:]
    beyond = MARGIN * np.nanstd(values - base, axis=0)
    lower, upper = lower - beyond, upper + beyond
    beyond = MARGIN * np.nanstd(jumps, axis=0)
    jump_lower, jump_upper = np.nanmin(jumps, axis=0) - beyond, np.nanmax(jumps, axis=0) + beyond
    jump_lower[-_INPUTS:], jump_upper[-_INPUTS:] = -np.inf, np.inf
    lower[-_INPUTS:] -= span
    upper[-_INPUTS:] += span
    return Limits(
        centre=centre,
        lower=lower,
        upper=upper,
        jump_lower=jump_lower,
        jump_upper=jump_upper,
        mean=mean,
        whole=np.stack(whole),
        whole_limit=np.array(limits[0::2]),
        sudden=np.stack(sudden),
        sudden_limit=np.array(limits[1::2]),
    )


def _slid(values: FloatArray, start: FloatArray) -> FloatArray:
    """Return the sliding mean before each row (N, K), from `start` (K,)."""
    out = np.empty_like(values)
    _slide(values, start.copy(), out)
    return out


def _scales(base: FloatArray) -> FloatArray:
    """Return what divides each column's jump: a sliding root mean square of its residual, or 1."""
    scales = np.ones_like(base)
    half = MOTION_VALUES // 2
    scales[:, :half] = base[:, [FREE_SCALE]]
    scales[:, half:MOTION_VALUES] = base[:, [STEP_SCALE]]
    return scales


@njit(cache=True)
def _slide(values: FloatArray, base: FloatArray, out: FloatArray) -> None:
    for n in range(len(values)):
        out[n] = base
        _follow(values[n], base, min(MEMORY, FIRST_MEMORY + n))


@njit(cache=True)
def _distance(d: FloatArray, inverse: FloatArray) -> float:
    total = 0.0
    for i in range(len(d)):
        for j in range(len(d)):
            total += d[i] * inverse[i, j] * d[j]
    return total


@njit(cache=True)
def _watch(
    values: FloatArray, patterns: FloatArray, limits: Limits, cause: FloatArray, out: FloatArray
) -> None:
    base, mean = limits.centre.copy(), limits.mean.copy()
    half = MOTION_VALUES // 2
    d = np.empty(patterns.shape[2])
    held, lasted = 0, 0
    for n in range(len(values)):
        out[n] = mean[-1]
        for i in range(len(patterns)):
            for kind in range(2):
                for k in range(len(d)):
                    d[k] = patterns[i, n, k] - (limits.mean[i, k] if kind == 0 else mean[i, k])
                    if kind == 1:
                        d[k] /= base[FREE_SCALE] if k < QUARTERS else base[STEP_SCALE]
                inverse = limits.whole[i] if kind == 0 else limits.sudden[i]
                limit = limits.whole_limit[i] if kind == 0 else limits.sudden_limit[i]
                if _distance(d, inverse) > limit:
                    cause[n] = 201.0 + 10.0 * kind + i
        for k in range(values.shape[1]):
            x = values[n, k]
            scale = 1.0
            if k < MOTION_VALUES:
                scale = base[FREE_SCALE] if k < half else base[STEP_SCALE]
            jump = (x - base[k]) / scale
            if jump < limits.jump_lower[k] or jump > limits.jump_upper[k]:
                cause[n] = 101.0 + k
            if x < limits.lower[k] or x > limits.upper[k]:
                cause[n] = 1.0 + k
        held = HOLD if cause[n] > 0.0 else held - 1
        lasted = lasted + 1 if held > 0 else 0
        if 0 < lasted < PATIENCE:
            continue
        memory = min(MEMORY, FIRST_MEMORY + n)
        _follow(values[n], base, memory)
        for i in range(len(patterns)):
            _follow(patterns[i, n], mean[i], memory)


@njit(cache=True)
def _follow(x: FloatArray, base: FloatArray, memory: float) -> None:
    """Let sliding means (K,) follow what is known of x (K,)."""
    for k in range(len(base)):
        if np.isfinite(x[k]):
            base[k] += (x[k] - base[k]) / memory


def _held(raised: BoolArray) -> BoolArray:
    """Return alarms that outlive what raised them by `HOLD` samples."""
    last = np.maximum.accumulate(np.where(raised, np.arange(len(raised)), -HOLD - 1))
    held: BoolArray = np.arange(len(raised)) - last < HOLD
    return held
