# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled adaptive integration of the servosystem, and its resting state.

The desired position is held from sample to sample, so that every interval is autonomous. The
memory of the hysteresis is written after each accepted step: inside a step the current is taken
as monotone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.physics import hysteresis, rodas
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import numbers as num
from valve_twin.core.valves.servo_system.dynamics import evaluate
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray

MOST_STEPS = 5000
"""Steps a sample after which an integration counts as failed, rejected ones included."""

FIRST_STEP = 1e-5
"""Step to start with [s]."""

_SETTLE_S = 1.5  # time that the loops get to settle [s]
_SETTLE_RTOL = 1e-4


class Room(NamedTuple):
    """Where a step is computed: increments; Jacobian, matrix, its pivots; two states; work."""

    k: FloatArray
    jac: FloatArray
    matrix: FloatArray
    pivot: IntArray
    ends: FloatArray
    work: FloatArray


@njit(cache=True, inline="always")
def _step(
    y: FloatArray,
    memory: FloatArray,
    p: FloatArray,
    u: FloatArray,
    h: float,
    rtol: float,
    fresh: bool,
    room: Room,
) -> float:
    """Try one step: increments in `k`, the new state in `ends[1]`; return its error [1].

    `jac` is renewed if `fresh`, else it is that of the same state from the try before.
    """
    k, jac, matrix, pivot, ends, work = room
    point, new = ends[0], ends[1]
    evaluate(y, p, memory, u, work, k[0], jac, fresh)
    rodas.shift(jac, h, matrix)
    if not rodas.factorise(matrix, pivot):
        return np.nan
    rodas.solve(matrix, pivot, k[0])
    for i in range(1, rodas.STAGES):
        rodas.stage_point(y, k, i, point)
        evaluate(point, p, memory, u, work, k[i], jac, False)
        rodas.stage_load(k, i, h)
        rodas.solve(matrix, pivot, k[i])
    for s in range(dyn.STATES):
        new[s] = point[s] + k[rodas.STAGES - 1, s]
    return float(rodas.error_norm(y, new, k[rodas.STAGES - 1], dyn.FLOOR, rtol))


@njit(cache=True)
def span(
    y: FloatArray, memory: FloatArray, p: FloatArray, u: FloatArray, period: float, step: float,
    rtol: float, out: FloatArray,
) -> tuple[float, float, int]:  # fmt: skip
    """Integrate over N samples in which nothing outside changes, in steps as long as they can be.

    Parameters
    ----------
    y : (13,) array
        State, see `STATES`, written in place.
    memory : (PLAYS,) array
        Of the hysteresis, written in place [A].
    p : (COUNT,) array
        Numbers, see `numbers`.
    u : (CONTROLS,) array
        What acts from outside, see `CONTROLS`.
    period, step : float
        Sampling time and step to try first [s].
    rtol : float
        Allowed relative error of a step [1].
    out : (N, 13) array
        Overwritten with the states, see `STATES`, at the samples after the first, period apart.

    Returns
    -------
    tuple of float, float, int
        Step to try next [s]; time reached [s], less than N periods where the integration failed;
        steps tried.
    """
    k = np.empty((rodas.STAGES, dyn.STATES))
    jac, matrix = np.empty((dyn.STATES, dyn.STATES)), np.empty((dyn.STATES, dyn.STATES))
    pivot = np.empty(dyn.STATES, dtype=np.int64)
    ends = np.empty((2, dyn.STATES))
    room = Room(k, jac, matrix, pivot, ends, np.empty(dyn.WORK))
    duration = len(out) * period
    t, count, fresh, sample = 0.0, 0, True, 0
    h, before, error_before = step, 0.0, 1.0
    while t < duration * (1.0 - 1e-12):
        count += 1
        if count > MOST_STEPS * len(out) or not h > rodas.SMALLEST_STEP:
            return h, t, count
        last = t + h * 1.000001 >= duration
        used = duration - t if last else h
        error = _step(y, memory, p, u, used, rtol, fresh, room)
        refused = not fresh
        fresh = False
        proposed = rodas.next_step(used, error, before, error_before)
        if error <= 1.0:
            end = duration if last else t + used
            while sample < len(out) and (sample + 1) * period <= end + 1e-9 * period:
                share = ((sample + 1) * period - t) / used
                rodas.inside(y, ends[1], k, min(share, 1.0), out[sample])
                sample += 1
            t = end
            y[:] = ends[1]
            hysteresis.remember(y[dyn.IS], memory, p[num.REACH])
            fresh = True
            before, error_before = used, error
            if refused:
                proposed = min(proposed, used)
            h = max(h, proposed) if last else proposed
        else:
            h = proposed
    return h, t, count


