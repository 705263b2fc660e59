# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursions of the stepper valve's identification: thread with backlash, flow meter.

The spool stands behind a thread with play: with m the counted motor position, delayed,

    x(t) = clip(x(t-1), m - backlash/2 + o, m + backlash/2 + o),   o = offset - lost_share * up

where `up` is the way the motor has gone upwards since the start of the cycle: a step that slips
takes the spool's offset with it.
"""

from __future__ import annotations

from math import exp, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.stepper_servo.plant_kernel import flow_opening, play
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

BACKLASH, OFFSET, LOST, DELAY = range(4)
N_PARAMETERS = 4
"""backlash [1], offset at the start [1], lost share [1], delay [samples]."""


@njit(cache=True)
def delayed(motor: FloatArray, n: int, delay: float) -> tuple[float, float]:
    """Return the motor position some samples before n [1], and its derivative to the delay.

    Parameters
    ----------
    motor : (N,) array
        Counted motor position [1].
    n : int
        Index of the sample.
    delay : float
        Delay, not necessarily whole [samples].
    """
    whole = int(delay)
    part = delay - whole
    late, later = motor[max(n - whole, 0)], motor[max(n - whole - 1, 0)]
    return float(late + part * (later - late)), float(later - late)


@njit(cache=True)
def run_play(
    p: FloatArray, motor: FloatArray, start: float, simulated: FloatArray, jacobian: FloatArray
) -> tuple[int, int, float]:
    """Simulate the spool behind its thread.

    Parameters
    ----------
    p : (4,) array
        See `N_PARAMETERS`.
    motor : (N,) array
        Counted motor position [1].
    start : float
        Spool position at the first sample [1].
    simulated, jacobian : (N,), (N, 4) arrays
        Overwritten with the position [1] and its derivatives [1 over units of `p`].

    Returns
    -------
    tuple of int, int, float
        Samples in which the lower and the upper flank pushed, and the way upwards [1].
    """
    half = 0.5 * p[BACKLASH]
    before, _ = delayed(motor, 0, p[DELAY])
    x, up = start, 0.0
    pushed_up, pushed_down = 0, 0
    slope = np.zeros(N_PARAMETERS)
    for n in range(len(motor)):
        m, by_delay = delayed(motor, n, p[DELAY])
        up += max(m - before, 0.0)
        middle = m + p[OFFSET] - p[LOST] * up
        side = 0.0
        if x < middle - half:
            x, side = middle - half, -1.0
        elif x > middle + half:
            x, side = middle + half, 1.0
        if side != 0.0:
            slope[BACKLASH] = 0.5 * side
            slope[OFFSET] = 1.0
            slope[LOST] = -up
            slope[DELAY] = by_delay
            pushed_up += side < 0.0 and m > before
            pushed_down += side > 0.0 and m < before
        else:
            slope[DELAY] = 0.0
        before = m
        simulated[n] = x
        jacobian[n] = slope
    return pushed_up, pushed_down, up


@njit(cache=True)
def normal_equations(
    residual: FloatArray,
    used: BoolArray,
    jacobian: FloatArray,
    gradient: FloatArray,
    hessian: FloatArray,
) -> float:
    """Accumulate the Gauss-Newton equations of a residual; return r^T r [1].

    Parameters
    ----------
    residual : (N,) array
        Measured minus simulated, r [1].
    used : (N,) bool array
        Samples that carry weight.
    jacobian : (N, P) array
        Derivatives J of what was simulated [1 over units of the parameters].
    gradient, hessian : (P,), (P, P) arrays
        Overwritten with J^T r and J^T J [1 over units of the parameters].
    """
    gradient[:] = 0.0
    hessian[:] = 0.0
    cost = 0.0
    size = len(gradient)
    for n in range(len(residual)):
        if not used[n]:
            continue
        cost += residual[n] * residual[n]
        for j in range(size):
            gradient[j] += jacobian[n, j] * residual[n]
            for k in range(size):
                hessian[j, k] += jacobian[n, j] * jacobian[n, k]
    return cost


@njit(cache=True)
def run_flow(q: FloatArray, position: FloatArray, start: float, metered: FloatArray) -> None:
    """Simulate the metered flow of a spool at known positions.

    Parameters
    ----------
    q : (6,) array
        Lower and upper edge of the dead band, widths of the lower and upper slope, full flow [1],
        time constant of the meter [samples].
    position : (N,) array
        Spool position [1].
    start : float
        Metered flow at the first sample [1].
    metered : (N,) array
        Overwritten with the flow [1].
    """
    kept = exp(-1.0 / max(q[5], 1e-3))
    f, before = start, nan
    for n in range(len(position)):
        opening = flow_opening(position[n], q[0], q[1], q[0] - q[2], q[1] + q[3])
        if n > 0:
            f = kept * f + (1.0 - kept) * q[4] * 0.5 * (opening + before)
        before = opening
        metered[n] = f


@njit(cache=True)
def play_step(last: float, m: float, backlash: float, offset: float) -> float:
    """Return where the thread leaves a spool [1].

    Parameters
    ----------
    last : float
        Spool position before [1].
    m, backlash, offset : float
        Counted motor position, play of the thread, spool minus motor position [1].
    """
    return float(play(last, m + offset, backlash))
