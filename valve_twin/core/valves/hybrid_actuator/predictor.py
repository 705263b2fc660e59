# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the armature from measured currents: one step ahead, and free.

One step ahead, an observer follows the measured position; the free run starts from it at the
beginning of a cycle and sees the currents only. Both bounce at the seats as the plant does.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.hybrid_actuator.flight import advance
from valve_twin.core.valves.hybrid_actuator.magnetics import Magnetics
from valve_twin.core.valves.hybrid_actuator.plant_kernel import Armature, net_force

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

_SEEN, _X, _V, _FREE_X, _FREE_V, _OPENER, _CLOSER = range(7)
STATE_SIZE = 7
"""Samples seen, observed and free position [m] and speed [m/s], last currents [A]."""

N_COEFFICIENTS = 21

_SUBSTEPS = 4
_POSITION_GAIN, _SPEED_GAIN = 0.5, 0.15  # of the observer, per sample [1], assumed
_REST_SPEED = 1e-2  # slower than this after an impact is rest [m/s], assumed


def coefficients(
    a: Armature, solenoid: Magnetics, current_scale: float, period_s: float
) -> FloatArray:
    """Return the (N_COEFFICIENTS,) coefficients of `predict_block`.

    Parameters
    ----------
    a, solenoid : Armature, Magnetics
        The model in force.
    current_scale, period_s : float
        Full scale of the current signals [A] and sampling time [s].
    """
    moving = (a.mass, a.spring, a.damping, a.travel, a.residual_gap, a.restitution)
    gas, last = (a.gas_force, a.gas_length), (current_scale, period_s, a.coulomb)
    return np.array([*moving, *gas, *solenoid, *last])


@njit(cache=True)
def _seated(a: Armature, m: Magnetics, x: float, v: float, i_o: float, i_c: float) -> bool:
    if v != 0.0 or abs(x) < a.travel:
        return False
    return net_force(a, m, m, x, i_o, i_c) * x >= 0.0


@njit(cache=True)
def _move(
    a: Armature,
    m: Magnetics,
    x: float,
    v: float,
    now: tuple[float, float],
    then: tuple[float, float],
    period: float,
) -> tuple[float, float]:
    """Return position and speed a sample later, seats included; currents are straight lines."""
    h = period / _SUBSTEPS
    for k in range(_SUBSTEPS):
        s, e = k / _SUBSTEPS, (k + 1) / _SUBSTEPS
        o0, o1 = now[0] + s * (then[0] - now[0]), now[0] + e * (then[0] - now[0])
        c0, c1 = now[1] + s * (then[1] - now[1]), now[1] + e * (then[1] - now[1])
        if _seated(a, m, x, v, o0, c0):
            continue
        x, v = advance(a, m, x, v, o0, o1, c0, c1, h)
        if abs(x) >= a.travel and x * v >= 0.0:
            x = a.travel if x > 0.0 else -a.travel
            v = -a.restitution * v
            if abs(v) < _REST_SPEED:
                v = 0.0
    return x, v


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
    """Predict N samples in place; see `ValveModel.predict`.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    c : (N_COEFFICIENTS,) array
        See `coefficients`.
    position : (N,) array
        Measured position [1].
    inputs : (N, 4) array
        Voltages and currents [1].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [1].
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    a = Armature(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], 1.0, 1.0, True, c[20])
    m = Magnetics(int(c[8]), c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17])
    scale, period = c[18], c[19]
    for n in range(len(position)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        now = (state[_OPENER], state[_CLOSER])
        then = now if flag == Restart.BAD else (inputs[n, 2] * scale, inputs[n, 3] * scale)
        ready = state[_SEEN] > 0.0
        seated = False
        if ready:
            seated = _seated(a, m, state[_X], state[_V], now[0], now[1])
            state[_X], state[_V] = _move(a, m, state[_X], state[_V], now, then, period)
            state[_FREE_X], state[_FREE_V] = _move(
                a, m, state[_FREE_X], state[_FREE_V], now, then, period
            )
        predicted[n] = 0.5 * (state[_X] / a.travel + 1.0) if ready else nan
        validity[n] = Validity.AT_SEAT if seated else Validity.VALID
        if not ready:
            validity[n] = Validity.STARTING
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        else:
            _observe(state, a, (2.0 * position[n] - 1.0) * a.travel, ready, period)
            if flag == Restart.NEW_CYCLE or not ready:
                state[_FREE_X], state[_FREE_V] = state[_X], state[_V]
            state[_SEEN] += 1.0
            state[_OPENER], state[_CLOSER] = then
        simulated[n] = 0.5 * (state[_FREE_X] / a.travel + 1.0) if ready else nan


@njit(cache=True)
def _observe(state: FloatArray, a: Armature, x: float, ready: bool, period: float) -> None:
    """Let the observer follow a measured position [m]."""
    if not ready:
        state[_X], state[_V] = min(max(x, -a.travel), a.travel), 0.0
        if abs(x) > 0.98 * a.travel:
            state[_X] = a.travel if x > 0.0 else -a.travel
        return
    off = x - state[_X]
    resting = abs(state[_X]) >= a.travel and state[_V] == 0.0
    if resting and abs(off) < 0.02 * a.travel:
        return
    state[_X] = min(max(state[_X] + _POSITION_GAIN * off, -a.travel), a.travel)
    state[_V] += _SPEED_GAIN * off / period
