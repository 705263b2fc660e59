# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the stepper valve: thread with backlash, or Hammerstein-Wiener model.

Its loop is its own, not `kit.prediction`: that one counts samples from the first usable one on,
this one from the first of the record, so that the bits of a record that begins badly differ.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.stepper_servo.kernels import play_step
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray

ORDER = 3
"""Greatest na, nb and nl that are published and predicted with."""
MAX_LAG = 64
"""Longest delay of prediction and identification [samples]."""

MODE, COEFFICIENTS = 0, 14
"""mode (0 thread, 1 Hammerstein-Wiener), then backlash [1], offset [1], delay [samples], or
a (3), b (3), beta (2), gamma (2), nk, centre [1], offset of the motor position [1]."""

_LAST, _FREE, _SEEN, _HEAD, _LINEAR, _FREE_LINEAR = range(6)
_PAST = 6
_PAST_FREE = _PAST + ORDER
_LINE = _PAST_FREE + ORDER
_LENGTH = MAX_LAG + ORDER + 1
STATE_SIZE = _LINE + _LENGTH
"""Last measured and free position, samples seen, head of the line, linear parts, past measured
and free positions (3 each), past motor positions."""


@njit(cache=True)
def _motor(state: FloatArray, back: int) -> float:
    """Return the motor position of `back` samples ago; the head is the present one."""
    return float(state[_LINE + (int(state[_HEAD]) - back) % _LENGTH])


@njit(cache=True)
def _thread(state: FloatArray, c: FloatArray, last: float) -> float:
    whole = int(c[3])
    late = _motor(state, whole)
    m = late + (c[3] - whole) * (_motor(state, whole + 1) - late)
    return play_step(last, m, c[1], c[2])


@njit(cache=True)
def _wiener(
    state: FloatArray, c: FloatArray, past: FloatArray, before: float
) -> tuple[float, float]:
    """Return the output and its linear part, about the centre: paper 004, eq. (8)-(10)."""
    lag, centre = int(c[11]), c[12]
    linear = 0.0
    for i in range(ORDER):
        linear -= c[1 + i] * (past[i] - centre)
        linear += c[4 + i] * (_motor(state, lag + i) + c[13] - centre)
    u = _motor(state, lag) + c[13] - centre
    linear += c[7] * u * u + c[8] * u * u * u
    return linear + c[9] * before * before + c[10] * before * before * before, linear


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
    c : (COEFFICIENTS,) array
        See `COEFFICIENTS`.
    position, inputs : (N,), (N, 2) arrays
        Measured position; counted motor position and flow [1].
    restart, validity : (N,) uint8 arrays
        One `Restart` and one `Validity` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [1].
    """
    wiener = c[MODE] > 0.5
    needed = max(ORDER, int(c[11]) + ORDER - 1) if wiener else int(c[3]) + 1
    past = state[_PAST:_PAST_FREE]
    past_free = state[_PAST_FREE:_LINE]
    for n in range(len(position)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        head = (int(state[_HEAD]) + 1) % _LENGTH
        held = state[_LINE + int(state[_HEAD])]
        state[_HEAD] = head
        state[_LINE + head] = held if flag == Restart.BAD else inputs[n, 0]
        ready = state[_SEEN] >= needed
        one, free = nan, nan
        if ready and wiener:
            one, linear = _wiener(state, c, past, state[_LINEAR])
            free, free_linear = _wiener(state, c, past_free, state[_FREE_LINEAR])
            state[_LINEAR], state[_FREE_LINEAR] = linear, free_linear
            one, free = one + c[12], free + c[12]
            if not abs(free) < 1e6:
                free, state[_FREE_LINEAR] = state[_LAST], state[_LAST] - c[12]
        elif ready:
            one, free = _thread(state, c, state[_LAST]), _thread(state, c, state[_FREE])
        predicted[n] = one
        validity[n] = Validity.VALID if ready else Validity.STARTING
        measured = position[n]
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
            measured = one if ready else state[_LAST]
        elif not ready or flag == Restart.NEW_CYCLE:
            free = measured
            past_free[:] = past
            state[_LINEAR] = state[_LINEAR] if ready else measured - c[12]
            state[_FREE_LINEAR] = state[_LINEAR]
        if not ready and flag == Restart.BAD:
            free = measured
        for i in range(ORDER - 1, 0, -1):
            past[i], past_free[i] = past[i - 1], past_free[i - 1]
        past[0], past_free[0] = measured, free
        state[_LAST], state[_FREE] = measured, free
        simulated[n] = free if ready else nan
        state[_SEEN] += 1.0
