# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Motion of the strangers in fixed steps of time; nothing here is shared with the simulators.

spool      tau x' = u - x - friction, friction of Karnopp without mass, speed limited both ways
pneumatic  x'' / w^2 = p - x - (2 z / w) x' - friction; p filled from a supply and exhausted by a
           pilot that opens with what the position lacks beyond a dead band
cylinder   a controller opens a valve, 0.5 = closed; beyond its dead band the speed follows the
           opening, by the root of the pressure that the load leaves

Positions are parts of the stroke; semi-implicit Euler.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

STEP_S = 0.002
"""Step of the integration [s]."""

SPOOL, PNEUMATIC, CYLINDER = 0, 1, 2
KINDS = ("spool", "pneumatic", "cylinder")

_STANDS = 1e-3
"""Speed below which a pneumatic stem may be held by friction [1/s]."""

_SUPPLY = 1.5
"""Supply of the pneumatic drive over the force that opens its spring fully [1]."""


class Valve(NamedTuple):
    """Numbers of a stranger; what does not belong to its kind is not used.

    Attributes
    ----------
    kind : int
        `SPOOL`, `PNEUMATIC` or `CYLINDER`.
    lag_s, delay_s : float
        Time constant of spool, pilot or control valve; dead time of the command [s].
    up, down : float
        Greatest speed of a spool, filling and exhausting of a drive, speed per opening of a
        cylinder [1/s].
    dead : float
        Half width of the dead band [1].
    breakaway, coulomb : float
        Friction at rest and in motion, in strokes of the spring or openings [1].
    gain : float
        Of the pilot or of the controller [1].
    omega, damping : float
        Natural frequency of the stem [rad/s] and its damping ratio [1].
    load : float
        Share of the supply pressure that the load takes [1].
    low, high : float
        End stops [1].
    hunting, wave : float
        Amplitude [1] and angular frequency [rad/s] of an oscillation.
    """

    kind: int
    lag_s: float
    delay_s: float
    up: float
    down: float
    dead: float
    breakaway: float
    coulomb: float
    gain: float
    omega: float
    damping: float
    load: float
    low: float
    high: float
    hunting: float
    wave: float


@njit(cache=True)
def run(
    state: FloatArray,
    valve: Valve,
    wanted: FloatArray,
    lost: FloatArray,
    past: FloatArray,
    tick: int,
) -> tuple[FloatArray, FloatArray]:
    """Advance a stranger over some wanted positions.

    Parameters
    ----------
    state : (4,) array
        Position [1], speed [1/s], pressure or opening, last command [1]; changed in place.
    valve : Valve
        Its numbers.
    wanted : (N,) array
        Wanted position at each step [1].
    lost : (N,) array
        Not 0 where the command does not arrive [1].
    past : (P,) array
        Commands of the steps before, more than the dead time [1].
    tick : int
        Steps between two commands.

    Returns
    -------
    (N,) array
        Position [1].
    (N,) array
        Command as it was sent [1].
    """
    n, p = len(wanted), len(past)
    sent = np.empty(p + n)
    sent[:p] = past
    place = np.empty(n)
    late = round(valve.delay_s / STEP_S)
    for k in range(n):
        u = sent[p + k - 1]
        if k % tick == 0:
            u = wanted[k]
            if valve.kind == CYLINDER:
                u = 0.5 + 0.5 * min(max(valve.gain * (wanted[k] - state[0]), -1.0), 1.0)
        sent[p + k] = u
        if lost[k] == 0.0:
            state[3] = sent[p + k - late]
        elif valve.kind == CYLINDER:
            state[3] = 0.5
        swing = valve.hunting * np.sin(valve.wave * k * STEP_S)
        if valve.kind == SPOOL:
            _spool(state, valve, state[3] + swing)
        elif valve.kind == PNEUMATIC:
            _pneumatic(state, valve, state[3] + swing)
        else:
            _cylinder(state, valve, 2.0 * state[3] - 1.0, swing)
        place[k] = state[0]
    return place, sent[p:]


@njit(cache=True)
def _spool(s: FloatArray, v: Valve, u: float) -> None:
    drive = u - s[0]
    grip = v.coulomb if s[1] != 0.0 else v.breakaway
    grip += v.dead
    if abs(drive) <= grip:
        s[1] = 0.0
        return
    speed = (drive - np.sign(drive) * (v.coulomb + v.dead)) / v.lag_s
    s[1] = min(max(speed, -v.down), v.up)
    s[0] = min(max(s[0] + STEP_S * s[1], v.low), v.high)


@njit(cache=True)
def _pneumatic(s: FloatArray, v: Valve, u: float) -> None:
    lacks = u - s[0]
    if u >= 0.995:  # the pilot stays open: the stem is pressed on its stop
        lacks = 1.0
    elif u <= 0.005:
        lacks = -1.0
    opening = 0.0
    if abs(lacks) > v.dead:
        opening = v.gain * (lacks - np.sign(lacks) * v.dead)
    opening = min(max(opening, -1.0), 1.0)
    flow = v.up * (_SUPPLY - s[2]) if opening > 0.0 else v.down * (s[2] + 0.2)
    s[2] = min(max(s[2] + STEP_S * opening * flow, -0.2), _SUPPLY)
    force = s[2] - s[0]
    if abs(s[1]) < _STANDS and abs(force) <= v.breakaway:
        s[1] = 0.0
        return
    way = np.sign(s[1]) if abs(s[1]) >= _STANDS else np.sign(force)
    force -= way * v.coulomb + 2.0 * v.damping / v.omega * s[1]
    before = s[1]
    s[1] += STEP_S * v.omega * v.omega * force
    if before * s[1] < 0.0 and abs(s[2] - s[0]) <= v.breakaway:
        s[1] = 0.0
    s[0] += STEP_S * s[1]
    if s[0] <= v.low or s[0] >= v.high:
        s[0] = min(max(s[0], v.low), v.high)
        s[1] = 0.0


@njit(cache=True)
def _cylinder(s: FloatArray, v: Valve, u: float, swing: float) -> None:
    s[2] += STEP_S / v.lag_s * (u - s[2])
    opening = s[2]
    if swing != 0.0:
        opening += np.sign(swing) * v.dead + swing * v.wave / (0.5 * (v.up + v.down))
    grip = v.dead + (v.coulomb if s[1] != 0.0 else v.breakaway)
    if abs(opening) <= grip:
        s[1] = 0.0
        return
    if opening > 0.0:
        s[1] = v.up * (opening - v.dead) * np.sqrt(1.0 - v.load)
    else:
        s[1] = v.down * (opening + v.dead) * np.sqrt(1.0 + v.load)
    s[0] = min(max(s[0] + STEP_S * s[1], v.low), v.high)
