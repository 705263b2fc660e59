# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Positioner, air chamber, servomotor and rod of the DAMADICS actuator with its 19 faults.

Transcribed from the actuator library of the benchmark, version 1.22 (block diagram): fixed steps
of 2.5 ms, Runge-Kutta of the fourth order, what the library's memory blocks hold is of the step
before. Position 0 = open, 1 = closed.
"""

from __future__ import annotations

from math import asin, pi, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.valves.damadics.fluid import (
    bypass_flow,
    look_up,
    relative_coefficient,
    rod_force,
    valve_flow,
    vapour_pressure,
)
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

STEP_S = 0.0025
"""Step of the integration [s]."""
STROKE = 0.0381
"""Nominal stroke [m]."""
FAULTS = 19
"""Number of faults; their vector has an unused element 0, so that element k is fault k."""

_HOLD = 14  # steps that the controller's output is held
_FILTER = STEP_S / 0.30  # step per time constant of each of the two lags
_DECAY = float(np.exp(-_FILTER))
_GAS = 287.0 * 293.0  # [J/kg]
_ATMOSPHERE = 101325.0  # [Pa]
_V0 = 0.0055  # dead volume [m3]
_AREA = 0.0290  # effective area of the diaphragm [m2]
_SUPPLY, _LEAST_SUPPLY = 600e3, 120e3  # relative [Pa]
_VALVE, _LEAK = 2.5e-6, 2e-6  # mass flow per root of pressure [kg/s/Pa^0.5]
_MASS, _VISCOUS, _SPRING, _PRELOAD = 2.0, 1500.0, 60892.0, 0.009525  # [kg], [N s/m], [N/m], [m]
_WEIGHT = 2.0 * 9.81  # [N]
_MOST_MASS, _MOST_PRESSURE, _MOST_SPEED = 0.1, 700e3, 0.02  # [kg], [Pa], [m/s]
_LOWEST, _HIGHEST = -0.05 * STROKE, 1.25 * STROKE  # of the servomotor [m]
_EP_AT = (-1.0, -0.94, -0.54, 0.46, 0.86, 1.0)
_EP = (-0.55, -0.55, -0.02, 0.02, 1.0, 1.0)

STATE = 18
"""Elements of the state."""
(
    LAG_1,
    LAG_2,
    DRIVE,
    AIR,
    PRESSURE,
    SPEED,
    MOTOR,
    ROD,
    RISING,
    MOTOR_BEFORE,
    ROD_BEFORE,
    PRESSURE_BEFORE,
    STOPPED,
    FED_BACK,
    FED_RISING,
    SENSED_BEFORE,
    CLOCK,
    SEEN,
) = range(STATE)


class Line(NamedTuple):
    """What acts during n steps, a value a step: (n,) each, and the temperature [C].

    `command` with its noise [1]; `p1`, `p2` [Pa]; `faults` (m, 5) rows of fault number, signed
    greatest strength [1], start, time of its rise, end [s]; `consistent` chamber or the library's.
    Not of the benchmark: `pushed` (1,) or (n / every,), what else moves the servomotor, a step
    [m]; `stuck` servomotor; `frozen` feedback.
    """

    command: FloatArray
    p1: FloatArray
    p2: FloatArray
    temperature: float
    faults: FloatArray
    consistent: bool
    pushed: FloatArray
    stuck: bool = False
    frozen: bool = False


COLUMNS = 9
(TRUE_ROD, TRUE_FLOW, OUT_P1, OUT_P2, OUT_T, OUT_AIR, OUT_SUPPLY, OUT_DRIVE, SENSED) = range(
    COLUMNS
)
"""What `run` writes: rod [1], flow [t/h], pressures [Pa], temperature [C], chamber and supply
pressure over the atmosphere [Pa], controller's output [1], rod as its sensor sees it [1]."""


