# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What other structures would make of a cycle: how far a term that is left out moves the rest.

The plain law fits a valve that lags, sticks, has play, settles elsewhere or answers between two
samples with rates that repeat and are wrong: no scatter shows that. So each such term is fitted
beside the five parameters in turn, and where one follows the cycle better it stays and the others
are tried on top. How far the five parameters move is what the structure may have done to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import minimise
from valve_twin.core.valves.positioner import extended as law
from valve_twin.core.valves.positioner.extended import (
    LAG,
    MOTION_SIZE,
    N_TRANSITION,
    delayed,
    move,
    rest_at,
    target_of,
    transition,
)
from valve_twin.core.valves.positioner.fit import shown_speeds, thin
from valve_twin.core.valves.positioner.kernels import N_PARAMETERS
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.estimation.solvers.least_squares import Limits
    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.core.valves.positioner.fit import Record, Solution

_PARTS = 4  # of a sample, to which a delay is found
_MOST_TERMS = 4
_GAIN = 12.0  # of the cost in a variance of the residual, by which a term must follow better [1]
_SCREENING, _ITERATIONS = 4, 12  # steps of a search, of that of the best
_MOST_SAMPLES = 1000  # a record twice as long is compared on every second sample, and so on
_TOGETHER, _PLAY = 1.5, 2.0  # of what the best moves, and of the dead band beside play [1]
_LEAST_STEP = 1e-6  # of a speed that differs by nothing [1/s]
_FEW_VALUES = 0.25  # distinct values a sample, below which a position is quantised [1], assumed
_PART, _FALLING = "part_of_a_sample", "delay_falling"

MOVED = (
    "rate_rising",
    "rate_falling",
    "slew_rising",
    "slew_falling",
    "dead_band",
    "response_rising",
    "response_falling",
)
"""What other structures may move."""


class Term(NamedTuple):
    """A term: name, place among the parameters, where its search begins and ends.

    A lag in sampling times, the rest [1].
    """

    name: str
    at: int
    starts: tuple[float, ...]
    lower: float
    upper: float


_TERMS = (
    Term("velocity_lag", LAG, (0.5, 1.0, 2.0, 4.0), 0.0, 40.0),
    Term("stiction", law.STICTION, (0.004, 0.02), 0.0, 0.2),
    Term("backlash", law.BACKLASH, (0.004, 0.02), 0.0, 0.2),
    Term("rest_level", law.REST_LEVEL, (0.0,), -0.3, 0.3),
    Term("static_gain", law.STATIC_GAIN, (1.0,), 0.5, 2.0),
)
_STEPS = np.array(
    [1e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-2, 2e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1.0]
)  # of the derivatives: of the value the first four, of the period that of the lag, else [1]


class Rival(NamedTuple):
    """A fit with more terms: all parameters (12,), delays [samples], cost [1], its terms."""

    parameters: FloatArray
    delays: tuple[float, float]
    cost: float
    terms: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Rivals:
    """What they say.

    Attributes
    ----------
    moved : (7,) array
        How far the structure may have moved `MOVED` [unit of each].
    best : Rival
        The one that follows the cycle best.
    left : float
        Root mean square of what it leaves [1].
    quantum : float
        Step of the position's quantisation, 0 = none shows [1].
    """

    moved: FloatArray
    best: Rival
    left: float
    quantum: float


@njit(cache=True)
def _run(
    p: FloatArray,
    delays: tuple[float, float],
    first: int,
    command: FloatArray,
    period: float,
    stops: FloatArray,
    pad: int,
    out: FloatArray,
) -> None:
    """Run free from out[first]; `command` begins with `pad` samples of before the record."""
    z, m = np.zeros(MOTION_SIZE), np.zeros(N_TRANSITION)
    whole = p[LAG] <= 0.0 and delays[0] == ceil(delays[0]) and delays[1] == ceil(delays[1])
    parts = 1 if whole else _PARTS  # without a lag the solution is closed over a sample
    h = period / parts
    transition(p, h, m)
    rest_at(z, out[first])
    for n in range(first + 1, len(out)):
        for j in range(parts):
            inside = (j + 0.5) / parts
            rising, falling = ceil(delays[0] - inside), ceil(delays[1] - inside)
            u = delayed(command, n + pad, rising, falling)
            move(z, target_of(u, p), p, h, 1, m, stops[0], stops[1])
        out[n] = z[MOTION_SIZE - 1]


