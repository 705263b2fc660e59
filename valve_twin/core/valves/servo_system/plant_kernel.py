# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled run of the simulated servosystem from sample to sample, and what its sensors give."""

from __future__ import annotations

from math import cos, nan, sin, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.physics.hysteresis import PLAYS
from valve_twin.core.simulation.noise import normal_at
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import numbers as num
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, advance
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.simulation.plant import Forcing, Response
    from valve_twin.core.types import FloatArray

INPUTS = (
    "desired_position",
    "current",
    "valve_position",
    "supply_line_pressure",
    "pressure_1",
    "pressure_2",
    "return_line_pressure",
    "load_position",
    "load_speed",
)
"""Signals besides the piston's position, in parts of their full scales."""

POSITION, FIRST = 0, 1
MEMORY = FIRST + dyn.STATES
STEP, TIME, READ, FAILED, SAMPLES = range(MEMORY + PLAYS, MEMORY + PLAYS + 5)
STATE_SIZE = MEMORY + PLAYS + 5
"""Position [1], the 13 states, the motor's memory [A], next step [s], time [s], position that the
controller has read [m], whether the integration failed, samples so far."""


class Sensors(NamedTuple):
    """Full scales of the sensors, their noise and steps in parts of them."""

    current: float
    valve: float
    pressure: float
    return_pressure: float
    speed: float
    noise: float
    quantum: float
    seed: int


@njit(cache=True)
def scaled(y: FloatArray, p: FloatArray, s: Sensors, out: FloatArray) -> None:
    """Write what ideal sensors give of a state: `INPUTS` but the desired position.

    Parameters
    ----------
    y : (13,) array
        State, see `STATES`.
    p : (COUNT,) array
        Numbers, see `numbers`.
    s : Sensors
        Full scales.
    out : (8,) array
        Overwritten [1].
    """
    sine, cosine = sin(y[dyn.TH]), cos(y[dyn.TH])
    out[0] = y[dyn.IS] / s.current
    out[1] = y[dyn.XV] / s.valve
    out[2] = y[dyn.PLS] / s.pressure
    out[3] = y[dyn.P1] / s.pressure
    out[4] = y[dyn.P2] / s.pressure
    out[5] = y[dyn.PLR] / s.return_pressure
    out[6] = p[num.ARM] * sine / p[num.STROKE] + 0.5
    out[7] = p[num.ARM] * y[dyn.OM] * cosine / s.speed


@njit(cache=True)
def _read(state: FloatArray, p: FloatArray, s: Sensors, out: FloatArray) -> None:
    """Write what the sensors give now, (8,), with noise and steps."""
    scaled(state[FIRST:MEMORY], p, s, out)
    index = int(state[SAMPLES]) * len(out)
    for j in range(len(out)):
        if s.noise > 0.0:
            out[j] += s.noise * normal_at(s.seed, index + j)
        if s.quantum > 0.0:
            out[j] = s.quantum * np.round(out[j] / s.quantum)


@njit(cache=True)
def run_plant(
    state: FloatArray,
    p: FloatArray,
    sensors: Sensors,
    rtol: float,
    period: float,
    forcing: Forcing,
    out: Response,
) -> None:
    """Run N samples in place.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    p : (COUNT,) array
        Numbers, see `numbers`.
    sensors : Sensors
        What the sensors make of the state.
    rtol, period : float
        Allowed relative error of a step [1], sampling time [s].
    forcing : Forcing
        What acts on it: the reference, or the first command from outside, is the desired position
        [1], process noise moves piston and load, the leak goes from chamber 1 to return, stroke a
        second at the whole pressure drop [1/s], and the valve pipe sticks.
    out : Response
        Overwritten: position of the piston (N,), desired position and sensors (N, 9) [1].
    """
    y, memory = state[FIRST:MEMORY], state[MEMORY:STEP]
    reference, _, external, commands, disturbance, leak_rate, stuck, frozen, _, _ = forcing
    position, inputs = out
    u = np.zeros(dyn.CONTROLS)
    u[dyn.HELD] = 1.0 if stuck else 0.0
    u[dyn.LEAK] = leak_rate * p[num.STROKE] * p[num.AREA_1] / sqrt(p[num.PS] - p[num.PR])
    stroke = p[num.STROKE]
    for n in range(len(position)):
        wanted = commands[n, 0] if external else reference[n]
        position[n], inputs[n, 0] = nan, wanted
        inputs[n, 1:] = nan
        if state[FAILED] > 0.0:
            continue
        position[n] = state[POSITION]
        _read(state, p, sensors, inputs[n, 1:])
        if not frozen:
            state[READ] = y[dyn.XP]
        u[dyn.FED_BACK] = state[READ] if frozen else nan
        u[dyn.WANTED] = (wanted - 0.5) * stroke
        if stuck:
            y[dyn.VV] = 0.0
        h, reached, _ = advance(y, memory, p, u, period, max(state[STEP], FIRST_STEP), rtol)
        state[STEP] = h
        state[TIME] += reached
        state[SAMPLES] += 1.0
        if reached < period * (1.0 - 1e-9) or not np.isfinite(y).all():
            state[FAILED] = 1.0
            continue
        y[dyn.XP] += disturbance[n] * stroke
        y[dyn.TH] += disturbance[n] * stroke / p[num.ARM]
        state[POSITION] = y[dyn.XP] / stroke + 0.5
