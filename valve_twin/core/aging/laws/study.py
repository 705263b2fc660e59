# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How often the limits of the remaining life hold where aging need not be a line.

Random histories with known truth run through `assess`: the way of a parameter to a limit of 20 %
is a line, an exponential, a power or a saturating law; 30 to 150 cycles that end after 30 to 95 %
of the life, a single estimate scatters by 0.2 to 2.7 % with a lag-1 autocorrelation of 0 to 0.5.
The limit counts from the mean of the first ten cycles; a third of the saturating ones never reach
it. Each forecast also says how probable it is
that the limit is reached before a next stop, drawn between 0 and twice what a line would need;
Brier's score of it is compared with that of a forecast that knows the base rate only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.aging.assess import assess
from valve_twin.core.aging.config import AgingConfig, Law, Threshold
from valve_twin.core.aging.coverage import GAIN, ar1_scatter, estimates_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from valve_twin.core.aging.verdict import Trend
    from valve_twin.core.types import FloatArray

LIMIT_PERCENT = 20.0
"""Change against the reference at which service is due [%]."""

NEVER_SHARE = 1.0 / 3.0
"""Share of the saturating histories that never reach the limit [1]."""


@dataclass(frozen=True, slots=True)
class AgingCase:
    """One random history.

    Attributes
    ----------
    law : Law
        How it ages.
    values : (N,) array
        Estimates of cycles 1 to N [1].
    limit_percent : float
        The limit that lies ahead [%].
    remaining : float
        True remaining life, infinite = the limit is never reached [cycles].
    next_stop : float
        Cycles to the next stop [cycles].
    """

    law: Law
    values: FloatArray
    limit_percent: float
    remaining: float
    next_stop: float


@dataclass(frozen=True, slots=True)
class LawCoverage:
    """What the limits held in the histories of one law.

    Attributes
    ----------
    law : str
        How they aged.
    histories : int
        How many were simulated.
    nominal : float
        Confidence that the limits claim [1].
    covered : float
        Share of the forecasts whose limits hold the true remaining life; unbounded above counts
        as holding [1].
    too_early, too_late : float
        Share whose whole interval lies before, after the truth [1].
    bounded : float
        Share that has an upper limit [1].
    bends : float
        Share of which it is said that the trend bends [1].
    silent : float
        Share of which nothing is said [1].
    brier, reached : float
        Mean squared error of the probability to reach the limit before the next stop, and the
        share of the histories that reached it [1].
    """

    law: str
    histories: int
    nominal: float
    covered: float
    too_early: float
    too_late: float
    bounded: float
    bends: float
    silent: float
    brier: float
    reached: float


def brier_skill(rows: Sequence[LawCoverage]) -> float:
    """Return Brier's skill score of all rows together against their base rate [1]."""
    count = sum(row.histories for row in rows)
    reached = sum(row.histories * row.reached for row in rows) / count
    brier = sum(row.histories * row.brier for row in rows) / count
    return 1.0 - brier / (reached * (1.0 - reached))


def draw_case(rng: np.random.Generator, law: Law) -> AgingCase:
    """Return one random history of a law (ranges: see the module)."""
    count = int(rng.integers(30, 151))
    life = count / rng.uniform(0.3, 0.95)
    scatter = np.exp(rng.uniform(np.log(0.002), np.log(0.027)))
    rho, sign = rng.uniform(0.0, 0.5), float(rng.choice([-1.0, 1.0]))
    shape, reach = _draw_shape(rng, law)
    cycle = np.arange(1.0, count + 1.0)
    first = float(shape(cycle[: AgingConfig().reference_cycles] / life).mean())
    change = 0.01 * LIMIT_PERCENT * sign
    size = reach * change / (1.0 - (1.0 + change) * first)  # reach 1: the limit at `life`
    noise = scatter * ar1_scatter(rng, 1, count, rho)[0]
    stop = float(rng.uniform(0.0, 2.0 * (life - count)))
    return AgingCase(
        law=law,
        values=1.0 + size * shape(cycle / life) + noise,
        limit_percent=sign * LIMIT_PERCENT,
        remaining=life - count if reach == 1.0 else np.inf,
        next_stop=stop,
    )


def _draw_shape(
    rng: np.random.Generator, law: Law
) -> tuple[Callable[[FloatArray], FloatArray], float]:
    """Return a shape with 1 at the end of the life, and how much of the limit it makes there."""
    if law is Law.LINE:
        return (lambda u: u), 1.0
    if law is Law.EXPONENTIAL:
        rate = rng.uniform(1.0, 5.0)
        return (lambda u: np.expm1(rate * u) / np.expm1(rate)), 1.0
    if law is Law.POWER:
        fast = rng.random() < 0.5
        exponent = np.exp(rng.uniform(np.log(1.4), np.log(4.0))) if fast else rng.uniform(0.4, 0.7)
        return (lambda u: u**exponent), 1.0
    rate = rng.uniform(1.0, 4.0)
    never = rng.random() < NEVER_SHARE
    reach = rng.uniform(0.5, 0.9) * -np.expm1(-rate) if never else 1.0
    return (lambda u: np.expm1(-rate * u) / np.expm1(-rate)), float(reach)


def study_laws(
    *,
    histories: int = 200,
    confidence: float = 0.9,
    seed: int = 0,
    on_history: Callable[[], object] = lambda: None,
) -> tuple[LawCoverage, ...]:
    """Count how often the limits of the remaining life hold the truth, law by law.

    Parameters
    ----------
    histories : int
        Simulated of each law.
    confidence : float
        That the limits claim [1].
    seed : int
        The same seed gives the same histories.
    on_history : callable
        Called after each history.

    Returns
    -------
    tuple of LawCoverage
        One a law.
    """
    rows = []
    for place, law in enumerate(Law):
        rng = np.random.default_rng([seed, place])
        cases: list[AgingCase] = []
        trends: list[Trend] = []
        for _ in range(histories):
            cases.append(draw_case(rng, law))
            trends.append(forecast(cases[-1], confidence))
            on_history()
        rows.append(_summary(law, cases, trends, confidence))
    return tuple(rows)


def forecast(case: AgingCase, confidence: float) -> Trend:
    """Return what is said after the last cycle of a history."""
    config = AgingConfig(
        thresholds=(Threshold(GAIN.name, case.limit_percent),), next_stop=repr(case.next_stop)
    )
    history = estimates_of(case.values)
    return assess(history, (), config, parameters=(GAIN,), confidence=confidence).trends[0]


def _summary(
    law: Law, cases: Sequence[AgingCase], trends: Sequence[Trend], confidence: float
) -> LawCoverage:
    count = len(cases)
    pairs = [(c, t) for c, t in zip(cases, trends, strict=True) if np.isfinite(t.threshold)]
    spoken = max(len(pairs), 1)
    late = sum(t.remaining_low > c.remaining for c, t in pairs)
    early = sum(t.remaining_high < c.remaining for c, t in pairs)
    came = np.array([float(c.remaining <= c.next_stop) for c, _ in pairs])
    told = np.array([t.next_stop_probability for _, t in pairs])
    return LawCoverage(
        law=law.value,
        histories=count,
        nominal=confidence,
        covered=1.0 - (late + early) / spoken,
        too_early=early / spoken,
        too_late=late / spoken,
        bounded=sum(not t.unbounded for _, t in pairs) / spoken,
        bends=sum(t.bends for _, t in pairs) / spoken,
        silent=1.0 - len(pairs) / count,
        brier=float(np.mean((told - came) ** 2)),
        reached=float(came.mean()),
    )
