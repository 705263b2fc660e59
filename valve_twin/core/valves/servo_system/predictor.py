# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the piston from the desired position: one step ahead, and free.

Both simulate the whole loop. One step ahead, piston and load are moved towards each measured
position; the free run starts from there at the beginning of a cycle.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.physics.hysteresis import PLAYS
from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import numbers as num
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, advance, rest

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

N_COEFFICIENTS = num.COUNT + 1
"""Numbers of the loop, and the sampling time [s]."""

_SEEN, _LAST = 0, 1
_RUN = dyn.STATES + PLAYS + 1
_OBSERVED = 2
_FREE = _OBSERVED + _RUN
STATE_SIZE = _FREE + _RUN
"""Whether started, desired position [1]; of the observed and of the free loop the states, the
motor's memory and the next step."""

_GAIN = 0.1  # share of the distance to a measured position that is corrected [1], assumed
_RTOL = 1e-4


@njit(cache=True)
def _shift(y: FloatArray, p: FloatArray, way: float) -> None:
    """Move piston and load together [m]."""
    y[dyn.XP] += way
    y[dyn.TH] += way / p[num.ARM]


@njit(cache=True)
def _begin(run: FloatArray, p: FloatArray, place: float) -> bool:
    """Write a loop at rest about a position [m]."""
    y, memory = run[: dyn.STATES], run[dyn.STATES : dyn.STATES + PLAYS]
    memory[:] = 0.0
    run[dyn.STATES + PLAYS] = FIRST_STEP
    settled = rest(place, p, y, memory)
    _shift(y, p, place - y[dyn.XP])
    return bool(settled and np.isfinite(y).all())


@njit(cache=True)
def _move(run: FloatArray, p: FloatArray, u: FloatArray, period: float) -> bool:
    """Let a loop run for a sample; False where the integration fails."""
    y, memory = run[: dyn.STATES], run[dyn.STATES : dyn.STATES + PLAYS]
    h, reached, _ = advance(y, memory, p, u, period, max(run[-1], FIRST_STEP), _RTOL)
    run[dyn.STATES + PLAYS] = h
    return bool(reached >= period * (1.0 - 1e-9) and np.isfinite(y).all())


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
        See `N_COEFFICIENTS`.
    position : (N,) array
        Measured position [1].
    inputs : (N, 9) array
        Desired position and sensors [1].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [1].
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    p, period = c[: num.COUNT], c[num.COUNT]
    stroke = p[num.STROKE]
    observed, free = state[_OBSERVED:_FREE], state[_FREE:]
    u = np.zeros(dyn.CONTROLS)
    u[dyn.FED_BACK] = nan
    for n in range(len(position)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        if state[_SEEN] > 0.0:
            u[dyn.WANTED] = (state[_LAST] - 0.5) * stroke
            alive = _move(observed, p, u, period) and _move(free, p, u, period)
            state[_SEEN] = 1.0 if alive else 0.0
        ready = state[_SEEN] > 0.0
        predicted[n] = observed[dyn.XP] / stroke + 0.5 if ready else nan
        validity[n] = Validity.VALID if ready else Validity.STARTING
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        else:
            measured = min(max(position[n], -0.2), 1.2)
            if ready:
                _shift(observed, p, _GAIN * ((measured - 0.5) * stroke - observed[dyn.XP]))
            elif _begin(observed, p, (measured - 0.5) * stroke):
                state[_SEEN] = 1.0
            if flag == Restart.NEW_CYCLE or not ready:
                free[:] = observed
            state[_LAST] = min(max(inputs[n, 0], -1.0), 2.0)
        simulated[n] = free[dyn.XP] / stroke + 0.5 if ready else nan
