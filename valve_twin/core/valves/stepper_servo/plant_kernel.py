# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled recursion of the simulated stepper valve: one base sample of the controller a tick."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.control.stepper import stepper_step
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.control.stepper import StepperSettings
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

MAX_WINDOW = 256
"""Longest moving average of the sensor [ticks]."""

SENSED, SPOOL, COUNT, ROTOR, OWED, FLOW, HEAD, CONTROL = range(8)
LINE = CONTROL + 3
STATE_SIZE = LINE + MAX_WINDOW
"""Sensed and true position [1], counted and true rotor steps, part of a lost step, metered flow
[1], head of the moving average, controller (3), content of the moving average [1]."""


class Valve(NamedTuple):
    """Numbers of the plant as the kernel takes them; positions in parts of the stroke [1]."""

    step: float
    counted: float
    backlash: float
    lost_share: float
    band_lower: float
    band_upper: float
    full_lower: float
    full_upper: float
    flow_full: float
    flow_share: float
    volts: float
    window: int
    edge_power: float
    backlash_taper: float


@njit(cache=True)
def flow_opening(
    x: float, band_lower: float, band_upper: float, full_lower: float, full_upper: float
) -> float:
    """Return the flow over its greatest [1]: 0 in the dead band, straight outside, saturated.

    Paper 004, Fig. 5: closed from 0.45 to 1.70 mm, saturated from 0.2 and 1.9 mm on. The straight
    line between is assumed.

    Parameters
    ----------
    x : float
        Spool position [1].
    band_lower, band_upper : float
        Edges of the dead band [1].
    full_lower, full_upper : float
        Positions from which the flow is saturated [1].
    """
    if x < band_lower:
        return float(min((band_lower - x) / (band_lower - full_lower), 1.0))
    if x > band_upper:
        return float(min((x - band_upper) / (full_upper - band_upper), 1.0))
    return 0.0


@njit(cache=True)
def play(x: float, middle: float, backlash: float) -> float:
    """Return the spool behind a thread with backlash: it moves only where a flank pushes it [1].

    Parameters
    ----------
    x : float
        Spool position before [1].
    middle : float
        Middle of the play [1].
    backlash : float
        Width of the play [1].
    """
    return float(min(max(x, middle - 0.5 * backlash), middle + 0.5 * backlash))


@njit(cache=True)
def _turn(state: FloatArray, v: Valve, steps: int, stuck: bool) -> None:
    """Count the steps and turn the rotor, unless it slips or the spool holds it."""
    if steps == 0:
        return
    state[COUNT] += steps
    if steps > 0:
        state[OWED] += v.lost_share
        if state[OWED] >= 1.0:
            state[OWED] -= 1.0
            return
    rotor = state[ROTOR] + steps
    held = stuck and abs(rotor * v.step - state[SPOOL]) > 0.5 * v.backlash
    reach = -0.5 * v.backlash <= rotor * v.step <= 1.0 + 0.5 * v.backlash
    if reach and not held:
        state[ROTOR] = rotor


@njit(cache=True)
def _sense(state: FloatArray, v: Valve, frozen: bool) -> None:
    """Move the sensor's average on by one tick."""
    if frozen:
        return
    head = int(state[HEAD])
    state[LINE + head] = state[SPOOL]
    state[HEAD] = (head + 1) % v.window
    total = 0.0
    for i in range(v.window):
        total += state[LINE + i]
    state[SENSED] = total / v.window


@njit(cache=True)
def run_plant(
    state: FloatArray,
    v: Valve,
    controller: StepperSettings,
    tick_s: float,
    ticks: int,
    forcing: Forcing,
    out: Response,
) -> None:
    """Run N samples of `ticks` ticks, in place.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    v, controller : Valve, StepperSettings
        Numbers of the plant and of its controller.
    tick_s, ticks : float, int
        Base sample [s], base samples a sample.
    forcing : Forcing
        What acts on it: the reference of the position, or as the first command from outside that
        of the motor [1]; process noise and leak move the spool inside the backlash.
    out : Response
        Overwritten: sensed position (N,) [1]; counted motor position, metered flow (N, 2) [1].
    """
    reference, _, outside, commands, disturbance, leak_rate, stuck, frozen, _, _ = forcing
    position, inputs = out
    for n in range(len(position)):
        position[n] = state[SENSED]
        inputs[n, 0] = state[COUNT] * v.counted
        inputs[n, 1] = state[FLOW]
        for k in range(ticks):
            if outside:
                missing = commands[n, 0] - state[COUNT] * v.counted
                steps = int(np.sign(missing)) if abs(missing) > 0.5 * v.counted else 0
            else:
                error = v.volts * (reference[n * ticks + k] - state[SENSED])
                steps = stepper_step(state[CONTROL:LINE], controller, error)
            _turn(state, v, steps, stuck)
            if not stuck:
                x = state[SPOOL] - leak_rate * tick_s
                if steps != 0:
                    x += disturbance[n] / ticks
                slack = v.backlash * (1.0 + v.backlash_taper * (x - 0.5))
                x = play(x, state[ROTOR] * v.step, slack)
                state[SPOOL] = min(max(x, 0.0), 1.0)
            _sense(state, v, frozen)
            opening = flow_opening(
                state[SPOOL], v.band_lower, v.band_upper, v.full_lower, v.full_upper
            )
            if v.edge_power != 1.0:
                opening = opening**v.edge_power
            state[FLOW] += v.flow_share * (v.flow_full * opening - state[FLOW])
