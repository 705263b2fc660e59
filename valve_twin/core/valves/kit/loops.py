# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What a law is compiled into: the prediction of a sample, free run and simulation.

They are templates: `law.bind` makes a compiled copy for each law in which the global names
`step`, `rest` and `STATES` are those of the law. An input that is sampled `lag` samples before
acts from the sample before to this one; lag 1 is a held command without delay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.types import FloatArray, Validity
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response

STATES = 1
MAX_LAG = 128
"""Longest command to output lag [samples]."""


def memory_size(inputs: int) -> int:
    """Return the length of the memory of the prediction: the inputs so far."""
    return 1 + (MAX_LAG + 1) * inputs


def step(x: FloatArray, u: FloatArray, p: FloatArray, period_s: float) -> None:
    """Stand for the law's own, as `Law` says."""


@njit(cache=True)
def rest(x: FloatArray, u: FloatArray, p: FloatArray) -> None:
    """Fill the states that are not measured with 0, as `Law` says."""
    x[1:] = 0.0


class Numbers(NamedTuple):
    """Parameters (P,), lag of the inputs [samples], sampling time [s]."""

    p: FloatArray
    lag: int
    period_s: float


@njit(cache=True)
def numbers(c: FloatArray) -> Numbers:
    """Return the law's numbers from (P + 2,) coefficients: parameters, lag, sampling time."""
    return Numbers(c[:-2], int(c[-2]), c[-1])


@per_sample
def push(memory: FloatArray, inputs: FloatArray, n: int, bad: bool) -> None:
    """Add the inputs of a sample to those so far; where they are bad, those before hold.

    Parameters
    ----------
    memory : (1 + L M,) array
        Where the newest begin, then those of L samples as a ring [unit of the signals]; written
        in place.
    inputs, n : (N, M) array, int
        Inputs [unit of the signals] and the row of the sample.
    bad : bool
        Whether they are unusable.
    """
    before = int(memory[0])
    newest = before + inputs.shape[1]
    if newest == len(memory) - 1:
        newest = 0
    for j in range(inputs.shape[1]):
        memory[1 + newest + j] = memory[1 + before + j] if bad else inputs[n, j]
    memory[0] = newest


@per_sample
def pushed(memory: FloatArray, inputs: int, lag: int) -> int:
    """Return where the M inputs of `lag` samples ago begin, the newest of 0; memory as `push`."""
    at = int(memory[0]) - lag * inputs
    return at + 1 if at >= 0 else at + len(memory)


def advance(
    m: Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    """Take both runs to this sample once the inputs of its lag are known, as `prediction` says."""
    push(memory, inputs, n, bad)
    ready = seen >= max(m.lag, 1)
    if ready:
        at = pushed(memory, inputs.shape[1], m.lag)
        acting = memory[at : at + inputs.shape[1]]
        step(free, acting, m.p, m.period_s)
        step(followed, acting, m.p, m.period_s)
    return Validity.VALID if ready else Validity.STARTING


def follow(
    m: Numbers, followed: FloatArray, memory: FloatArray, x: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    """Take the measured output, as `prediction` says; other states go on, from rest after gaps."""
    followed[0] = x
    if code == Validity.STARTING:
        at = pushed(memory, inputs.shape[1], m.lag)
        rest(followed, memory[at : at + inputs.shape[1]], m.p)
    return code


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
