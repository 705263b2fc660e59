# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the Hammerstein-Wiener model: free run and one-step prediction.

A command acts through four blocks, each of which may be missing::

    v[n] = curve_in(u[n - lag])                                    piecewise linear
    q[n] = b1 v[n] + .. + b3 v[n-2] - a1 q[n-1] - .. - a3 q[n-3]    linear, gain 1
    x[n] = x[n-1] + rate (q[n] - x[n-1]), at most +-limit           each way its own
    y[n] = curve_out(x[n])                                         piecewise linear, rising

Without rates (0) x = q. The curves have knots at equal distances and go on straight beyond them.

The loop of the prediction is its own, not `kit.prediction`: there a free run begins as a copy of
the run that follows the output; here as that moved to the output, which the run itself is not.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import Restart, Validity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

ORDER = 3
"""Highest order of the linear block."""

KNOTS = 8
"""Most knots of a curve."""

MAX_LAG = 128
"""Longest command to output lag [samples]."""

LAG, MEMORY, A, B = 0, 1, 2, 2 + ORDER
RISE, FALL, RISE_LIMIT, FALL_LIMIT = (B + ORDER + i for i in range(4))
INPUT = B + ORDER + 4
OUTPUT = INPUT + 3 + KNOTS
SIZE = OUTPUT + 3 + KNOTS
"""Coefficients: lag, memory of the residual, a, b, rates, limits, two curves of `curve`."""

_LARGEST = 1e9  # a run stays a number
_Q, _V, _X = 0, ORDER, 2 * ORDER
RUN = 2 * ORDER + 1
"""State of a run: the last q, the last v, x."""

_SEEN, _HEAD, _LEFT, _FREE = 0, 1, 2, 3
_LINE = _FREE + 2 * RUN
STATE_SIZE = _LINE + MAX_LAG + 1
"""Counters, last residual, two runs, the commands so far."""


@njit(cache=True)
def curve(value: float, c: FloatArray) -> float:
    """Return a piecewise linear curve at a value.

    Parameters
    ----------
    value : float
        Where [unit of the knots].
    c : (3 + KNOTS,) array
        Number of knots, the first and the last of them, the levels at them [units of knots and
        levels]; 0 knots = identity.
    """
    count = int(c[0])
    if count == 0:
        return float(value)
    step = (c[2] - c[1]) / (count - 1)
    place = (value - c[1]) / step
    i = min(max(int(np.floor(place)), 0), count - 2)
    low, high = c[3 + i], c[4 + i]
    return float(low + (place - i) * (high - low))


@njit(cache=True)
def inverse(level: float, c: FloatArray) -> float:
    """Return where a rising `curve` has a level.

    Parameters
    ----------
    level : float
        The level [unit of the levels].
    c : (3 + KNOTS,) array
        As in `curve` [units of knots and levels].
    """
    count = int(c[0])
    if count == 0:
        return float(level)
    i = 0
    while i < count - 2 and level > c[4 + i]:
        i += 1
    step = (c[2] - c[1]) / (count - 1)
    return float(c[1] + step * (i + (level - c[3 + i]) / (c[4 + i] - c[3 + i])))


@njit(cache=True)
def advance(run: FloatArray, u: float, c: FloatArray) -> float:
    """Advance a run by one sample; return the output.

    Parameters
    ----------
    run : (RUN,) array
        Its state, written in place [unit of the output].
    u : float
        Command [unit of the signal].
    c : (SIZE,) array
        Coefficients [units of the signals].
    """
    for i in range(ORDER - 1, 0, -1):
        run[_V + i] = run[_V + i - 1]
    run[_V] = curve(u, c[INPUT:OUTPUT])
    q = 0.0
    for i in range(ORDER):
        q += c[B + i] * run[_V + i] - c[A + i] * run[_Q + i]
    q = min(max(q, -_LARGEST), _LARGEST)
    for i in range(ORDER - 1, 0, -1):
        run[_Q + i] = run[_Q + i - 1]
    run[_Q] = q
    if c[RISE] == 0.0:
        run[_X] = q
    else:
        away = q - run[_X]
        if away > 0.0:
            run[_X] += min(c[RISE] * away, c[RISE_LIMIT])
        else:
            run[_X] += max(c[FALL] * away, -c[FALL_LIMIT])
    return curve(run[_X], c[OUTPUT:SIZE])


