# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the spool from measured currents: one step ahead, and free.

One step ahead, an observer follows the measured position; the free run starts from it at the
beginning of a cycle and sees the currents only. Near an end the magnets pull harder than the
springs push, so a free run at a held current drifts away by itself.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from valve_twin.core.physics.coenergy_tables import FORCE_NODES, PLACE_NODES, CoenergyTables
from valve_twin.core.physics.curves import force_of
from valve_twin.core.physics.solenoid_map import (
    CURRENT_NODES,
    FLUX_NODES,
    POSITION_NODES,
    MapTables,
)
from valve_twin.core.types import Restart, Validity
from valve_twin.core.valves.double_solenoid.motion import SUB
from valve_twin.core.valves.double_solenoid.plant_kernel import (
    Second,
    Valve,
    friction_force,
    spring_force,
)

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import ByteArray, FloatArray
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

_SEEN = 0
_OBSERVED, _FREE = 1, 5
STATE_SIZE = 9
"""Samples seen; position [m], speed [m/s] and both states of the force filter [N], [N/s], of the
observer and of the free run."""

_SCALARS = 23
_CURRENT_TABLE = FLUX_NODES * POSITION_NODES
_FORCE_TABLE = CURRENT_NODES * POSITION_NODES
N_COEFFICIENTS = _SCALARS + _CURRENT_TABLE + _FORCE_TABLE

_POSITION_GAIN, _SPEED_GAIN = 0.5, 0.15  # of the observer, per sample [1], assumed


def coefficients(valve: DoubleSolenoidPlant, period_s: float) -> FloatArray:
    """Return the coefficients of `predict_block` (N_COEFFICIENTS,), with a map of `predict_map`.

    Parameters
    ----------
    valve : DoubleSolenoidPlant
        The model in force.
    period_s : float
        Sampling time [s].
    """
    v, m = valve.valve(), valve.tables()
    mechanics = (v.mass, v.preload_1, v.preload_2, v.spring_1, v.spring_2)
    rubbing = (v.friction, v.alpha, v.beta, v.stop, v.half_stroke, v.force_gain)
    own: tuple[float, ...]
    tables: tuple[FloatArray, ...]
    if isinstance(m, CoenergyTables):
        own = (m.low_current, m.per_current, m.reach, m.per_position, m.largest)
        tables = (m.force,)
    else:
        own = (m.per_flux, m.per_current, m.reach, m.per_position, m.mutual)
        tables = (m.current, m.force)
    numbers = [*mechanics, *rubbing, *v.force, *own, valve.current_scale, period_s]
    assert len(numbers) == _SCALARS
    return np.concatenate([numbers, *(table.ravel() for table in tables)])


@njit(cache=True)
def _valve(c: FloatArray) -> Valve:
    second = Second(c[11], c[12], c[13], c[14], c[15])
    return Valve(
        1.0, 1.0, second, second, c[10], c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8],
        c[9], 0.0, 0.0, 0.0,
    )  # fmt: skip


@njit(cache=True)
def _tables(c: FloatArray) -> MapTables:
    a, b = _SCALARS, _SCALARS + _CURRENT_TABLE
    current = c[a:b].reshape((FLUX_NODES, POSITION_NODES))
    force = c[b : b + _FORCE_TABLE].reshape((CURRENT_NODES, POSITION_NODES))
    return MapTables(current, force, c[16], c[17], c[18], c[19], c[20])


@njit(cache=True)
def _map(c: FloatArray) -> CoenergyTables:
    force = c[_SCALARS:].reshape((FORCE_NODES, FORCE_NODES, PLACE_NODES))
    unused = force[:1]
    return CoenergyTables(
        unused, unused, force, 0.0, 0.0, c[16], 0.0, c[17], c[18], c[19], c[20]
    )  # fmt: skip


@njit(cache=True)
def _move(
    state: FloatArray, at: int, v: Valve, m: Curves, i_a: float, i_b: float, period: float
) -> None:
    """Move observer or free run by a sample with the mean currents of that sample."""
    x, speed, f1, f2 = state[at], state[at + 1], state[at + 2], state[at + 3]
    g, h = v.force, period / SUB
    for _ in range(SUB):
        static = force_of(m, i_a, i_b, x)
        force = g.out_1 * f1 + g.out_2 * f2 + g.direct * static
        f1, f2 = f1 + h * f2, f2 + h * (g.rate_1 * (static - f1) - g.rate_2 * f2)
        total = v.force_gain * force + spring_force(v, x) - friction_force(v, speed)
        x += h * speed
        speed += h * total / v.mass
        if abs(x) >= v.stop:
            x = v.stop if x > 0.0 else -v.stop
            if x * speed > 0.0:
                speed = 0.0
    state[at], state[at + 1], state[at + 2], state[at + 3] = x, speed, f1, f2


