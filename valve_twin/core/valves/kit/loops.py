# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The loops over samples that a law is compiled into: prediction, free run, simulation.

They are templates: `law.bind` makes a compiled copy for each law in which the global names
`step`, `rest` and `STATES` are those of the law. An input that is sampled `lag` samples before
acts from the sample before to this one; lag 1 is a held command without delay.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.types import Restart, Validity

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import ByteArray, FloatArray

STATES = 1
MAX_LAG = 128
"""Longest command to output lag [samples]."""

_SEEN, _HEAD, _FREE = 0, 1, 2


def state_size(states: int, inputs: int) -> int:
    """Return the length of `predict`'s state: counters, two runs of the law, the inputs so far."""
    return _FREE + 2 * states + (MAX_LAG + 1) * inputs


def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Stand for the law's own, as `Law` says."""


@njit(cache=True)
def rest(x: FloatArray, u: FloatArray, p: FloatArray) -> None:
    """Fill the states that are not measured with 0, as `Law` says."""
    x[1:] = 0.0


def predict(
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

    The states that are not measured go on as the law says, from their rest behind a gap.

    Parameters
    ----------
    state : (`state_size`,) array
        Written in place.
    c : (P + 2,) array
        Parameters, lag [samples], sampling time [s].
    measured : (N,) array
        Output [unit of the signal].
    inputs : (N, M) array
        Inputs [unit of the signals].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run, NaN before the input of `lag` samples ago is known.
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    p, lag, period_s = c[:-2], int(c[-2]), c[-1]
    free = state[_FREE : _FREE + STATES]
    followed = state[_FREE + STATES : _FREE + 2 * STATES]
    line = state[_FREE + 2 * STATES :].reshape(MAX_LAG + 1, inputs.shape[1])
    needed = max(lag, 1)
    for n in range(len(measured)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        head = int(state[_HEAD])
        line[head] = line[head - 1] if flag == Restart.BAD else inputs[n]
        state[_HEAD] = (head + 1) % (MAX_LAG + 1)
        u = line[(head - lag) % (MAX_LAG + 1)]
        ready = state[_SEEN] >= needed
        if ready:
            step(free, u, p, period_s)
            step(followed, u, p, period_s)
        predicted[n] = followed[0] if ready else nan
        validity[n] = Validity.VALID if ready else Validity.STARTING
        if flag == Restart.BAD:
            validity[n] = Validity.BAD_INPUT
        if flag != Restart.BAD:
            followed[0] = measured[n]
            if not ready:
                rest(followed, u, p)
            if not ready or flag == Restart.NEW_CYCLE:
                free[:] = followed
        simulated[n] = free[0] if ready else nan
        if flag != Restart.BAD or state[_SEEN] > 0.0:
            state[_SEEN] += 1.0


def free_run(
    x: FloatArray,
    p: FloatArray,
    period_s: float,
    inputs: FloatArray,
    lag: int,
    first: int,
    out: FloatArray,
) -> None:
    """Run the law over a record from a known output on.

    Parameters
    ----------
    x : (S,) array
        x[0] is the output at sample `first`; overwritten.
    p : (P,) array
        Parameters [unit of each].
    period_s : float
        Sampling time [s].
    inputs : (N, M) array
        Inputs [unit of the signals].
    lag, first : int
        Lag of the inputs and where the run begins, not before the lag [samples].
    out : (N,) array
        Overwritten with the output from sample `first` on.
    """
    rest(x, inputs[first - lag], p)
    out[first] = x[0]
    for n in range(first + 1, len(inputs)):
        step(x, inputs[n - lag], p, period_s)
        out[n] = x[0]


def simulate(
    x: FloatArray,
    p: FloatArray,
    period_s: float,
    forcing: Forcing,
    out: Response,
) -> None:
    """Simulate N samples of the valve, faults included.

    Parameters
    ----------
    x : (S + M,) array
        State at the first stamp, then the inputs in force before it; overwritten with those after
        the last [unit of each].
    p : (P,) array
        Parameters [unit of each].
    period_s : float
        Sampling time [s].
    forcing : Forcing
        What acts on it: the commands, or the reference as every command, are held from their
        stamps on; those before stay where one is lost. Process noise is added while it moves.
    out : Response
        Overwritten with the output at the stamps (N,) [unit of the output], and the inputs (N, M).
    """
    reference, _, external, commands, disturbance, leak_rate, stuck, _, _, lost = forcing
    position, inputs = out
    before = np.empty(STATES)
    for n in range(len(position)):
        position[n] = x[0]
        if external:
            inputs[n] = commands[n]
        else:
            inputs[n] = reference[n]
        if not lost[n]:
            x[STATES:] = inputs[n]
        before[:] = x[:STATES]
        step(x[:STATES], x[STATES:], p, period_s)
        if x[0] != before[0]:
            x[0] += disturbance[n]
        x[0] -= leak_rate * period_s
        if stuck:
            x[:STATES] = before