@njit(cache=True)
def settle(run: FloatArray, u: float, output: float, c: FloatArray) -> None:
    """Begin a run at rest under a command, moved so that its output is the given one.

    Parameters
    ----------
    run : (RUN,) array
        Its state, overwritten [unit of the output].
    u : float
        Command [unit of the signal].
    output : float
        The output [unit of the signal].
    c : (SIZE,) array
        Coefficients [units of the signals].
    """
    run[_V : _V + ORDER] = curve(u, c[INPUT:OUTPUT])
    run[_Q : _Q + ORDER] = run[_V]
    run[_X] = run[_V]
    _move(run, output, c)


@njit(cache=True)
def _move(run: FloatArray, output: float, c: FloatArray) -> None:
    """Move a run (RUN,) so that its output is the given one."""
    moved = inverse(output, c[OUTPUT:SIZE]) - run[_X]
    run[_X] += moved
    if c[RISE] == 0.0:
        run[_Q : _Q + ORDER] += moved


@njit(cache=True)
def free_run(c: FloatArray, u: FloatArray, first: float, out: FloatArray) -> None:
    """Run the model over a record that begins at rest.

    As `advance` sample by sample, to the same bits, with the state in registers.

    Parameters
    ----------
    c : (SIZE,) array
        Coefficients [units of the signals].
    u : (N,) array
        Command [unit of the signal].
    first : float
        Output at the first sample [unit of the signal].
    out : (N,) array
        Overwritten with the output [unit of the signal].
    """
    run, lag = np.empty(RUN), int(c[LAG])
    settle(run, u[0], first, c)
    v1, v2, q1, q2, q3, x = run[_V], run[_V + 1], run[_Q], run[_Q + 1], run[_Q + 2], run[_X]
    b0, b1, b2 = c[B], c[B + 1], c[B + 2]
    a1, a2, a3 = c[A], c[A + 1], c[A + 2]
    rise, fall, rise_limit, fall_limit = c[RISE], c[FALL], c[RISE_LIMIT], c[FALL_LIMIT]
    into, onto = c[INPUT:OUTPUT], c[OUTPUT:SIZE]
    out[0] = first
    command, v0 = nan, nan
    for n in range(1, len(u)):
        asked = u[max(n - lag, 0)]
        if asked != command:  # most commands rest
            command, v0 = asked, curve(asked, into)
        q = (b0 * v0 - a1 * q1) + (b1 * v1 - a2 * q2)
        q += b2 * v2 - a3 * q3
        q = min(max(q, -_LARGEST), _LARGEST)
        v2, v1, q3, q2, q1 = v1, v0, q2, q1, q
        away = q - x
        if rise == 0.0:
            x = q
        elif away > 0.0:
            x += min(rise * away, rise_limit)
        else:
            x += max(fall * away, -fall_limit)
        out[n] = curve(x, onto)


@njit(cache=True)
def predict_block(
    state: FloatArray,
    c: FloatArray,
    measured: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place; see `ValveModel.predict`.

    One step ahead it is a run from the commands alone plus the share of its last error that
    stays, `memory`; a cycle's free run begins where that stood, moved to the measured output.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        Written in place [units of the signals].
    c : (SIZE,) array
        Coefficients [units of the signals].
    measured : (N,) array
        Output [unit of the signal].
    inputs : (N, 1) array
        Command [unit of the signal].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run, NaN before the command of `lag` samples ago is known.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    free, run = state[_FREE : _FREE + RUN], state[_FREE + RUN : _LINE]
    line, lag = state[_LINE:], int(c[LAG])
    needed = max(lag, 1)
    for n in range(len(measured)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        head = int(state[_HEAD])
        line[head] = line[head - 1] if flag == Restart.BAD else inputs[n, 0]
        state[_HEAD] = (head + 1) % (MAX_LAG + 1)
        u = line[(head - lag) % (MAX_LAG + 1)]
        ready = state[_SEEN] >= needed
        out, simulated[n] = nan, nan
        if ready:
            simulated[n] = advance(free, u, c)
            out = advance(run, u, c)
            state[_LEFT] *= c[MEMORY]
        predicted[n] = out + state[_LEFT] if ready else nan
        validity[n] = Validity.VALID if ready else Validity.STARTING
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        elif not ready:
            settle(run, u, measured[n], c)
            free[:] = run
            state[_LEFT] = 0.0
        else:
            state[_LEFT] = measured[n] - out
            if flag == Restart.NEW_CYCLE:
                free[:] = run
                _move(free, measured[n], c)
                simulated[n] = measured[n]
        if flag != Restart.BAD or state[_SEEN] > 0.0:
            state[_SEEN] += 1.0
