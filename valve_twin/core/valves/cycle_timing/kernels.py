# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of a fixed cycle: no flow, a spike that decays, then the steady flow.

The cycle is its own clock: samples are counted from where it starts. Between the beginning of the
search and the spike's rise nothing flows; what follows decays exponentially to the steady flow::

    q(t) = 0                                           search start <= t < rise
         = steady + (peak - steady) exp(-(t - rise) / decay)    rise <= t < search end
         = steady                                      steady start <= t < steady end

Elsewhere in the cycle nothing is predicted. The structure is assumed.

Its loop is its own, not `kit.prediction`: that one follows a measured output and starts at gaps;
this one needs to be told of a new cycle and measures nothing.
"""

from __future__ import annotations

from math import exp, isnan, nan
from typing import TYPE_CHECKING

from valve_twin.core.types import Restart, Validity
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

STATE_SIZE = 2
"""Samples since the cycle began; 1 where its begin is known."""


@njit(cache=True)
def profile(k: float, c: FloatArray) -> float:
    """Return the flow that sample `k` of a cycle shows, NaN where nothing is predicted.

    Parameters
    ----------
    k : float
        Samples since the cycle began.
    c : (8,) array
        rise [samples], peak, steady [m^3/s], decay, search start and end, steady start and end
        [samples].
    """
    if c[4] <= k <= c[5]:
        since = k - c[0]
        if since <= 0.0:
            return 0.0
        flow = c[2] + (c[1] - c[2]) * exp(-max(since - 1.0, 0.0) / c[3])
        return float(flow * min(since, 1.0))
    if c[6] <= k <= c[7]:
        return float(c[2])
    return nan


@njit(cache=True)
def predict_block(
    state: FloatArray,
    c: FloatArray,
    flow: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place; see `ValveModel.predict`.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    c : (8,) array
        See `profile`.
    flow : (N,) array
        Measured flow [m^3/s]; not used: a fixed cycle is known from its beginning.
    inputs : (N, 0) array
        Not used: no command is recorded [1].
    restart : (N,) uint8 array
        One `Restart` a sample. A record that begins is a cycle that begins; behind a later gap
        the phase is lost until the next cycle.
    predicted, simulated : (N,) arrays
        Flow [m^3/s]; NaN where nothing is predicted.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    for n in range(len(flow)):
        flag = restart[n]
        fresh = state[1] == 0.0
        if flag == Restart.NEW_CYCLE or (fresh and flag != Restart.GO_ON):
            state[0], state[1] = 0.0, 1.0
        elif flag == Restart.GAP:
            state[0], state[1] = 0.0, -1.0
        expected = profile(state[0], c) if state[1] > 0.0 else nan
        predicted[n] = simulated[n] = expected
        validity[n] = Validity.STARTING if isnan(expected) else Validity.VALID
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        state[0] += 1.0