@njit(cache=True)
def _predict(
    state: FloatArray,
    v: Valve,
    m: Curves,
    last: tuple[float, float],
    signals: tuple[FloatArray, FloatArray, ByteArray],
    out: tuple[FloatArray, FloatArray, ByteArray],
) -> None:
    """Predict N samples in place; `last` holds the currents' full scale and the period."""
    scale, period = last
    position, inputs, restart = signals
    predicted, simulated, validity = out
    for n in range(len(position)):
        flag = restart[n]
        if flag == Restart.GAP:
            state[_SEEN] = 0.0
        ready = state[_SEEN] > 0.0
        bad = flag == Restart.BAD
        i_a, i_b = inputs[n, 3] * scale, inputs[n, 4] * scale
        if ready and not bad:
            _move(state, _OBSERVED, v, m, i_a, i_b, period)
            _move(state, _FREE, v, m, i_a, i_b, period)
        predicted[n] = 0.5 * (state[_OBSERVED] / v.half_stroke + 1.0) if ready else nan
        validity[n] = Validity.BAD_INPUT if bad else Validity.VALID if ready else Validity.STARTING
        if ready and not bad and abs(state[_OBSERVED]) >= v.stop:
            validity[n] = Validity.AT_SEAT
        if not bad:
            x = min(max((2.0 * position[n] - 1.0) * v.half_stroke, -v.stop), v.stop)
            _observe(state, v, m, x, (i_a, i_b), ready, period)
            if flag == Restart.NEW_CYCLE or not ready:
                for j in range(4):
                    state[_FREE + j] = state[_OBSERVED + j]
            state[_SEEN] += 1.0
        simulated[n] = 0.5 * (state[_FREE] / v.half_stroke + 1.0) if ready else nan


@njit(cache=True)
def _observe(
    state: FloatArray,
    v: Valve,
    m: Curves,
    x: float,
    currents: tuple[float, float],
    ready: bool,
    period: float,
) -> None:
    """Let the observer follow a measured position [m]."""
    if not ready:
        state[_OBSERVED], state[_OBSERVED + 1] = x, 0.0
        state[_OBSERVED + 2] = force_of(m, currents[0], currents[1], x)
        state[_OBSERVED + 3] = 0.0
        return
    off = x - state[_OBSERVED]
    state[_OBSERVED] = min(max(state[_OBSERVED] + _POSITION_GAIN * off, -v.stop), v.stop)
    state[_OBSERVED + 1] += _SPEED_GAIN * off / period


@njit(cache=True)
def predict_block(
    state: FloatArray,
    c: FloatArray,
    position: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place; see `ValveModel.predict`.

    Parameters
    ----------
    state : (STATE_SIZE,) array
        See `STATE_SIZE`; written in place.
    c : (N_COEFFICIENTS,) array
        See `coefficients`.
    position : (N,) array
        Measured position [1].
    inputs : (N, 5) array
        Setpoint, voltages and currents [1].
    restart : (N,) uint8 array
        One `Restart` a sample.
    predicted, simulated : (N,) arrays
        One-step prediction and free run [1].
    validity : (N,) uint8 array
        One `Validity` a sample.
    """
    last, signals = (c[21], c[22]), (position, inputs, restart)
    _predict(state, _valve(c), _tables(c), last, signals, (predicted, simulated, validity))


@njit(cache=True)
def predict_map(
    state: FloatArray,
    c: FloatArray,
    position: FloatArray,
    inputs: FloatArray,
    restart: ByteArray,
    predicted: FloatArray,
    simulated: FloatArray,
    validity: ByteArray,
) -> None:
    """Predict N samples in place with a map of both coils; parameters as `predict_block`."""
    last, signals = (c[21], c[22]), (position, inputs, restart)
    _predict(state, _valve(c), _map(c), last, signals, (predicted, simulated, validity))
