# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the armature from measured currents: one step ahead, and free.

One step ahead, an observer follows the measured position; the free run starts from it at the
beginning of a cycle and sees the currents only. Both bounce at the seats as the plant does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.types import Validity
from valve_twin.core.valves.hybrid_actuator.flight import advance
from valve_twin.core.valves.hybrid_actuator.magnetics import Magnetics
from valve_twin.core.valves.hybrid_actuator.plant_kernel import Armature, net_force
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.prediction import predictor, state_size
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_X, _V = 0, 1
_RUN = 2  # position [m] and speed [m/s]
_OPENER, _CLOSER = 0, 1  # last currents [A]
STATE_SIZE = state_size(_RUN, 2)

_MASS, _SPRING, _DAMPING, _TRAVEL, _RESIDUAL_GAP, _RESTITUTION, _GAS_FORCE, _GAS_LENGTH = range(8)
_KERNEL, _BETA, _KAPPA, _SATURATION_FLUX, _C1, _C2, _C3 = range(8, 15)
_MAGNET_FORCE, _MAGNET_LENGTH, _COUPLING, _COULOMB, CURRENT_SCALE, _PERIOD = range(15, 21)
N_COEFFICIENTS = 21

_SUBSTEPS = 4
_POSITION_GAIN, _SPEED_GAIN = 0.5, 0.15  # of the observer, per sample [1], assumed
_REST_SPEED = 1e-2  # slower than this after an impact is rest [m/s], assumed


def coefficients(
    a: Armature, solenoid: Magnetics, current_scale: float, period_s: float
) -> FloatArray:
    """Return the (N_COEFFICIENTS,) coefficients of `predict_block`.

    Parameters
    ----------
    a, solenoid : Armature, Magnetics
        The model in force.
    current_scale, period_s : float
        Full scale of the current signals [A] and sampling time [s].
    """
    moving = (a.mass, a.spring, a.damping, a.travel, a.residual_gap, a.restitution)
    gas, last = (a.gas_force, a.gas_length), (a.coulomb, current_scale, period_s)
    return np.array([*moving, *gas, *solenoid, *last])


@njit(cache=True)
def _seated(a: Armature, m: Magnetics, x: float, v: float, i_o: float, i_c: float) -> bool:
    if v != 0.0 or abs(x) < a.travel:
        return False
    return net_force(a, m, m, x, i_o, i_c) * x >= 0.0


@njit(cache=True)
def move(
    a: Armature,
    m: Magnetics,
    x: float,
    v: float,
    now: tuple[float, float],
    then: tuple[float, float],
    period: float,
) -> tuple[float, float]:
    """Return position and speed a sample later, seats included; currents are straight lines.

    Parameters
    ----------
    a, m : Armature, Magnetics
        The model in force.
    x, v : float
        Position, 0 = middle [m], and speed [m/s].
    now, then : tuple of float
        Currents in opener and closer at the beginning and the end [A].
    period : float
        Sampling time [s].
    """
    h = period / _SUBSTEPS
    for k in range(_SUBSTEPS):
        s, e = k / _SUBSTEPS, (k + 1) / _SUBSTEPS
        o0, o1 = now[0] + s * (then[0] - now[0]), now[0] + e * (then[0] - now[0])
        c0, c1 = now[1] + s * (then[1] - now[1]), now[1] + e * (then[1] - now[1])
        if _seated(a, m, x, v, o0, c0):
            continue
        x, v = advance(a, m, x, v, o0, o1, c0, c1, h)
        if abs(x) >= a.travel and x * v >= 0.0:
            x = a.travel if x > 0.0 else -a.travel
            v = -a.restitution * v
            if abs(v) < _REST_SPEED:
                v = 0.0
    return x, v


class _Numbers(NamedTuple):
    """Moving parts and solenoid, full scale of the currents [A] and sampling time [s]."""

    armature: Armature
    solenoid: Magnetics
    current_scale: float
    period_s: float


@njit(cache=True)
def armature_of(c: FloatArray) -> Armature:
    """Return the moving parts of coefficients (N_COEFFICIENTS,)."""
    return Armature(
        c[_MASS], c[_SPRING], c[_DAMPING], c[_TRAVEL], c[_RESIDUAL_GAP], c[_RESTITUTION],
        c[_GAS_FORCE], c[_GAS_LENGTH], 1.0, 1.0, True, c[_COULOMB],
    )  # fmt: skip


@njit(cache=True)
def solenoid_of(c: FloatArray) -> Magnetics:
    """Return either solenoid of coefficients (N_COEFFICIENTS,)."""
    return Magnetics(
        int(c[_KERNEL]), c[_BETA], c[_KAPPA], c[_SATURATION_FLUX], c[_C1], c[_C2], c[_C3],
        c[_MAGNET_FORCE], c[_MAGNET_LENGTH], c[_COUPLING],
    )  # fmt: skip


@njit(cache=True)
def _numbers(c: FloatArray) -> _Numbers:
    return _Numbers(armature_of(c), solenoid_of(c), c[CURRENT_SCALE], c[_PERIOD])


@per_sample
def _advance(
    m: _Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    a, coils = m.armature, m.solenoid
    now = (memory[_OPENER], memory[_CLOSER])
    then = now if bad else (inputs[n, 2] * m.current_scale, inputs[n, 3] * m.current_scale)
    memory[_OPENER], memory[_CLOSER] = then
    if seen == 0.0:
        return Validity.STARTING
    seated = _seated(a, coils, followed[_X], followed[_V], now[0], now[1])
    for run in (followed, free):
        run[_X], run[_V] = move(a, coils, run[_X], run[_V], now, then, m.period_s)
    return Validity.AT_SEAT if seated else Validity.VALID


@njit(cache=True)
def begun(position: float, travel: float) -> float:
    """Return where a run from a position [1] begins [m]: near a seat, on it."""
    x = (2.0 * position - 1.0) * travel
    if abs(x) > 0.98 * travel:
        return travel if x > 0.0 else -travel
    return x


@njit(cache=True)
def shown_position(x: float, travel: float) -> float:
    """Return the position that is measured [1] of one in [m]."""
    return 0.5 * (x / travel + 1.0)


@per_sample
def _shown(m: _Numbers, value: float) -> float:
    return float(shown_position(value, m.armature.travel))


@per_sample
def _follow(
    m: _Numbers, followed: FloatArray, memory: FloatArray, position: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    travel = m.armature.travel
    x = (2.0 * position - 1.0) * travel
    if code == Validity.STARTING:
        followed[_X], followed[_V] = begun(position, travel), 0.0
        return code
    off = x - followed[_X]
    resting = abs(followed[_X]) >= travel and followed[_V] == 0.0
    if not (resting and abs(off) < 0.02 * travel):
        followed[_X] = min(max(followed[_X] + _POSITION_GAIN * off, -travel), travel)
        followed[_V] += _SPEED_GAIN * off / m.period_s
    return code


predict_block = predictor(_advance, _follow, run=_RUN, numbers=_numbers, output=_X, shown=_shown)
