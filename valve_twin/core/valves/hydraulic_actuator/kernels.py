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

from math import exp
from typing import NamedTuple

import numpy as np

from valve_twin.core.types import FloatArray, Validity
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.prediction import predictor, state_size
from valve_twin.kernels import njit

N_PARAMETERS = 9
"""In the order of `PARAMETERS`; the sampling time follows them in the coefficients."""

_LIFT, _LOWER, _HALF_LIFT, _HALF_LOWER, _PROGRESSIVITY = 0, 1, 2, 3, 4
_RESONANCE, _THROTTLING_LIFT, _THROTTLING_LOWER, _LAG, _PERIOD = 5, 6, 7, 8, 9

_SUBSTEPS = 2  # of a sample: resonance up to 1 / period is integrated to 1e-3, assumed
_STIFF = 1.5  # of a substep: Runge-Kutta steps of order 4 are stable up to 2.7, assumed
_LARGEST = 1e6  # a run that diverges stays a number

_PRESSURE, _FLOW = 0, 1  # of a run: pressure and the flow that the load takes up
_SPOOL, _OPENING = 0, 1  # that both share: spool and last opening [1]
STATE_SIZE = state_size(2, 2)

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
def _stiffness(w: float, h: float, c: FloatArray) -> float:
    """Return by how much the throttling damps a small change of `w` over `h` [1]."""
    throttling = c[_THROTTLING_LIFT] if w > 0.0 else c[_THROTTLING_LOWER]
    return float(2.0 * h * c[_RESONANCE] ** 2 * throttling * abs(w))


@njit(cache=True)
def _throttled(w: float, h: float, c: FloatArray) -> float:
    """Return what throttling alone leaves of the load flow after `h` [s], exactly."""
    return float(w / (1.0 + 0.5 * _stiffness(w, h, c)))


@njit(cache=True)
def _bounded(value: float) -> float:
    return float(min(max(value, -_LARGEST), _LARGEST))


@njit(cache=True)
def _oil_and_load(
    p: float, w: float, q0: float, q1: float, q2: float, h: float, c: FloatArray
) -> tuple[float, float]:
    """Advance pressure and load flow by `h` [s]; the flow at begin, middle and end is given.

    Where the throttling is stiff a Runge-Kutta step would run away, though the load only loses
    energy; there the throttling's own law is taken as it is and the rest in between.
    """
    half, without = 0.5 * h, c[_RESONANCE] ** 2
    slow = _throttled(w, half, c)
    pm, wm = p + half * (q0 - slow), slow + half * without * p
    pe, we = p + h * (q1 - wm), _throttled(slow + h * without * pm, half, c)
    if max(_stiffness(w, h, c), _stiffness(we, h, c)) > _STIFF:
        return _bounded(pe), _bounded(we)
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


class _Numbers(NamedTuple):
    """Coefficients, see `free_run`, and room for the flows over a sample."""

    c: FloatArray
    q: FloatArray


@njit(cache=True)
def _numbers(c: FloatArray) -> _Numbers:
    return _Numbers(c, np.empty(2 * _SUBSTEPS + 1))


@per_sample
def _advance_runs(
    m: _Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    before = memory[_OPENING]
    now = before if bad else inputs[n, 0]
    memory[_OPENING] = now
    ready = seen > 0.0
    if ready:
        memory[_SPOOL] = _flows(memory[_SPOOL], before, now, m.c, m.q)
        for run in (followed, free):
            run[_PRESSURE], run[_FLOW] = _advance(run[_PRESSURE], run[_FLOW], m.q, m.c)
    return Validity.VALID if ready else Validity.STARTING


@per_sample
def _follow(
    m: _Numbers, followed: FloatArray, memory: FloatArray, pressure: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    """Correct the load flow, which is not measured, by what the pressure did otherwise."""
    if code == Validity.STARTING:
        memory[_SPOOL], followed[_FLOW] = memory[_OPENING], 0.0
    else:
        error = pressure - followed[_PRESSURE]
        followed[_FLOW] = _bounded(followed[_FLOW] - _CORRECTION * error / m.c[_PERIOD])
    followed[_PRESSURE] = pressure
    return code


predict_block = predictor(_advance_runs, _follow, run=2, numbers=_numbers, at_once=True)
