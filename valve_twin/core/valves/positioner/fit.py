# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Output-error fit of the positioner: bounded least squares, several starts, delay by scan.

The cost has local minima (a fast valve that is slew-limited looks like a slow one that is not), so
every fit starts from several places; the delay is an integer number of samples and is found by a
scan from coarse to fine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.estimation.solvers.least_squares import minimise
from valve_twin.core.valves.positioner.kernels import N_PARAMETERS, normal_equations, top_speed

if TYPE_CHECKING:
    from valve_twin.core.estimation.solvers.least_squares import Limits
    from valve_twin.core.types import BoolArray, FloatArray

FASTEST_RATE = 5.0
"""Greatest rate times period [1]: less than 1 % of the distance is left after one sample."""

_SHOWN_WAY = 0.2  # share of the motion over which a speed is measured: well above noise, assumed
_SEARCH_SAMPLES = 1000  # a record twice as long is searched on every second sample, and so on
_MAX_ITERATIONS = 60


@dataclass(frozen=True, slots=True)
class Record:
    """What is fitted: position, command (N,) [1], weights (N,), period [s], stops (2,) [1]."""

    position: FloatArray
    command: FloatArray
    used: BoolArray
    period_s: float
    stops: FloatArray


@dataclass(frozen=True, slots=True)
class Solution:
    """Parameters (5,), delay [samples], cost, Gauss-Newton matrix (5, 5), driven samples (5,)."""

    parameters: FloatArray
    lag: int
    cost: float
    hessian: FloatArray
    active: FloatArray


class _Found(NamedTuple):
    parameters: FloatArray
    lag: int
    cost: float


def shown_speeds(record: Record) -> tuple[float, float]:
    """Return the greatest rising and falling speed over a fifth of the record's motion [1/s].

    Parameters
    ----------
    record : Record
        With at least one used sample.
    """
    way = _SHOWN_WAY * float(np.ptp(record.position[record.used]))
    if way <= 0.0:
        return 0.0, 0.0
    rising = top_speed(record.position, way, record.period_s)
    return float(rising), float(top_speed(-record.position, way, record.period_s))


def bounds(period_s: float, *, min_slew: float, max_dead_band: float) -> Limits:
    """Return the bounds (5,) each: nothing negative, nothing faster than the sampling shows.

    Parameters
    ----------
    period_s : float
        Sampling time [s].
    min_slew : float
        Lower bound of the slew limits [1/s].
    max_dead_band : float
        Upper bound of the dead band [1].
    """
    rate, slew = FASTEST_RATE / period_s, 1.0 / period_s
    least = min(min_slew, slew)
    lower = np.array([0.0, 0.0, least, least, 0.0])
    return lower, np.array([rate, rate, slew, slew, max_dead_band])


