# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Estimates of one kind that come many at a time: columns from the start, no object for each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.data.robust import NORMAL_975

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from valve_twin.core.types import FloatArray, Guard, IntArray, ParameterValue


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive estimates of one model and estimator with the same parameters and conditions.

    None was refused as implausible or holds a motion.

    Attributes
    ----------
    model : str
        Name of the model.
    is_trend : bool
        They feed the trend; else they are features of cycles.
    names, conditions : tuple of str
        Names of the P parameters and of the C conditions, each once.
    cycle, start_ns, end_ns, missed : (N,) int64 arrays
        As in `Rows`.
    status : (N,) int8 array
        `EstimateStatus`.
    error : (N,) array
        One-step mean squared error on the cycle as test data [1].
    states : (N, P) int8 array
        `ParameterStatus`.
    numbers : (N, P, 4) array
        Value, standard error and 95 % limits of the parameters [unit].
    under : (N, C) array
        Values of the conditions [unit].
    reasons, failed : mapping
        By row, of some: why it was refused; checks that it failed.
    """

    model: str
    is_trend: bool
    names: tuple[str, ...]
    conditions: tuple[str, ...]
    cycle: IntArray
    start_ns: IntArray
    end_ns: IntArray
    missed: IntArray
    status: NDArray[np.int8]
    error: FloatArray
    states: NDArray[np.int8]
    numbers: FloatArray
    under: FloatArray
    reasons: Mapping[int, str] = field(default_factory=dict)
    failed: Mapping[int, tuple[Guard, ...]] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of estimates N."""
        return len(self.cycle)

    @property
    def fixed(self) -> dict[tuple[str, str], object]:
        """Values of the columns that every row has, by kind and name."""
        return {
            ("int", "cycle"): self.cycle,
            ("int", "start_ns"): self.start_ns,
            ("int", "end_ns"): self.end_ns,
            ("int", "missed_cycles"): self.missed,
            ("kind", "status"): self.status,
            ("float", "mse_test"): self.error,
            ("bool", "implausible"): False,
        }

    @property
    def spreads(self) -> FloatArray:
        """Variance of the parameters' limits beyond their repeatability, (N, P) [unit^2]."""
        error, lower, upper = (self.numbers[..., k] for k in (1, 2, 3))
        with np.errstate(invalid="ignore", over="ignore"):
            half = 0.5 * (upper - lower) / NORMAL_975
            spread = np.maximum(half * half - error * error, 0.0)
        return np.asarray(np.where(np.isfinite(half) & np.isfinite(error), spread, np.nan))

    def part(self, first: int, end: int) -> Block:
        """Return the estimates from `first` to before `end`."""
        if first == 0 and end >= len(self):
            return self
        some = slice(first, end)
        return replace(
            self,
            cycle=self.cycle[some],
            start_ns=self.start_ns[some],
            end_ns=self.end_ns[some],
            missed=self.missed[some],
            status=self.status[some],
            error=self.error[some],
            states=self.states[some],
            numbers=self.numbers[some],
            under=self.under[some],
            reasons={k - first: r for k, r in self.reasons.items() if first <= k < end},
            failed={k - first: f for k, f in self.failed.items() if first <= k < end},
        )


def spread_of(p: ParameterValue) -> float:
    """Return the same of one parameter; NaN = not known [unit^2]."""
    half, error = 0.5 * (p.upper_95 - p.lower_95) / NORMAL_975, p.standard_error
    if not (isfinite(half) and isfinite(error)):
        return np.nan
    return float(max(half * half - error * error, 0.0))