@njit(cache=True)
def advance(
    y: FloatArray, memory: FloatArray, p: FloatArray, u: FloatArray, duration: float, step: float,
    rtol: float,
) -> tuple[float, float, int]:  # fmt: skip
    """Integrate over one interval of `duration` [s]; other parameters and results as `span`."""
    return span(y, memory, p, u, duration, step, rtol, np.empty((1, dyn.STATES)))


@njit(cache=True)
def simulate(
    y: FloatArray, memory: FloatArray, p: FloatArray, wanted: FloatArray, period: float,
    rtol: float, out: FloatArray,
) -> int:  # fmt: skip
    """Simulate the closed loop over a record; return how many samples it reached.

    Parameters
    ----------
    y, memory : (13,), (PLAYS,) arrays
        State, see `STATES`, and memory of the hysteresis [A] at the first sample, written in
        place.
    p : (COUNT,) array
        Numbers, see `numbers`.
    wanted : (N,) array
        Desired position, held from each sample to the next [m].
    period, rtol : float
        Sampling time [s] and allowed relative error of a step [1].
    out : (N, 13) array
        Overwritten with the state, see `STATES`, at every sample; NaN from where the integration
        failed.
    """
    count = len(wanted)
    u = np.zeros(dyn.CONTROLS)
    u[dyn.FED_BACK] = np.nan
    out[0] = y
    h, first = FIRST_STEP, 0
    while first < count - 1:
        last = first + 1
        while last < count - 1 and wanted[last] == wanted[first]:
            last += 1
        u[dyn.WANTED] = wanted[first]
        h, reached, _ = span(
            y, memory, p, u, period, min(h, period), rtol, out[first + 1 : last + 1]
        )
        if reached < (last - first) * period * (1.0 - 1e-9):
            out[first + 1 :] = np.nan
            return first + 1
        first = last
    return count


@njit(cache=True)
def rest(position: float, p: FloatArray, y: FloatArray, memory: FloatArray) -> bool:
    """Write the state at rest about a position of the piston; False if it does not settle.

    The loops are left to settle there.

    Parameters
    ----------
    position : float
        Position of the piston, from the middle of the stroke [m].
    p : (COUNT,) array
        Numbers, see `numbers`.
    y : (13,) array
        Overwritten with the state, see `STATES`.
    memory : (PLAYS,) array
        What the motor remembers before, written in place [A].
    """
    y[:] = 0.0
    ratio = p[num.AREA_2] / (p[num.AREA_1] + p[num.AREA_2])
    y[dyn.XP] = position
    y[dyn.TH] = np.arcsin(min(max(position / p[num.ARM], -1.0), 1.0))
    y[dyn.PLS], y[dyn.PLR] = p[num.PS], p[num.PR]
    y[dyn.P1], y[dyn.P2] = (
        p[num.PR] + ratio * (p[num.PS] - p[num.PR]),
        p[num.PS] - ratio * (p[num.PS] - p[num.PR]),
    )
    u = np.zeros(dyn.CONTROLS)
    u[dyn.FED_BACK] = np.nan
    u[dyn.WANTED] = position
    _, done, _ = advance(y, memory, p, u, _SETTLE_S, FIRST_STEP, _SETTLE_RTOL)
    return bool(done >= _SETTLE_S)