@njit(cache=True)
def _equations(
    p: FloatArray,
    free: IntArray,
    steps: FloatArray,
    delays: tuple[float, float],
    data: tuple[int, FloatArray, float, FloatArray, int],
    measured: tuple[FloatArray, BoolArray],
    outcome: tuple[FloatArray, FloatArray],
) -> float:
    """Overwrite J^T r (F,) and J^T J (F, F) of r = measured - simulated; return the cost."""
    first, command, period, stops, pad = data
    position, used = measured
    gradient, hessian = outcome
    simulated, moved = position.copy(), position.copy()
    _run(p, delays, first, command, period, stops, pad, simulated)
    columns = np.zeros((len(free), len(position)))
    q = p.copy()
    for i, k in enumerate(free):
        q[k] = p[k] + steps[i]
        _run(q, delays, first, command, period, stops, pad, moved)
        q[k] = p[k]
        columns[i] = (moved - simulated) / steps[i]
    gradient[:] = 0.0
    hessian[:] = 0.0
    cost = 0.0
    for n in range(first + 1, len(position)):
        if used[n]:
            r = position[n] - simulated[n]
            cost += r * r
            for i in range(len(free)):
                gradient[i] += columns[i, n] * r
                for j in range(i + 1):
                    hessian[i, j] += columns[i, n] * columns[j, n]
    for i in range(len(free)):
        for j in range(i):
            hessian[j, i] = hessian[i, j]
    return cost


class _Search:
    """Fits of one record around the plain solution."""

    def __init__(self, record: Record, solution: Solution, limits: Limits, max_lag: int) -> None:
        self._record, self._max_lag = record, max_lag
        pad = 2 * max_lag + 8
        command = np.concatenate((np.full(pad, record.command[0]), record.command))
        self._data = (solution.lag, command, record.period_s, record.stops, pad)
        self._lower, self._upper = np.zeros(law.N_EXTENDED), np.ones(law.N_EXTENDED)
        self._lower[:N_PARAMETERS], self._upper[:N_PARAMETERS] = limits
        for term in _TERMS:
            scale = record.period_s if term.at == LAG else 1.0
            self._lower[term.at] = term.lower * scale
            self._upper[term.at] = term.upper * scale
        p = np.zeros(law.N_EXTENDED)
        p[:N_PARAMETERS] = solution.parameters
        for way, speed in zip((2, 3), shown_speeds(record), strict=True):
            if solution.active[way] <= 0.0 < speed:  # a limit that another structure may reach
                p[way] = np.clip(speed, limits[0][way], limits[1][way])
        p[law.STATIC_GAIN], p[law.CURVED] = 1.0, 1.0
        self._free = np.flatnonzero(solution.active + np.array([0, 0, 1, 1, 1]) > 0.0)
        self.samples = max(int(np.count_nonzero(record.used[solution.lag + 1 :])), 1)
        lag = float(solution.lag)
        self.plain = self.fit(p, (lag, lag), ())

    def polished(self, rival: Rival) -> Rival:
        """Return a rival searched to the end."""
        return self.fit(rival.parameters, rival.delays, rival.terms, _ITERATIONS)

    def with_term(self, rival: Rival, term: Term) -> Rival:
        """Return the best fit with one more term, the rival where no delay leaves room for it."""
        found, terms = [], (*rival.terms, term.name)
        for start in term.starts:
            p, delays = rival.parameters.copy(), rival.delays
            p[term.at] = start
            if term.at == LAG:  # what it takes, the delay had
                p[LAG] *= self._record.period_s
                delays = delays[0] - floor(start), delays[1] - floor(start)
            if min(delays) >= 0.0:
                found.append(self.fit(p, delays, terms))
        return min(found, key=lambda r: r.cost, default=rival)

    def with_delays(self, rival: Rival, name: str) -> Rival:
        """Return the best fit with other delays: a part of a sample, or of the falling command.

        The rival where none is possible: none and the longest leave no room for both.
        """
        alone, longest = name == _FALLING, self._max_lag if name == _FALLING else 1
        rise, fall = rival.delays
        parts = (k / _PARTS for k in range(1 - _PARTS, _PARTS))
        tried = []
        for off in sorted({*parts, *range(-longest, longest + 1)} - {0.0}):
            delays = (rise, fall + off) if alone else (rise + off, fall + off)
            if self._possible(delays):
                tried.append((self._cost(rival.parameters, delays), delays))
        if not tried:
            return rival
        best = self.fit(rival.parameters, min(tried)[1], (*rival.terms, name))
        step = 0.5
        while step >= 1.0 / _PARTS:
            way = 0.0 if alone else step
            near = [(best.delays[0] + k * way, best.delays[1] + k * step) for k in (-1, 1)]
            sides = [self.fit(best.parameters, d, best.terms) for d in near if self._possible(d)]
            better = min(sides, key=lambda r: r.cost, default=best)
            if better.cost < best.cost:
                best = better
            else:
                step /= 2.0
        return best

    def fit(
        self,
        start: FloatArray,
        delays: tuple[float, float],
        terms: tuple[str, ...],
        iterations: int = _SCREENING,
    ) -> Rival:
        """Return a fit of the plain law's parameters and of those terms."""
        extra = [t.at for t in _TERMS if t.name in terms]
        free = np.array([*self._free, *extra], dtype=np.int64)
        p = start.copy()

        def equations(q: FloatArray) -> tuple[float, FloatArray, FloatArray]:
            p[free] = q
            return self._equations(p, free, delays)

        bounds = self._lower[free], self._upper[free]
        found = minimise(equations, start[free], bounds, iterations=iterations)
        p[free] = found.parameters
        return Rival(p, delays, found.cost, terms)

    def _possible(self, delays: tuple[float, float]) -> bool:
        return min(delays) >= 0.0 and max(delays) <= self._max_lag + 1

    def _cost(self, p: FloatArray, delays: tuple[float, float]) -> float:
        return self._equations(p, np.zeros(0, dtype=np.int64), delays)[0]

    def _equations(
        self, p: FloatArray, free: IntArray, delays: tuple[float, float]
    ) -> tuple[float, FloatArray, FloatArray]:
        scale = np.ones(law.N_EXTENDED)
        scale[:4] = np.maximum(np.abs(p[:4]), _LEAST_STEP)
        scale[LAG] = self._record.period_s
        gradient, hessian = np.empty(len(free)), np.empty((len(free), len(free)))
        record, steps = self._record, (_STEPS * scale)[free]
        outcome = gradient, hessian
        measured = record.position, record.used
        cost = _equations(p, free, steps, delays, self._data, measured, outcome)
        return float(cost), gradient, hessian


