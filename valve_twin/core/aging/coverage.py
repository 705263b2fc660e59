# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How often the limits of the remaining life hold the truth, on simulated histories.

Each simulated history goes the whole way of a stored one: outliers, segments, line, reference,
Fieller's limits. The gain falls on a straight line by 13.6 % in 105 cycles with a scatter of
2.7 % of a single estimate, white or AR(1), and has to be changed at -20 % (equations.md 2.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Law, Threshold
from valve_twin.core.aging.verdict import TrendStatus
from valve_twin.core.types import Estimate, EstimateStatus, Parameter, ParameterValue

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray

SLOPE = -0.136 / 105.0
"""Relative change of the simulated gain a cycle [1/cycle], equations.md 2.5."""

SCATTER = 0.027
"""Standard deviation of a single simulated estimate [1], equations.md 2.5."""

LIMIT_PERCENT = -20.0
"""Change against the reference at which service is due [%], equations.md 2.5."""

SAMPLES = (60, 105)
"""Lengths of the simulated histories [cycles]."""

AUTOCORRELATIONS = (0.0, 0.5)
"""Lag-1 autocorrelations of the simulated scatter [1]."""

GAIN = Parameter("gain", "1", "simulated gain", trend=True)
"""The parameter of simulated histories."""

_RUN_IN = 60  # samples after which AR(1) scatter has forgotten how it began


@dataclass(frozen=True, slots=True)
class Coverage:
    """What the limits held in one kind of simulated history.

    Attributes
    ----------
    samples : int
        Cycles of each history.
    autocorrelation : float
        Lag-1 autocorrelation of the scatter [1].
    histories : int
        How many were simulated.
    nominal : float
        Confidence that the limits claim [1].
    covered : float
        Share of the histories whose limits hold the true remaining life; unbounded above counts
        as holding, a history of which nothing is said does not [1].
    too_early, too_late : float
        Share of the histories whose whole interval lies before, after the truth [1].
    unbounded : float
        Share whose upper limit is infinite [1].
    silent : float
        Share of which nothing is said, because the newest segment is too short [1].
    median_late : float
        Share whose median lies after the truth [1].
    """

    samples: int
    autocorrelation: float
    histories: int
    nominal: float
    covered: float
    too_early: float
    too_late: float
    unbounded: float
    silent: float
    median_late: float

    @property
    def standard_error(self) -> float:
        """Binomial standard deviation of `covered` if it were as nominal [1]."""
        return float(np.sqrt(self.nominal * (1.0 - self.nominal) / self.histories))


def coverage_of_life(
    samples: int,
    autocorrelation: float,
    *,
    histories: int = 500,
    confidence: float = 0.9,
    seed: int = 0,
    on_history: Callable[[], object] = lambda: None,
) -> Coverage:
    """Count how often the limits of the remaining life hold the truth.

    Parameters
    ----------
    samples : int
        Cycles of each history, 10 or more.
    autocorrelation : float
        Lag-1 autocorrelation of the scatter, 0 to below 1 [1].
    histories : int
        How many are simulated.
    confidence : float
        That the limits claim [1].
    seed : int
        The same seed gives the same histories.
    on_history : callable
        Called after each history.

    Returns
    -------
    Coverage
        Shares of the histories.
    """
    config = AgingConfig(thresholds=(Threshold(GAIN.name, LIMIT_PERCENT),), laws=(Law.LINE.value,))
    cycle = np.arange(1.0, samples + 1.0)
    truth = true_remaining(samples, config.reference_cycles)
    rng = np.random.default_rng([seed, samples, round(1000 * autocorrelation)])
    values = 1.0 + SLOPE * cycle + SCATTER * ar1_scatter(rng, histories, samples, autocorrelation)
    trends = []
    for row in values:
        history = estimates_of(row)
        found = assess(history, (), config, parameters=(GAIN,), confidence=confidence)
        trends.append(found.trends[0])
        on_history()
    spoken = [t for t in trends if t.status is not TrendStatus.NOT_ENOUGH_DATA]
    too_late = sum(t.remaining_low > truth for t in spoken)
    too_early = sum(t.remaining_high < truth for t in spoken)
    return Coverage(
        samples=samples,
        autocorrelation=autocorrelation,
        histories=histories,
        nominal=confidence,
        covered=(len(spoken) - too_late - too_early) / histories,
        too_early=too_early / histories,
        too_late=too_late / histories,
        unbounded=sum(t.unbounded for t in spoken) / histories,
        silent=1.0 - len(spoken) / histories,
        median_late=sum(t.remaining_median > truth for t in spoken) / histories,
    )


def true_remaining(samples: int, reference_cycles: int) -> float:
    """Return what remains after `samples` cycles to the limit of the line without scatter.

    The reference is the mean of the line over its first `reference_cycles` cycles.
    """
    reference = 1.0 + SLOPE * 0.5 * (reference_cycles + 1)
    limit = (1.0 + LIMIT_PERCENT / 100.0) * reference
    return (limit - 1.0) / SLOPE - samples


def ar1_scatter(
    rng: np.random.Generator, histories: int, samples: int, autocorrelation: float
) -> FloatArray:
    """Return (histories, samples) AR(1) scatter of unit standard deviation, one row a history.

    Parameters
    ----------
    rng : Generator
        Source of the random numbers.
    histories, samples : int
        Rows and columns [1].
    autocorrelation : float
        Between neighbours [1].
    """
    white = rng.standard_normal((histories, samples + _RUN_IN))
    out = np.empty_like(white)
    out[:, 0] = white[:, 0]
    fresh = np.sqrt(1.0 - autocorrelation**2)
    for i in range(1, samples + _RUN_IN):
        out[:, i] = autocorrelation * out[:, i - 1] + fresh * white[:, i]
    kept: FloatArray = out[:, _RUN_IN:]
    return kept


def estimates_of(values: FloatArray) -> list[Estimate]:
    """Return (N,) values of `GAIN` as stored estimates, one a cycle."""
    return [
        Estimate(
            model="",
            estimator="",
            cycle=number,
            start_ns=2 * number,
            end_ns=2 * number + 1,
            parameters=(ParameterValue(GAIN.name, value),),
            status=EstimateStatus.ACCEPTED,
            reason="",
            used_by_trend=True,
        )
        for number, value in enumerate(values.tolist(), 1)
    ]
