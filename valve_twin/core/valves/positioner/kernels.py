# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the positioner: prediction, and normal equations of the free run.

The positioner moves towards its delayed command, faster the farther it is away, up to a slew
limit, each direction with its own rate and limit, and not at all inside the dead band::

    e[n] = u[n - lag] - x[n-1]
    v[n] = min(rate_rising (e - dead_band), slew_rising)       e >  dead_band
         = max(rate_falling (e + dead_band), -slew_falling)    e < -dead_band
         = 0                                                   else
    x[n] = x[n-1] + period v[n]        between the stops

Forward Euler with rate * period <= 1: at the bound the spool arrives within one sample. The
structure is our assumption [A]; on the boiler valve a symmetric linear model fits 51, this one
about 70 on unseen data.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, ByteArray, FloatArray

N_PARAMETERS = 5
"""rate_rising, rate_falling, slew_rising, slew_falling [1/s], dead_band [1]."""

MAX_LAG = 1024
"""Longest delay the prediction can hold [samples]."""

_LAST, _FREE, _SEEN, _HEAD, _LINE = 0, 1, 2, 3, 4
STATE_SIZE = _LINE + MAX_LAG + 1

_STARTING, _BAD_INPUT = 2, 5
_NEW_CYCLE, _GAP, _BAD = 1, 2, 3


@njit(cache=True)
def velocity(e: float, p: FloatArray) -> float:
    """Return the speed [1/s] at distance `e` to the command [1]; `p` as in `N_PARAMETERS`."""
    if e > p[4]:
        return float(min(p[0] * (e - p[4]), p[2]))
    if e < -p[4]:
        return float(max(p[1] * (e + p[4]), -p[3]))
    return 0.0


@njit(cache=True)
def _step(x: float, command: float, c: FloatArray) -> float:
    return float(min(max(x + c[5] * velocity(command - x, c), c[7]), c[8]))


@njit(cache=True)
def predict_block(
    state: FloatArray,
    c: FloatArray,
    position: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples; `c` = 5 parameters, period [s], lag [samples], lower, upper stop [1]."""
    lag = int(c[6])
    for n in range(len(position)):
        flag = restart[n]
        if flag == _GAP:
            state[_SEEN] = 0.0
        head = int(state[_HEAD])
        if flag == _BAD:
            state[_LINE + head] = state[_LINE + (head - 1) % (MAX_LAG + 1)]
        else:
            state[_LINE + head] = inputs[n, 0]
        state[_HEAD] = (head + 1) % (MAX_LAG + 1)
        ready = state[_SEEN] > lag
        command = state[_LINE + (head - lag) % (MAX_LAG + 1)]
        if ready:
            predicted[n] = _step(state[_LAST], command, c)
            state[_FREE] = _step(state[_FREE], command, c)
            validity[n] = 0
        else:
            predicted[n] = np.nan
            validity[n] = _STARTING
        if flag == _BAD:
            validity[n] = _BAD_INPUT
            state[_LAST] = predicted[n] if ready else state[_LAST]
        else:
            state[_LAST] = position[n]
            if not ready or flag == _NEW_CYCLE:
                state[_FREE] = position[n]
        simulated[n] = state[_FREE] if ready else np.nan
        state[_SEEN] += 1.0


@njit(cache=True)
def normal_equations(  # noqa: PLR0912  one pass over the samples, a branch a regime
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
        Overwritten with J^T r and J^T J of r = measured - simulated.
    active : (5,) array
        Overwritten with the number of samples in which each parameter drove the spool.

    Returns
    -------
    float
        Sum of squared residuals [1].
    """
    gradient[:] = 0.0
    hessian[:] = 0.0
    active[:] = 0.0
    s = np.zeros(5)
    d = np.zeros(5)
    x = position[lag]
    cost = 0.0
    for n in range(lag + 1, len(position)):
        e = command[n - lag] - x
        v = 0.0
        slope = 0.0
        d[:] = 0.0
        if e > p[4]:
            v = p[0] * (e - p[4])
            if v > p[2]:
                v = p[2]
                d[2] = 1.0
                active[2] += 1.0
            else:
                slope = -p[0]
                d[0] = e - p[4]
                d[4] = -p[0]
                active[0] += 1.0
        elif e < -p[4]:
            v = p[1] * (e + p[4])
            if v < -p[3]:
                v = -p[3]
                d[3] = -1.0
                active[3] += 1.0
            else:
                slope = -p[1]
                d[1] = e + p[4]
                d[4] = p[1]
                active[1] += 1.0
        else:
            active[4] += 1.0
        x += period * v
        for j in range(5):
            s[j] += period * (d[j] + slope * s[j])
        if x < stops[0] or x > stops[1]:
            x = min(max(x, stops[0]), stops[1])
            s[:] = 0.0
        if used[n]:
            r = position[n] - x
            cost += r * r
            for j in range(5):
                gradient[j] += s[j] * r
                for k in range(j + 1):
                    hessian[j, k] += s[j] * s[k]
    for j in range(5):
        for k in range(j):
            hessian[k, j] = hessian[j, k]
    return cost