@njit(cache=True)
def rest() -> FloatArray:
    """Return the state at rest: open, the chamber at the pressure of the atmosphere."""
    z = np.zeros(STATE)
    z[AIR] = _V0 * _ATMOSPHERE / _GAS
    z[PRESSURE] = _ATMOSPHERE
    z[STOPPED] = 1.0
    return z


@njit(cache=True)
def strengths(f: FloatArray, faults: FloatArray, time_s: float) -> None:
    """Write the fault vector at a time; at its start a fault is still 0.

    Parameters
    ----------
    f : (20,) array
        Overwritten with the faults that are there [1].
    faults : (m, 5) array
        Their courses, rows as in `Line`.
    time_s : float
        Time [s].
    """
    for i in range(len(faults)):
        number, most, start, rise, end = faults[i]
        now = 0.0
        if start + 1e-9 < time_s < end - 1e-9:  # the time is a product of steps
            now = most if time_s - start >= rise else most * (time_s - start) / rise
        f[int(number)] = now


@njit(cache=True)
def _play(x: float, before: float, rising: float, width: float) -> float:
    """Return what follows x with a backlash."""
    if rising > 0.0:
        return max(before, x - 0.5 * width)
    return min(before, x + 0.5 * width)


@njit(cache=True)
def _latched(x: float, before: float, rising: float) -> float:
    """Return the direction of the last motion."""
    if x == before:
        return rising
    return 1.0 if x > before else 0.0


@njit(cache=True)
def _plug(rod: float, f: FloatArray) -> float:
    """Return the position of the plug, with sediment and erosion."""
    x = min(max(rod / STROKE + 0.2 * f[2], 0.0), 1.0)
    return float(min(max(x - 0.1 * f[3], 0.0), 1.0))


@njit(cache=True)
def _upper_bound(f: FloatArray) -> float:
    """Return where the rod ends towards closing [m]."""
    upper = min(STROKE * (1.0 - 0.2 * f[2]), STROKE)
    upper = min(upper * (1.0 - f[1]), STROKE)
    return float(max(upper * (1.0 + 0.1 * f[3]), 0.0))


@njit(cache=True)
def _sensed(rod: float, f: FloatArray) -> float:
    """Return the rod as its sensor sees it [m]."""
    return float(rod * (1.0 + 1.25 * f[13]))


@njit(cache=True)
def _feedback(z: FloatArray, rod: float, f: FloatArray) -> float:
    """Return the position that the controller sees [1]."""
    x = min(max(_sensed(rod, f), -0.25 * STROKE), 1.25 * STROKE)
    x = min(max(x, -0.01), 0.05)
    z[FED_RISING] = _latched(x, z[SENSED_BEFORE], z[FED_RISING])
    z[FED_BACK] = _play(x, z[FED_BACK], z[FED_RISING], STROKE * f[15])
    z[SENSED_BEFORE] = x
    sine = min(max((z[FED_BACK] - 0.5 * STROKE) / STROKE, -1.0), 1.0)
    return 0.5 + asin(sine) * (180.0 / pi) / 60.0


@njit(cache=True)
def _supply(f: FloatArray) -> float:
    """Return the supply pressure over the atmosphere [Pa]."""
    return float(_SUPPLY * (1.0 - f[16]))


@njit(cache=True)
def _air_flow(z: FloatArray, f: FloatArray) -> float:
    """Return the mass flow into the chamber [kg/s]."""
    cvp = look_up(z[DRIVE], _EP_AT, _EP) * (1.0 - f[12])
    cvp = min(max(cvp, -1.0), 1.0)
    supply = _supply(f)
    target = supply if cvp > 0.0 and supply >= _LEAST_SUPPLY else 0.0
    drop = target - z[PRESSURE_BEFORE]
    flow = _VALVE * abs(cvp) * sqrt(abs(drop)) * (1.0 if drop >= 0.0 else -1.0)
    return float(flow - 0.1 * (f[9] + f[10]) * _LEAK * sqrt(abs(z[PRESSURE_BEFORE])))


