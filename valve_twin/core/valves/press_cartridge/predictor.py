# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled one-step prediction and free run of the press cartridge valve.

Both follow paper 002, eq. (19), with a delay of L samples (between samples
the command is interpolated) and a leak that acts off the lower seat only:

    d[n] = (1 + theta_1 + theta_7 v_in + theta_8 v_out) d[n-1] + theta_2 v_in + theta_3 v_out
           + theta_4 v_in^2 + theta_5 v_out^2 + theta_6 v_in v_out - leak,        v at n - L
    x[n] = clip(x[n-1] + d[n], lower seat, upper seat),        then d[n] = x[n] - x[n-1]

The kernel carries everything it knows in its state, so a stream gives the same bits however it is
cut into blocks. Its loop is its own, not `kit.prediction`: there a free run begins as a copy of
the run that follows the output; here it begins at rest at the output, while that one moves on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import ByteArray, FloatArray, Restart, Validity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_LAG = 8
"""Longest lag between command and position that the delay line holds [samples]."""

COEFFICIENTS = 16
"""theta 1 to 8, leak, delay, lower and upper seat, seat margin, offsets in, out, dead command."""

LEAK, LAG, LOW_SEAT, HIGH_SEAT, MARGIN, OFFSET_IN, OFFSET_OUT, DEAD_COMMAND = range(8, 16)

GAINS = {
    "pole": 0.0,
    "K_in": np.nan,
    "K_in_slope": 0.0,
    "v_in_mean": 0.0,
    "K_out": np.nan,
    "K_out_slope": 0.0,
    "leak": 0.0,
}
"""Parameters of the output error by name, with what stands for one that is not known."""

STATE = 6 + 2 * MAX_LAG
"""x[n-1], x[n-2], samples since a gap, free-run x, free-run d, free run on, past commands."""

_LAST, _BEFORE, _KNOWN, _FREE, _FREE_STEP, _RUNNING, _PAST_IN = range(7)
_PAST_OUT = _PAST_IN + MAX_LAG  # the delay lines, newest first


@njit(cache=True, inline="always")  # a call counts references to its arrays
def increment(c: FloatArray, v_in: float, v_out: float, dx: float, off_seat: bool) -> float:
    """Return d[n], the increment of the position [1].

    Parameters
    ----------
    c : (16,) array
        See `COEFFICIENTS`.
    v_in, v_out, dx : float
        Lagged commands and last increment [1].
    off_seat : bool
        Whether the leak acts.
    """
    d: float = (1.0 + c[0] + c[6] * v_in + c[7] * v_out) * dx
    d += (c[1] + c[3] * v_in) * v_in + (c[2] + c[4] * v_out) * v_out + c[5] * v_in * v_out
    if off_seat:
        d -= c[LEAK]
    return d