def fit_free_run(record: Record, *, max_lag: int, limits: Limits) -> Solution:
    """Find parameters and delay that make the free run follow the measured position.

    A long record is searched on every k-th sample first: the parameters are those of continuous
    time, so what is found there starts the fit of all samples.

    Parameters
    ----------
    record : Record
        At least `max_lag` + 8 samples.
    max_lag : int
        Longest delay tried [samples].
    limits : tuple of (5,) arrays
        Lower and upper bounds, see `bounds`.

    Returns
    -------
    Solution
        The best of all starts and delays.
    """
    every = max(1, len(record.position) // _SEARCH_SAMPLES)
    best = _search(thin(record, every), -(-max_lag // every), limits)
    if every > 1:
        best = _refine(record, best, every, max_lag, limits)
    cost, _, hessian, active = _evaluate(record, best.parameters, best.lag)
    return Solution(best.parameters, best.lag, cost, hessian, active)


def normal(record: Record, parameters: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """Return J^T r (5,), J^T J (5, 5) of the used samples.

    Parameters
    ----------
    record : Record
        N samples.
    parameters : (5,) array
        See `kernels.N_PARAMETERS`.
    lag : int
        Delay [samples].
    """
    return _evaluate(record, parameters, lag)[1:3]


def _search(record: Record, max_lag: int, limits: Limits) -> _Found:
    """Scan the delay from coarse to fine, each from several starts."""
    starts = starting_values(record, limits)
    best: _Found | None = None
    tried: set[int] = set()
    for lags in _coarse_to_fine(max_lag):
        centre = 0 if best is None else best.lag
        for lag in sorted({min(max(centre + k, 0), max_lag) for k in lags} - tried):
            tried.add(lag)
            at = starts if best is None or len(tried) <= 2 else [best.parameters, *starts[:2]]
            for start in at:
                found = _descend(record, start, lag, limits)
                if best is None or found.cost < best.cost:
                    best = found
    assert best is not None  # the first scan always tries lag 0
    for start in starts:
        found = _descend(record, start, best.lag, limits)
        best = found if found.cost < best.cost else best
    return best


def _refine(record: Record, coarse: _Found, every: int, max_lag: int, limits: Limits) -> _Found:
    """Fit all samples, with delays around the one found on every k-th."""
    centre = min(coarse.lag * every, max_lag)
    best = _descend(record, coarse.parameters, centre, limits)
    tried = {centre}
    step = every
    while True:
        lags = {min(max(best.lag + k * step, 0), max_lag) for k in (-1, 1)} - tried
        tried |= lags
        found = [_descend(record, best.parameters, lag, limits) for lag in sorted(lags)]
        better = min(found, key=lambda s: s.cost, default=best)
        if better.cost < best.cost:
            best = better
        elif step == 1:
            return best
        else:
            step = -(-step // 3)


def thin(record: Record, every: int) -> Record:
    """Return every k-th sample of a record."""
    return Record(
        position=np.ascontiguousarray(record.position[::every]),
        command=np.ascontiguousarray(record.command[::every]),
        used=np.ascontiguousarray(record.used[::every]),
        period_s=record.period_s * every,
        stops=record.stops,
    )


def _coarse_to_fine(max_lag: int) -> list[list[int]]:
    """Return scans around the best delay so far: 0..max_lag in at most 12 steps, then finer."""
    step = max(1, -(-max_lag // 12))
    scans = [list(range(0, max_lag + step, step))]
    while step > 1:
        step = max(1, step // 3)
        scans.append([k * step for k in range(-3, 4)])
    return scans


def starting_values(record: Record, limits: Limits) -> list[FloatArray]:
    """Guess rates and slew limits (5,) from the measured speeds: three rates x two slew limits."""
    speed = np.diff(record.position) / record.period_s
    error = record.command[:-1] - record.position[:-1]
    rates, slews = np.empty(2), np.empty(2)
    for j, sign in enumerate((1.0, -1.0)):
        moving = (sign * speed > 0) & (sign * error > 0)
        rates[j] = np.median(speed[moving] / error[moving]) if moving.any() else 1.0
        slews[j] = np.quantile(np.abs(speed[moving]), 0.9) if moving.any() else 1.0
    lower, upper = limits
    out = []
    for rate_scale in (1.0, 3.0, 0.3):
        for slew_scale in (1.0, 4.0):
            guess = np.array([*(rates * rate_scale), *(slews * slew_scale), 0.002])
            out.append(np.clip(guess, lower, upper))
    return out


def _descend(record: Record, start: FloatArray, lag: int, limits: Limits) -> _Found:
    found = minimise(
        lambda p: _evaluate(record, p, lag)[:3], start, limits, iterations=_MAX_ITERATIONS
    )
    return _Found(found.parameters, lag, found.cost)


def _evaluate(
    record: Record, p: FloatArray, lag: int
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    gradient, active = np.empty(N_PARAMETERS), np.empty(N_PARAMETERS)
    hessian = np.empty((N_PARAMETERS, N_PARAMETERS))
    cost = normal_equations(
        p,
        record.position,
        record.command,
        record.used,
        record.period_s,
        lag,
        record.stops,
        gradient,
        hessian,
        active,
    )
    return float(cost), gradient, hessian, active