@njit(cache=True)
def step(z: FloatArray, p1: float, p2: float, f: FloatArray, consistent: bool) -> None:
    """Advance the state behind the controller by one step.

    Parameters
    ----------
    z : (18,) array
        State; rod, direction and drive are of now already [unit by element].
    p1, p2 : float
        Pressures before, not below the vapour pressure, and behind the valve [Pa].
    f : (20,) array
        Faults [1].
    consistent : bool
        Chamber by its mass alone; else mass and pressure by themselves, as in the library.
    """
    width = _friction(z, f)
    upper = _upper_bound(f)
    y, rising = z[ROD], z[RISING]
    at_top = upper <= max(0.0, y)
    stopped = 1.0 if z[ROD_BEFORE] <= 0.0 or at_top else 0.0
    if stopped != z[STOPPED]:
        z[SPEED] = 0.0
    z[STOPPED] = stopped
    at_bottom = z[ROD_BEFORE] <= 0.0
    area = _AREA * (1.0 - f[10])
    spring = _SPRING * (1.0 - f[11]) * (z[ROD_BEFORE] + _PRELOAD)
    net = _air_flow(z, f)
    air, pressure, speed, motor = z[AIR], z[PRESSURE], z[SPEED], z[MOTOR]
    dp, dv, dx = 0.0, 0.0, 0.0  # slopes of the stage before
    sum_p, sum_v, sum_x = 0.0, 0.0, 0.0
    for stage in range(4):
        part = 0.0 if stage == 0 else (STEP_S if stage == 3 else 0.5 * STEP_S)
        weight = 1.0 if stage in (0, 3) else 2.0
        m = air + part * net
        v = speed + part * dv
        x = motor + part * dx
        rod = min(max(_play(x, y, rising, width), 0.0), upper)
        volume = _V0 + area * rod
        if consistent:
            p = min(max(m * _GAS / volume, 0.0), _MOST_PRESSURE)
        else:
            p = pressure + part * dp
            dp = p * (net * volume / m - area * min(max(v, -_MOST_SPEED), _MOST_SPEED)) / volume
        force = _WEIGHT + area * (p - _ATMOSPHERE) - rod_force(_plug(rod, f), p1, p2)
        force -= spring + _VISCOUS * v
        if (force <= 0.0 and at_bottom) or (force > 0.0 and at_top):
            force = 0.0
        dv = force / _MASS
        dx = v
        sum_p += weight * dp
        sum_v += weight * dv
        sum_x += weight * dx
    z[PRESSURE_BEFORE] = pressure - _ATMOSPHERE
    z[MOTOR_BEFORE] = motor
    z[ROD_BEFORE] = min(max(y, 0.0), upper)
    z[SPEED] = speed + STEP_S / 6.0 * sum_v
    z[MOTOR] = min(max(motor + STEP_S / 6.0 * sum_x, _LOWEST), _HIGHEST)
    z[AIR] = min(max(air + STEP_S * net, 0.0), _MOST_MASS)
    z[PRESSURE] = min(max(pressure + STEP_S / 6.0 * sum_p, 0.0), _MOST_PRESSURE)


@njit(cache=True)
def _of_mass(z: FloatArray, f: FloatArray) -> float:
    """Return the pressure of the air in the chamber as it follows from its mass [Pa]."""
    rising = _latched(z[MOTOR], z[MOTOR_BEFORE], z[RISING])
    rod = min(max(_play(z[MOTOR], z[ROD], rising, _friction(z, f)), 0.0), _upper_bound(f))
    volume = _V0 + _AREA * (1.0 - f[10]) * rod
    return float(min(max(z[AIR] * _GAS / volume, 0.0), _MOST_PRESSURE))