def rivals_of(record: Record, solution: Solution, limits: Limits, max_lag: int) -> Rivals:
    """Return what other structures make of a cycle.

    Parameters
    ----------
    record : Record
        N samples.
    solution : Solution
        The fit of the plain law.
    limits : tuple of (5,) arrays
        The bounds it obeyed.
    max_lag : int
        Longest delay tried, at least 1 [samples].
    """
    every = max(1, len(record.position) // _MOST_SAMPLES)
    if every > 1:
        record, max_lag = thin(record, every), -(-max_lag // every)
        solution = replace(solution, lag=min(round(solution.lag / every), max_lag))
    search = _Search(record, solution, limits, max_lag)
    plain = best = search.plain
    alone = np.zeros(len(MOVED))
    delays = (_FALLING,) if every > 1 else (_PART, _FALLING)
    for _ in range(_MOST_TERMS):
        found = [search.with_term(best, t) for t in _TERMS if t.name not in best.terms]
        found += [search.with_delays(best, name) for name in delays if name not in best.terms]
        if best is plain:
            for rival in found:
                if rival.cost < plain.cost:
                    alone = np.maximum(alone, _moved(rival, plain, record.period_s))
        better = search.polished(min(found, key=lambda r: r.cost))
        if better.cost >= best.cost * (1.0 - _GAIN / search.samples):
            break
        best = better
    together = _TOGETHER * _moved(best, plain, record.period_s)
    if "backlash" in best.terms:  # the two share what neither shows alone
        together[4] *= _PLAY / _TOGETHER
    quantum = _quantum(record)
    moved = np.maximum(alone, together)
    left = float(np.sqrt(best.cost / search.samples))
    return Rivals(moved, best, left, quantum)


def _moved(rival: Rival, plain: Rival, period_s: float) -> FloatArray:
    """Return how far a rival moves `MOVED` (7,), the responses with their delays."""
    p, q = rival.parameters, plain.parameters
    with np.errstate(divide="ignore", invalid="ignore"):  # no motion, no response
        response = period_s * np.array(rival.delays) + 1.0 / p[:2]
        response -= period_s * np.array(plain.delays) + 1.0 / q[:2]
    moved = np.abs(np.concatenate((p[:N_PARAMETERS] - q[:N_PARAMETERS], response)))
    return np.where(np.isnan(moved), 0.0, moved)


def _quantum(record: Record) -> float:
    """Return the step of a position with few values, 0 if it has many [1]."""
    values = np.unique(record.position[record.used])
    few = 1 < len(values) < _FEW_VALUES * np.count_nonzero(record.used)
    return float(np.diff(values).min()) if few else 0.0
