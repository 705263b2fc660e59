# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the extended positioner: what a plain rate law does not show.

The plain law of `kernels` asks for a speed; here the spool's speed may follow that with a lag, the
target may come through a static curve and through delays of its own each way, and friction may
hold the spool or play may hide its motion::

    target    = rest_level + static_gain max(u - dead_command, 0)     (static curve, else u)
    asked     = the speed of the plain law at the target's distance
    lag dv/dt = asked - v,  dx/dt = v                                 (second order)
    x at rest moves only beyond dead_band + stiction, and sticks again within a tenth of it
    position  = play(x, backlash)

With the lag, x'' = stiffness (target - x) - damping x' where nothing saturates: damping = 1 / lag
and stiffness = rate / lag, so the rate of the plain law is their ratio. The region (rising,
falling, limited, at rest) is judged at the start of each sub-step, and inside it the solution is
the closed one (assumed).
"""

from __future__ import annotations

from math import cos, cosh, exp, sin, sinh, sqrt
from typing import NamedTuple

import numpy as np

from valve_twin.core.types import FloatArray, Validity
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.loops import push
from valve_twin.core.valves.kit.prediction import predictor
from valve_twin.core.valves.positioner.kernels import RUNS, motion
from valve_twin.kernels import njit

N_EXTENDED = 12
"""The 5 of the plain law, then lag [s], stiction, backlash, dead_command, static_gain, rest_level
[1] and whether the curve is in force."""

LAG, STICTION, BACKLASH, DEAD_COMMAND, STATIC_GAIN, REST_LEVEL, CURVED = range(5, N_EXTENDED)

_X, _V, _MOVING, _Y = range(4)
MOTION_SIZE = RUNS
"""Spool position [1] and speed [1/s], whether it moves, position behind the play [1]."""

N_TRANSITION = 9
_SUB_STEPS = 4  # sub-steps a sample in which the region is judged again, with a lag [1], assumed
_STICKS = 0.1  # share of the stiction at which a moving spool comes to rest [1], assumed
_LONG_LAG = 8.0  # lag in sampling times from which one sub-step will do [1], assumed
_LEAST_LAG = 1e-9  # below this the lag is none [s]


@njit(cache=True)
def _linear(rate: float, lag: float, h: float, out: FloatArray) -> None:
    """Write exp(h [[0, 1], [-rate/lag, -1/lag]]) into `out` (4,)."""
    k, half = rate / lag, 0.5 / lag
    square = half * half - k
    if square > 0.0:
        w = sqrt(square)
        if w * h > 30.0:  # cosh would overflow; both decay
            fast, slow = exp(-(half + w) * h), exp(-k / (half + w) * h)
            c, s = 0.5 * (slow + fast), 0.5 * (slow - fast) / w
        else:
            c, s = exp(-half * h) * cosh(w * h), exp(-half * h) * sinh(w * h) / w
    elif square < 0.0:
        w = sqrt(-square)
        c, s = exp(-half * h) * cos(w * h), exp(-half * h) * sin(w * h) / w
    else:
        c, s = exp(-half * h), exp(-half * h) * h
    out[0], out[1], out[2], out[3] = c + half * s, s, -k * s, c - half * s


@njit(cache=True)
def transition(p: FloatArray, h: float, out: FloatArray) -> None:
    """Prepare a sub-step.

    Parameters
    ----------
    p : (N_EXTENDED,) array
        Parameters, see `N_EXTENDED`.
    h : float
        Sub-step [s].
    out : (N_TRANSITION,) array
        Overwritten where there is a lag: rising and falling matrix of position and speed, row by
        row [1], [s], [1/s], [1], and decay of the speed [1].
    """
    if p[LAG] > _LEAST_LAG:
        _linear(p[0], p[LAG], h, out[0:4])
        _linear(p[1], p[LAG], h, out[4:8])
        out[8] = exp(-h / p[LAG])


@njit(cache=True)
def sub_steps(p: FloatArray, period: float) -> int:
    """Return the sub-steps of a sample [s]: one where it is short beside the lag, or without one.

    Without a lag the solution is closed over all of it.
    """
    return _SUB_STEPS if _LEAST_LAG < p[LAG] < _LONG_LAG * period else 1


@njit(cache=True)
def target_of(command: float, p: FloatArray) -> float:
    """Return where the spool is sent by a command [1]."""
    if p[CURVED] == 0.0:
        return command
    return float(p[REST_LEVEL] + p[STATIC_GAIN] * max(command - p[DEAD_COMMAND], 0.0))


@njit(cache=True)
def move(
    z: FloatArray,
    target: float,
    p: FloatArray,
    h: float,
    steps: int,
    m: FloatArray,
    lower: float,
    upper: float,
) -> None:
    """Move the spool towards a held target by `steps` sub-steps of `h` [s].

    Parameters
    ----------
    z : (4,) array
        State, see `MOTION_SIZE`; written in place.
    target : float
        Where it is sent [1].
    p, m : (12,), (9,) arrays
        Parameters and what `transition` made of them.
    h, steps : float, int
        Length [s] and number of sub-steps.
    lower, upper : float
        Mechanical stops [1].
    """
    x, v = z[_X], z[_V]
    for _ in range(steps):
        e = target - x
        band = p[4] + (_STICKS if z[_MOVING] > 0.0 else 1.0) * p[STICTION]
        way = 1.0 if e > band else (-1.0 if e < -band else 0.0)
        z[_MOVING] = abs(way)
        j = 0 if way > 0.0 else 1
        q = abs(e) - p[4]
        if p[LAG] <= _LEAST_LAG:
            if way != 0.0:
                v = way * motion(q, p[j], p[2 + j], h)[0] / h
                x += v * h
            else:
                v = 0.0
        elif way != 0.0 and p[j] * q <= p[2 + j]:
            distance = -way * q
            x += m[4 * j] * distance + m[4 * j + 1] * v - distance
            v = m[4 * j + 2] * distance + m[4 * j + 3] * v
        else:
            asked = way * p[2 + j]
            over = v - asked
            x += asked * h + over * p[LAG] * (1.0 - m[8])
            v = asked + over * m[8]
        if x < lower or x > upper:
            x = min(max(x, lower), upper)
            v = 0.0
    z[_X], z[_V] = x, v
    play = 0.5 * p[BACKLASH]
    z[_Y] = min(max(z[_Y], x - play), x + play)


@njit(cache=True)
def rest_at(z: FloatArray, position: float) -> None:
    """Put the spool at rest at a position [1], in the middle of its play."""
    z[_X] = position
    z[_V] = 0.0
    z[_MOVING] = 0.0
    z[_Y] = position


@njit(cache=True)
def delayed(line: FloatArray, n: int, rising: int, falling: int) -> float:
    """Return the command in force at sample n; a rise and a fall have delays of their own.

    Parameters
    ----------
    line : (L,) array
        Commands, read as a ring, so a whole record serves as well as a delay line [1].
    n : int
        Index of the sample in it.
    rising, falling : int
        Delays of a rise and of a fall [samples].
    """
    size = len(line)
    u = line[(n - rising) % size]
    if rising > falling:
        for k in range(n - rising + 1, n - falling + 1):
            u = min(u, line[k % size])
    else:
        for k in range(n - falling, n - rising):
            u = max(u, line[k % size])
    return float(u)


@njit(cache=True)
def delay_record(command: FloatArray, rising: int, falling: int, first: int) -> FloatArray:
    """Return the command (N,) in force at each sample; before `first`, as it comes.

    Before the record it is taken for what it was in its first sample.

    Parameters
    ----------
    command : (N,) array
        Command [1].
    rising, falling : int
        Delay of a rise and of a fall [samples].
    first : int
        First sample that is delayed.
    """
    out, longer = command.copy(), max(rising, falling)
    line = np.concatenate((np.full(longer, command[0]), command))
    for n in range(first, len(command)):
        out[n] = delayed(line, n + longer, rising, falling)
    return out


@njit(cache=True)
def free_run(
    p: FloatArray,
    position: FloatArray,
    in_force: FloatArray,
    period: float,
    first: int,
    stops: FloatArray,
    out: FloatArray,
) -> None:
    """Run the model free from the measured position after the delay, at rest.

    Parameters
    ----------
    p : (12,) array
        Parameters, see `N_EXTENDED`.
    position, in_force : (N,) arrays
        Measured position and command in force, see `delay_record` [1].
    period : float
        Sampling time [s].
    first : int
        The delay before which no command is in force, below N [samples].
    stops : (2,) array
        Mechanical stops [1].
    out : (N,) array
        Written: simulated position [1], the measured one before `first`.
    """
    z = np.zeros(MOTION_SIZE)
    m = np.zeros(N_TRANSITION)
    steps = sub_steps(p, period)
    h = period / steps
    transition(p, h, m)
    out[: first + 1] = position[: first + 1]
    rest_at(z, position[first])
    for n in range(first + 1, len(position)):
        target = target_of(in_force[n], p)
        move(z, target, p, h, steps, m, stops[0], stops[1])
        out[n] = z[_Y]


class _Numbers(NamedTuple):
    """Parameters (N_EXTENDED,), what `transition` made of them, what a sample is cut into."""

    p: FloatArray
    transition: FloatArray
    steps: int
    step_s: float
    rising: int
    falling: int
    lower_stop: float
    upper_stop: float
    trust: float


@njit(cache=True)
def _numbers(c: FloatArray) -> _Numbers:
    p = c[:N_EXTENDED]
    period, rising, falling, lower_stop, upper_stop = c[N_EXTENDED : N_EXTENDED + 5]
    steps = sub_steps(p, period)
    m = np.zeros(N_TRANSITION)
    transition(p, period / steps, m)
    delays = int(rising), int(falling)
    trust = 1.0 / (p[LAG] + period)
    return _Numbers(p, m, steps, period / steps, *delays, lower_stop, upper_stop, trust)


@per_sample
def _advance_extended(
    m: _Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    push(memory, inputs, n, bad)
    ready = seen > max(m.rising, m.falling)
    if ready:
        line = memory[1:]
        command = delayed(line, int(memory[0]) + len(line), m.rising, m.falling)
        target = target_of(command, m.p)
        for z in (followed, free):
            move(z, target, m.p, m.step_s, m.steps, m.transition, m.lower_stop, m.upper_stop)
    return Validity.VALID if ready else Validity.STARTING


@per_sample
def _follow_extended(
    m: _Numbers, followed: FloatArray, memory: FloatArray, position: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    """Correct speed and place by what the position did otherwise, the more the shorter the lag."""
    if code == Validity.STARTING:
        rest_at(followed, position)
        return code
    miss = position - followed[_Y]
    followed[_X] += miss
    followed[_Y] = position
    followed[_V] += m.trust * miss
    return code


predict_extended = predictor(
    _advance_extended, _follow_extended, run=MOTION_SIZE, numbers=_numbers, output=_Y
)
"""Prediction of the extended law; 17 coefficients: the 12 parameters, period [s], delay of a rise
and of a fall [samples], lower and upper stop [1]."""