@njit(cache=True)
def _friction(z: FloatArray, f: FloatArray) -> float:
    """Return the width of the backlash between servomotor and rod [m]."""
    width = min(max(STROKE * (0.01 + f[4]), 0.0), STROKE)
    return float(
        min(max(width * (1.0 + 0.5 * f[8] * (1.0 - z[ROD_BEFORE] / STROKE)), 0.0), STROKE)
    )


@njit(cache=True)
def _write(
    out: FloatArray, z: FloatArray, rod: float, f: FloatArray, p1: float, p2: float, warm: float
) -> None:
    x = _plug(rod, f)
    kvr = relative_coefficient(x)
    kvr = min(max(kvr * (1.0 - 0.2 * f[2]), 0.0), 1.0)
    kvr = min(max(kvr * (1.0 + 0.1 * f[3]), 0.0), 1.0) + 0.1 * f[6]
    flow = valve_flow(x, kvr, p1, p2, warm) * (1.0 - 0.05 * f[5])
    out[TRUE_ROD] = rod / STROKE
    out[TRUE_FLOW] = flow + bypass_flow(f[18], p1, p2, warm)
    out[OUT_P1], out[OUT_P2], out[OUT_T] = p1, p2, warm
    out[OUT_AIR] = z[PRESSURE] - _ATMOSPHERE
    out[OUT_SUPPLY] = _supply(f)
    out[OUT_DRIVE] = z[DRIVE]
    out[SENSED] = _sensed(rod, f) / STROKE


@njit(cache=True)
def run(z: FloatArray, line: Line, every: int, out: FloatArray) -> None:
    """Advance the actuator, and write what it is at every `every`th step, before that step.

    Parameters
    ----------
    z : (18,) array
        State, written in place [unit by element].
    line : Line
        What acts during n steps.
    every : int
        Steps between two rows.
    out : (n / every, 9) array
        Overwritten; columns as `COLUMNS` [unit by column].
    """
    command, p1s, p2s, temperature, faults, consistent, pushed, stuck, frozen = line
    f = np.zeros(FAULTS + 1)
    boils, boiled = vapour_pressure(temperature), temperature
    for n in range(len(command)):
        tick = round(z[CLOCK])
        strengths(f, faults, tick * STEP_S)
        p1, p2, warm = p1s[n], p2s[n], temperature
        if f[17] > 0.0:
            p2 = min(max(p2 * (1.0 - f[17]), 0.0), 4e6)
        else:
            p1 = min(max(p1 * (1.0 - abs(f[17])), 0.0), 4e6)
        if f[7] > 0.0:
            warm = min(max(min(max(warm, 0.0), 200.0) + 200.0 + 100.0 * f[7], 0.0), 300.0)
        z[RISING] = _latched(z[MOTOR], z[MOTOR_BEFORE], z[RISING])
        z[ROD] = _play(z[MOTOR], z[ROD], z[RISING], _friction(z, f))
        rod = min(max(z[ROD], 0.0), _upper_bound(f))
        if not frozen:
            z[SEEN] = _feedback(z, rod, f)
        if tick % _HOLD == 0:
            z[DRIVE] = min(max(100.0 * (z[LAG_2] - z[SEEN]), -1.0), 1.0)
        if n % every == 0:
            _write(out[n // every], z, rod, f, p1, p2, warm)
        if warm != boiled:
            boils, boiled = vapour_pressure(warm), warm
        motor = z[MOTOR]
        step(z, max(p1, boils), p2, f, consistent)
        z[MOTOR] += pushed[min(n // every, len(pushed) - 1)]
        if stuck:
            z[MOTOR], z[SPEED] = motor, 0.0
        if consistent:
            z[PRESSURE] = _of_mass(z, f)
        u = min(max(command[n], 0.0), 1.024)
        z[LAG_2] = u + ((z[LAG_2] - u) + (z[LAG_1] - u) * _FILTER) * _DECAY
        z[LAG_1] = u + (z[LAG_1] - u) * _DECAY
        z[CLOCK] = tick + 1.0
