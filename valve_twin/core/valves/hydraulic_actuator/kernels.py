# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the hydraulic actuator: free run and one-step prediction.

A valve feeds a cylinder that moves a heavy arm. The oil is compressible, so the load pressure p
rises with the flow that the load does not take up, and the load is driven by the pressure that
the throttling of its own flow leaves::

    spool_lag ds/dt = u - s
    dp/dt           = q(s) - w
    dw/dt           = resonance^2 (p - throttling |w| w)

    q(s) =  flow_limit_lift  / (1 + (half_opening_lift  / s)^progressivity)       s > 0
         = -flow_limit_lower / (1 + (half_opening_lower / -s)^progressivity)      s < 0

w is the flow that the load takes up, in the unit of dp/dt, so that compressibility, area and mass
appear only in `resonance`. Throttling has one value for w > 0 (lifting) and one for w < 0. A
positive opening lifts and raises the pressure. The structure is assumed.
"""

from __future__ import annotations

from math import exp, nan
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.types import Restart, Validity

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

N_PARAMETERS = 9
"""In the order of `PARAMETERS`; the sampling time follows them in the coefficients."""

_LIFT, _LOWER, _HALF_LIFT, _HALF_LOWER, _PROGRESSIVITY = 0, 1, 2, 3, 4
_RESONANCE, _THROTTLING_LIFT, _THROTTLING_LOWER, _LAG, _PERIOD = 5, 6, 7, 8, 9

_SUBSTEPS = 2  # of a sample: resonance up to 1 / period is integrated to 1e-3, assumed
_LARGEST = 1e6  # a run that diverges stays a number

_PRESSURE, _FLOW, _FREE_PRESSURE, _FREE_FLOW, _SPOOL, _OPENING, _SEEN = range(7)
STATE_SIZE = 7
"""Pressure and load flow as observed and of the free run, spool, last opening, samples seen."""

_CORRECTION = 0.5  # share of a pressure error put down to the sample's load flow, assumed


@njit(cache=True)
def flow(s: float, c: FloatArray) -> float:
    """Return the flow q [pressure/s] through the spool at `s` [1]; `c` (10,) coefficients."""
    if s > 0.0:
        return float(c[_LIFT] / (1.0 + (c[_HALF_LIFT] / s) ** c[_PROGRESSIVITY]))
    if s < 0.0:
        return float(-c[_LOWER] / (1.0 + (-c[_HALF_LOWER] / s) ** c[_PROGRESSIVITY]))
    return 0.0


@njit(cache=True)
def _load(p: float, w: float, c: FloatArray) -> float:
    throttling = c[_THROTTLING_LIFT] if w > 0.0 else -c[_THROTTLING_LOWER]
    return float(c[_RESONANCE] ** 2 * (p - throttling * w * w))


@njit(cache=True)
def _bounded(value: float) -> float:
    return float(min(max(value, -_LARGEST), _LARGEST))


@njit(cache=True)
def _oil_and_load(
    p: float, w: float, q0: float, q1: float, q2: float, h: float, c: FloatArray
) -> tuple[float, float]:
    """Advance pressure and load flow by `h` [s]; the flow at begin, middle and end is given."""
    p1, w1 = q0 - w, _load(p, w, c)
    pm, wm = p + 0.5 * h * p1, w + 0.5 * h * w1
    p2, w2 = q1 - wm, _load(pm, wm, c)
    pm, wm = p + 0.5 * h * p2, w + 0.5 * h * w2
    p3, w3 = q1 - wm, _load(pm, wm, c)
    pm, wm = p + h * p3, w + h * w3
    p4, w4 = q2 - wm, _load(pm, wm, c)
    return (
        _bounded(p + h / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)),
        _bounded(w + h / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)),
    )


@njit(cache=True)
def _flows(spool: float, before: float, now: float, c: FloatArray, q: FloatArray) -> float:
    """Fill `q` (2 substeps + 1,) with the flows over one sample; return the spool at its end.

    The opening moves straight from one sample to the next and is held over half a substep.
    """
    half = 0.5 * c[_PERIOD] / _SUBSTEPS
    left = exp(-half / c[_LAG])
    q[0] = flow(spool, c)
    steps = 2 * _SUBSTEPS
    for k in range(steps):
        target = before + (now - before) * (k + 0.5) / steps
        spool = target + (spool - target) * left
        q[k + 1] = flow(spool, c)
    return spool


@njit(cache=True)
def _advance(p: float, w: float, q: FloatArray, c: FloatArray) -> tuple[float, float]:
    h = c[_PERIOD] / _SUBSTEPS
    for k in range(_SUBSTEPS):
        p, w = _oil_and_load(p, w, q[2 * k], q[2 * k + 1], q[2 * k + 2], h, c)
    return p, w


@njit(cache=True)
def free_run(c: FloatArray, opening: FloatArray, first: float, out: FloatArray) -> None:
    """Simulate N samples from the first measured pressure with the load at rest.

    Parameters
    ----------
    c : (10,) array
        Parameters in the order of `PARAMETERS`, then the sampling time [s].
    opening : (N,) array
        Valve opening [1].
    first : float
        Pressure at the first sample [unit of the signal].
    out : (N,) array
        Overwritten with the pressure [unit of the signal].
    """
    q = np.empty(2 * _SUBSTEPS + 1)
    p, w, spool = first, 0.0, opening[0]
    out[0] = p
    for n in range(1, len(opening)):
        spool = _flows(spool, opening[n - 1], opening[n], c, q)
        p, w = _advance(p, w, q, c)
        out[n] = p


@njit(cache=True)
def predict_block(
    state: FloatArray,
    c: FloatArray,
    pressure: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place; see `ValveModel.predict`.

    The load flow is not measured: an observer corrects it by what the pressure did otherwise than
    predicted. A free run starts from the observed flow, behind a gap from a load at rest.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    c : (10,) array
        See `free_run`.
    pressure : (N,) array
        Measured pressure [unit of the signal].
    inputs : (N, 1) array
        Valve opening [1].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [unit of the signal]; NaN at the first sample.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    q = np.empty(2 * _SUBSTEPS + 1)
    for n in range(len(pressure)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        ready = state[_SEEN] > 0.0
        now = state[_OPENING] if flag == Restart.BAD else inputs[n, 0]
        validity[n] = Validity.VALID if ready else Validity.STARTING
        if ready:
            state[_SPOOL] = _flows(state[_SPOOL], state[_OPENING], now, c, q)
            p, w = _advance(state[_PRESSURE], state[_FLOW], q, c)
            state[_PRESSURE], state[_FLOW] = p, w
            p, w = _advance(state[_FREE_PRESSURE], state[_FREE_FLOW], q, c)
            state[_FREE_PRESSURE], state[_FREE_FLOW] = p, w
        predicted[n] = state[_PRESSURE] if ready else nan
        state[_OPENING] = now
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        elif ready:
            error = pressure[n] - state[_PRESSURE]
            state[_FLOW] = _bounded(state[_FLOW] - _CORRECTION * error / c[_PERIOD])
            state[_PRESSURE] = pressure[n]
        else:
            state[_SPOOL], state[_FLOW], state[_SEEN] = now, 0.0, 1.0
            state[_PRESSURE] = state[_FREE_PRESSURE] = pressure[n]
            state[_FREE_FLOW] = 0.0
        if flag == Restart.NEW_CYCLE and state[_SEEN] > 0.0:
            state[_FREE_PRESSURE], state[_FREE_FLOW] = state[_PRESSURE], state[_FLOW]
        simulated[n] = state[_FREE_PRESSURE] if state[_SEEN] > 0.0 else nan
