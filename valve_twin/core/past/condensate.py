# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What an hour or a day of cycles says of each parameter, once the cycles are let go of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.diagnosis.features import MOTION
from valve_twin.core.types import EstimateStatus

if TYPE_CHECKING:
    from collections.abc import Iterator

    from valve_twin.core.types import Estimate

HOUR_S, DAY_S = 3600, 86400
"""Spans of time that cycles are condensed over, as the clock of the data divides it [s]."""

OF_CYCLES = ""
"""Estimator of what is said of cycles themselves: accepted, refused, samples, lost, length_s."""

REFUSED = "refused"
"""Whether nothing was learnt from a cycle: it is not accepted, or the trend's estimate is refused.

Histories that were condensed by older versions do not hold it."""

_SHARES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, slots=True)
class Condensate:
    """Values of one parameter in the cycles that began within a span of time.

    Attributes
    ----------
    span_s : int
        Length of the span, `HOUR_S` or `DAY_S` [s].
    start_ns, end_ns : int
        First stamp of its first cycle and last stamp of its last one [ns].
    cycle, last_cycle : int
        Their numbers [1].
    estimator, parameter : str
        Names; estimator `OF_CYCLES` = of the cycles themselves.
    count, usable : int
        Values, refused ones included, and those of them that could be used [1].
    minimum, maximum, mean : float
        Of those that could be used; NaN where there are none [unit of the parameter].
    quantile_05, quantile_25, median, quantile_75, quantile_95 : float
        Likewise, between neighbours by a line.
    """

    span_s: int
    start_ns: int
    end_ns: int
    cycle: int
    last_cycle: int
    estimator: str
    parameter: str
    count: int
    usable: int
    minimum: float
    maximum: float
    mean: float
    quantile_05: float
    quantile_25: float
    median: float
    quantile_75: float
    quantile_95: float


@dataclass(frozen=True, slots=True)
class Condensed:
    """How far the cycles of a valve are condensed, and how many they were.

    Attributes
    ----------
    cycle : int
        The last one that is: all up to it are, but for estimates that the trend needs [1].
    first_cycle, start_ns, end_ns : int
        The first one, its first stamp, and the last stamp of the last one [1, ns].
    cycles, accepted, reproducible : int
        Cycles, those handed to estimation, those whose inputs all came with stamps [1].
    samples, lost : int
        Samples in them and samples known to be missing [1].
    missed, gaps : int
        Cycles missed between them, and gaps of which nobody knows how many it took [1].
    estimates : int
        Estimates of them [1].
    """

    cycle: int
    first_cycle: int
    start_ns: int
    end_ns: int
    cycles: int = 0
    accepted: int = 0
    reproducible: int = 0
    samples: int = 0
    lost: int = 0
    missed: int = 0
    gaps: int = 0
    estimates: int = 0


class _Key(NamedTuple):
    span_s: int
    number: int
    estimator: str
    parameter: str


class _Values:
    """Values that came with cycles, and the first and last of these."""

    __slots__ = ("cycle", "end_ns", "last_cycle", "start_ns", "values")

    def __init__(self, cycle: int, start_ns: int) -> None:
        self.cycle, self.start_ns = cycle, start_ns
        self.last_cycle, self.end_ns = cycle, start_ns
        self.values: list[float] = []


class Condenser:
    """Takes cycles and estimates by their number and gives what is to be kept of them.

    Parameters
    ----------
    spans : tuple of int
        Lengths of the spans to condense over [s].
    """

    def __init__(self, spans: tuple[int, ...] = (HOUR_S, DAY_S)) -> None:
        self._spans = spans
        self._found: dict[_Key, _Values] = {}

    def add(
        self, cycle: int, start_ns: int, end_ns: int, estimator: str, values: dict[str, float]
    ) -> None:
        """Take values of one cycle.

        Parameters
        ----------
        cycle, start_ns, end_ns : int
            Its number, and its first and last stamp [ns].
        estimator : str
            Whose values they are.
        values : dict
            By name of the parameter; NaN = cannot be used [unit].
        """
        for span_s in self._spans:
            number = start_ns // (span_s * 10**9)
            for name, value in values.items():
                key = _Key(span_s, number, estimator, name)
                found = self._found.get(key)
                if found is None:
                    found = self._found[key] = _Values(cycle, start_ns)
                found.values.append(value)
                found.last_cycle = cycle
                found.end_ns = end_ns

    def add_estimate(self, estimate: Estimate) -> None:
        """Take the values of an estimate; those that a trend may not use only count."""
        given = estimate.status is not EstimateStatus.REFUSED
        values = {
            p.name: p.value if given and p.usable else np.nan
            for p in estimate.parameters
            if not p.name.startswith(MOTION)
        }
        own = estimate.cycle, estimate.start_ns, estimate.end_ns
        self.add(*own, estimate.estimator, values)

    def result(self) -> Iterator[Condensate]:
        """Yield what was condensed, a span and parameter at a time."""
        for key, found in self._found.items():
            values = np.array(found.values, dtype=np.float64)
            values = values[np.isfinite(values)]
            numbers = [float("nan")] * (3 + len(_SHARES))
            if len(values):
                middle = np.quantile(values, _SHARES).tolist()
                numbers = [float(values.min()), float(values.max()), float(values.mean()), *middle]
            yield Condensate(
                key.span_s,
                found.start_ns,
                found.end_ns,
                found.cycle,
                found.last_cycle,
                key.estimator,
                key.parameter,
                len(found.values),
                len(values),
                *numbers,
            )
