# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the positioner: prediction, and normal equations of the free run.

The positioner moves towards its delayed command, faster the farther it is away, up to a slew
limit, each direction with its own rate and limit, and not at all inside the dead band::

    e     = u(t - delay) - x
    dx/dt = min(rate_rising (e - dead_band), slew_rising)       e >  dead_band
          = max(rate_falling (e + dead_band), -slew_falling)    e < -dead_band
          = 0                                                   else

The command is held over a sampling period, so the equation has a closed solution over it, and
`motion` is that solution: the parameters are those of continuous time and do not depend on how
often the position is sampled. The delay is a whole number of samples. The structure is
assumed; on the boiler valve a symmetric linear model fits 51, this one about 70 on data it
was not trained on.
"""

from __future__ import annotations

from math import exp
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Validity
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.loops import push, pushed
from valve_twin.core.valves.kit.prediction import predictor
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

N_PARAMETERS = 5
"""rate_rising, rate_falling, slew_rising, slew_falling [1/s], dead_band [1]."""

MAX_LAG = 1024
"""Longest delay the prediction can hold [samples]."""

_DEAD_BAND = 4

RUNS = 4
"""Most numbers of a run: those of the extended law; the plain one has the position only [1]."""

MEMORY = 1 + MAX_LAG + 1
"""The commands so far [1], see `kit.loops.push`."""

_PERIOD, _LAG, _LOWER_STOP, _UPPER_STOP = range(N_PARAMETERS, 9)


@njit(cache=True)
def motion(
    q: float, rate: float, slew: float, duration: float
) -> tuple[float, float, float, float, float]:
    """Return how far the spool moves, the derivatives of that, and the time at full speed.

    Solves dq/dt = -min(rate q, slew) for the way covered: at full speed, then ever slower.

    Parameters
    ----------
    q : float
        Distance to the command beyond the dead band, at the start, 0 or more [1].
    rate, slew : float
        Speed per distance and greatest speed [1/s].
    duration : float
        How long the command is held [s].

    Returns
    -------
    tuple of float
        Way [1], its derivatives with respect to q [1], rate [s] and slew [s], full speed [s].
    """
    if rate * q <= slew:
        left = exp(-rate * duration)
        return q * (1.0 - left), 1.0 - left, q * duration * left, 0.0, 0.0
    if rate * q >= slew * (1.0 + rate * duration):
        return slew * duration, 0.0, 0.0, duration, duration
    full_speed = q / slew - 1.0 / rate
    left = exp(-rate * (duration - full_speed))
    near = slew / rate * left
    by_rate = near * (duration - full_speed)
    return q - near, 1.0 - left, by_rate, left * full_speed, full_speed


@njit(cache=True)
def advance(x: float, command: float, p: FloatArray, duration: float) -> float:
    """Return the position after a time under a held command [1].

    Parameters
    ----------
    x, command : float
        Position at the beginning and command [1].
    p : (5,) or longer array
        Parameters, see `N_PARAMETERS`.
    duration : float
        How long the command is held [s].
    """
    e = command - x
    if e > p[4]:
        return float(x + motion(e - p[4], p[0], p[2], duration)[0])
    if e < -p[4]:
        return float(x - motion(-e - p[4], p[1], p[3], duration)[0])
    return float(x)


@per_sample
def _step(x: float, command: float, c: FloatArray) -> float:
    return float(min(max(advance(x, command, c, c[_PERIOD]), c[_LOWER_STOP]), c[_UPPER_STOP]))


@per_sample
def _advance(
    m: FloatArray, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    push(memory, inputs, n, bad)
    lag = int(m[_LAG])
    ready = seen > lag
    if ready:
        command = memory[pushed(memory, 1, lag)]
        followed[0], free[0] = _step(followed[0], command, m), _step(free[0], command, m)
    return Validity.VALID if ready else Validity.STARTING


@per_sample
def _follow(
    m: FloatArray, followed: FloatArray, memory: FloatArray, position: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    followed[0] = position
    return code


predict_block = predictor(_advance, _follow, run=1)
"""Prediction of the plain law; 9 coefficients: the 5 parameters, period [s], lag [samples], lower
and upper stop [1]."""


@njit(cache=True)
def top_speed(position: FloatArray, way: float, period: float) -> float:
    """Return the greatest mean speed [1/s] at which the position rose by `way`, 0 if never.

    Parameters
    ----------
    position : (N,) array
        Measured position [1]; pass it with its sign changed for the other direction.
    way : float
        Distance to cover, well above the noise [1].
    period : float
        Sampling time [s].
    """
    best = 0.0
    start = 0
    for n in range(1, len(position)):
        if position[n] <= position[start]:
            start = n
        while position[n] - position[start] >= way:
            best = max(best, (position[n] - position[start]) / ((n - start) * period))
            start += 1
    return best


@njit(cache=True)
def _move(
    x: float, command: float, p: FloatArray, period: float, d: FloatArray, active: FloatArray
) -> tuple[float, float]:
    """Return the new position and its derivative to the old one; fill `d` (5,), count `active`."""
    d[:] = 0.0
    e = command - x
    if -p[_DEAD_BAND] <= e <= p[_DEAD_BAND]:
        active[_DEAD_BAND] += 1.0
        return x, 1.0
    sign, rate, slew = (1.0, 0, 2) if e > 0.0 else (-1.0, 1, 3)
    q = sign * e - p[_DEAD_BAND]
    way, by_q, by_rate, by_slew, full_speed = motion(q, p[rate], p[slew], period)
    d[rate] = sign * by_rate
    d[slew] = sign * by_slew
    d[_DEAD_BAND] = -sign * by_q
    active[rate] += 1.0 - full_speed / period
    active[slew] += full_speed / period
    return x + sign * way, 1.0 - by_q


@njit(cache=True)
def normal_equations(
    p: FloatArray,
    position: FloatArray,
    command: FloatArray,
    used: BoolArray,
    period: float,
    lag: int,
    stops: FloatArray,
    gradient: FloatArray,
    hessian: FloatArray,
    active: FloatArray,
) -> float:
    """Run the model free from the first measured sample and accumulate the Gauss-Newton equations.

    Parameters
    ----------
    p : (5,) array
        Parameters, see `N_PARAMETERS`.
    position, command : (N,) arrays
        Measured position and command [1].
    used : (N,) bool array
        Samples that carry weight.
    period, lag, stops : float, int, (2,) array
        Sampling time [s], delay [samples], mechanical stops [1].
    gradient, hessian : (5,), (5, 5) arrays
        Overwritten with J^T r and J^T J of r = measured - simulated [1 over units of `p`].
    active : (5,) array
        Overwritten with how long each parameter drove the spool [samples].

    Returns
    -------
    float
        Sum of squared residuals [1].
    """
    gradient[:] = 0.0
    hessian[:] = 0.0
    active[:] = 0.0
    s = np.zeros(N_PARAMETERS)
    d = np.zeros(N_PARAMETERS)
    x = position[lag]
    cost = 0.0
    for n in range(lag + 1, len(position)):
        x, kept = _move(x, command[n - lag], p, period, d, active)
        for j in range(N_PARAMETERS):
            s[j] = d[j] + kept * s[j]
        if x < stops[0] or x > stops[1]:
            x = min(max(x, stops[0]), stops[1])
            s[:] = 0.0
        if used[n]:
            r = position[n] - x
            cost += r * r
            for j in range(N_PARAMETERS):
                gradient[j] += s[j] * r
                for k in range(j + 1):
                    hessian[j, k] += s[j] * s[k]
    for j in range(N_PARAMETERS):
        for k in range(j):
            hessian[k, j] = hessian[j, k]
    return cost
