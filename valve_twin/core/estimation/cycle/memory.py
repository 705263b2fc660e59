# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What earlier cycles taught, and the model that it supports.

All that a process needs which predicts and leaves the estimation of cycles to another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite, nan, sqrt
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Estimate, EstimateStatus, FloatArray

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from valve_twin.core.valves.interface import Options, ValveModel

MEMORY_CYCLES = 50
"""How many cycles the memory reaches back."""

_SIGMA_CYCLES = 10
"""How many cycles the expected residual is taken from."""


@dataclass(frozen=True, slots=True)
class Memory:
    """What earlier cycles taught: their estimates.

    Attributes
    ----------
    estimates : tuple of Estimate
        Every estimator's estimates of the last `MEMORY_CYCLES` cycles, oldest cycle first, inside
        a cycle by name of the estimator.
    """

    estimates: tuple[Estimate, ...]

    @staticmethod
    def empty() -> Memory:
        """Return the memory of a new valve."""
        return Memory(())

    def of(self, estimator: str) -> tuple[Estimate, ...]:
        """Return the estimates of one estimator that were not refused, oldest first."""
        gone = EstimateStatus.REFUSED
        return tuple(
            [e for e in self.estimates if e.estimator == estimator and e.status is not gone]
        )

    def after(self, estimates: Iterable[Estimate]) -> Memory:
        """Return the memory with the estimates of one more cycle."""
        newest = sorted(map(_lean, estimates), key=lambda e: e.estimator)
        return Memory(_last_cycles((*self.estimates, *newest)))


def memory_from_history(estimates: Sequence[Estimate]) -> Memory:
    """Return the memory that a twin had after these estimates.

    Parameters
    ----------
    estimates : sequence of Estimate
        Estimates as stored, in any order; those of the last `MEMORY_CYCLES` cycles are enough.
    """
    ordered = sorted(map(_lean, estimates), key=lambda e: (e.cycle, e.start_ns, e.estimator))
    return Memory(_last_cycles(tuple(ordered)))


@dataclass(frozen=True, slots=True)
class InForce:
    """The model that predicts.

    Attributes
    ----------
    coefficients : (K,) array
        Of the model's `predict`.
    lag : int
        Command to position lag [samples].
    residual_sigma : float
        Expected standard deviation of the one-step residual [1]; NaN = unknown.
    cycle : int
        The cycle that its newest parameter comes from.
    """

    coefficients: FloatArray
    lag: int
    residual_sigma: float
    cycle: int


def model_in_force(
    model: ValveModel, memory: Memory, period_s: float, options: Options
) -> InForce | None:
    """Return the model that the memory supports, or None before the first usable estimate.

    A parameter that the newest cycles did not excite keeps its last value.

    Parameters
    ----------
    model : ValveModel
        The valve's model; its `trend_estimator` predicts.
    memory : Memory
        Estimates so far.
    period_s : float
        Sampling time [s].
    options : mapping
        The model's options.
    """
    return in_force_of(model, memory.of(model.trend_estimator), period_s, options)


def in_force_of(
    model: ValveModel, estimates: tuple[Estimate, ...], period_s: float, options: Options
) -> InForce | None:
    """Merge what cycles know into one model by the model's own `merge`; None where too little.

    Parameters
    ----------
    model : ValveModel
        The valve's model.
    estimates : tuple of Estimate
        Those of one estimator that were not refused, oldest first.
    period_s : float
        Sampling time [s].
    options : mapping
        The model's options.
    """
    if not estimates:
        return None
    values = model.merge(estimates)
    newest = estimates[-1]
    coefficients = model.coefficients(values, newest.lag, period_s, options)
    if not np.isfinite(coefficients).all():
        return None
    return InForce(coefficients, newest.lag, _expected_sigma(estimates), newest.cycle)


def _expected_sigma(estimates: tuple[Estimate, ...]) -> float:
    """Median one-step error of the last cycles, as test data where they were."""
    newest = estimates[-_SIGMA_CYCLES:]
    errors = [e.mse_test if isfinite(e.mse_test) else e.mse_train for e in newest]
    known = [error for error in errors if isfinite(error)]
    return sqrt(median(known)) if known else nan


def _lean(estimate: Estimate) -> Estimate:
    """Leave out what no later cycle asks for: a worker process is sent the memory."""
    extra = (estimate.trend_reason, estimate.disagreements, estimate.guards, estimate.conditions)
    if not any(extra):
        return estimate
    return replace(estimate, trend_reason="", disagreements=(), guards=(), conditions=())


def _last_cycles(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    """Keep the last `MEMORY_CYCLES` cycles."""
    starts = [
        i
        for i, e in enumerate(estimates)
        if i == 0 or (e.cycle, e.start_ns) != (estimates[i - 1].cycle, estimates[i - 1].start_ns)
    ]
    return estimates[starts[-MEMORY_CYCLES] :] if len(starts) > MEMORY_CYCLES else estimates