@njit(cache=True, inline="always")
def step(c: FloatArray, v_in: float, v_out: float, x: float, dx: float) -> float:
    """Return the next position: one increment from x, clipped to the seats [1].

    Parameters
    ----------
    c : (16,) array
        See `COEFFICIENTS`.
    v_in, v_out, x, dx : float
        Lagged commands, position and last increment [1].
    """
    low, high = c[LOW_SEAT], c[HIGH_SEAT]
    ahead: float = min(max(x + increment(c, v_in, v_out, dx, x > low), low), high)
    return ahead


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
    """Predict N consecutive samples; the state and the three results are written in place.

    Parameters
    ----------
    state : (22,) array
        See `STATE`.
    c : (16,) array
        See `COEFFICIENTS`.
    position : (N,) array
        Measured position [1].
    inputs : (N, 2) array
        v_in, v_out [1].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [1].
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    lag = int(c[LAG])
    part = c[LAG] - lag
    low, high, tolerance = c[LOW_SEAT], c[HIGH_SEAT], c[MARGIN]
    for n in range(len(position)):
        if restart[n] == Restart.GAP:
            state[_KNOWN] = 0.0
            state[_RUNNING] = 0.0
        v_in = max(inputs[n, 0] - c[OFFSET_IN], 0.0)
        v_out = max(inputs[n, 1] - c[OFFSET_OUT], 0.0)
        known = state[_KNOWN]
        # commands up to sample n - 1
        acting_in = v_in if lag == 0 else state[_PAST_IN + lag - 1]
        acting_out = v_out if lag == 0 else state[_PAST_OUT + lag - 1]
        if part > 0.0:
            acting_in = (1.0 - part) * acting_in + part * state[_PAST_IN + lag]
            acting_out = (1.0 - part) * acting_out + part * state[_PAST_OUT + lag]
        ready = known >= max(2, np.ceil(c[LAG]))
        x1, x2 = state[_LAST], state[_BEFORE]
        hat = step(c, acting_in, acting_out, x1, x1 - x2) if ready else np.nan
        predicted[n] = hat
        bad = restart[n] == Restart.BAD or not np.isfinite(position[n])
        x = position[n]
        if bad:
            x = hat if ready else x1

        if not bad and (restart[n] == Restart.NEW_CYCLE or state[_RUNNING] == 0.0):
            state[_FREE] = x
            state[_FREE_STEP] = 0.0
            state[_RUNNING] = 1.0
        elif state[_RUNNING] == 1.0:
            ahead = step(c, acting_in, acting_out, state[_FREE], state[_FREE_STEP])
            state[_FREE_STEP] = ahead - state[_FREE]
            state[_FREE] = ahead
        simulated[n] = state[_FREE] if state[_RUNNING] == 1.0 else np.nan

        moving = acting_in > c[DEAD_COMMAND] or acting_out > c[DEAD_COMMAND]
        if bad:
            validity[n] = Validity.BAD_INPUT
        elif not ready:
            validity[n] = Validity.STARTING
        elif (x <= low + tolerance and acting_in <= c[DEAD_COMMAND]) or (
            x >= high - tolerance and acting_out <= c[DEAD_COMMAND]
        ):
            validity[n] = Validity.AT_SEAT
        elif moving and x == x1:
            validity[n] = Validity.STALE
        else:
            validity[n] = Validity.VALID

        if known > 0.0 or not bad:
            state[_BEFORE] = x1 if known > 0.0 else x
            state[_LAST] = x
            state[_KNOWN] = min(known + 1.0, 1e6)
        for k in range(MAX_LAG - 1, 0, -1):
            state[_PAST_IN + k] = state[_PAST_IN + k - 1]
            state[_PAST_OUT + k] = state[_PAST_OUT + k - 1]
        state[_PAST_IN] = v_in
        state[_PAST_OUT] = v_out


def set_gains(c: FloatArray, values: Mapping[str, float], period_s: float, v_ref: float) -> None:
    """Write theta_1 ... theta_5 and the leak of the output error's parameters.

    Parameters
    ----------
    c : (16,) array
        See `COEFFICIENTS`; written in place.
    values : mapping
        Parameters by name, in their units.
    period_s : float
        Sampling time [s].
    v_ref : float
        Outflow command at which K_out is published [1].
    """
    p = np.array([values.get(name, unknown) for name, unknown in GAINS.items()])
    write_gains(c, p, v_ref, period_s)


def write_gains(c: FloatArray, p: FloatArray, v_ref: float, period_s: float) -> None:
    """Write what `set_gains` says; `law` compiles it.

    Parameters
    ----------
    c : (16,) array
        See `COEFFICIENTS`; written in place.
    p : (7,) or longer array
        Parameters in the order of `GAINS`, in their units.
    v_ref : float
        Outflow command at which K_out is published [1].
    period_s : float
        Sampling time [s].
    """
    share = 1.0 - p[0]
    c[0] = -share
    c[1] = share * (p[1] - p[2] * p[3])
    c[2] = -share * (p[4] - p[5] * v_ref)
    c[3] = share * p[2]
    c[4] = -share * p[5]
    c[LEAK] = share * p[6] * period_s
