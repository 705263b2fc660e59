# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the spool from measured currents: one step ahead, and free.

With `Eddies` the currents that magnetise are told by currents and voltages.

One step ahead, an observer follows the measured position; the free run starts from it at the
beginning of a cycle and sees the currents only. Near an end the magnets pull harder than the
springs push, so a free run at a held current drifts away by itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from valve_twin.core.physics.coenergy_tables import FORCE_NODES, PLACE_NODES, CoenergyTables
from valve_twin.core.physics.curves import force_of
from valve_twin.core.physics.solenoid_map import (
    CURRENT_NODES,
    FLUX_NODES,
    POSITION_NODES,
    MapTables,
)
from valve_twin.core.types import Validity
from valve_twin.core.valves.double_solenoid.eddies import Eddies, magnetising
from valve_twin.core.valves.double_solenoid.motion import SUB
from valve_twin.core.valves.double_solenoid.plant_kernel import (
    Second,
    Valve,
    friction_force,
    spring_force,
)
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.prediction import predictor, state_size
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.physics.curves import Curves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.double_solenoid.plant import DoubleSolenoidPlant

_X, _SPEED, _FORCE, _FORCE_RATE = range(4)
_RUN = 4  # position [m], speed [m/s] and both states of the force filter [N], [N/s]
_FAST_A, _SLOW_A, _FAST_B, _SLOW_B, _NOW_A, _NOW_B = range(6)
_MEMORY = 6  # eddy currents of both coils, and what magnetises them in the last sample [A]
STATE_SIZE = state_size(_RUN, _MEMORY)

_MASS, _PRELOAD_1, _PRELOAD_2, _SPRING_1, _SPRING_2 = range(5)
_FRICTION, _ALPHA, _BETA, _STOP, _HALF_STROKE, _FORCE_GAIN = range(5, 11)
_RATE_1, _RATE_2, _OUT_1, _OUT_2, _DIRECT = range(11, 16)
_OWN = 16  # five numbers of the magnetic tables
_CURRENT_SCALE, _PERIOD = 21, 22
_RESISTANCE_A, _RESISTANCE_B, _SUPPLY = 23, 24, 25
_EDDIES = 26  # five numbers of them
_SCALARS = 31
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
    numbers += [v.resistance_a, v.resistance_b, valve.supply_voltage, *v.eddies]
    assert len(numbers) == _SCALARS
    return np.concatenate([numbers, *(table.ravel() for table in tables)])


class _Numbers(NamedTuple):
    """Valve, magnetic tables, full scales of currents [A] and voltages [V], sampling time [s]."""

    valve: Valve
    tables: Any  # `MapTables` or `CoenergyTables`
    current_scale: float
    supply: float
    period_s: float


@njit(cache=True)
def _valve(c: FloatArray) -> Valve:
    force = Second(c[_RATE_1], c[_RATE_2], c[_OUT_1], c[_OUT_2], c[_DIRECT])
    gain_1, rate_1, gain_2, rate_2, growth = c[_EDDIES:_SCALARS]
    eddies = Eddies(gain_1, rate_1, gain_2, rate_2, growth)
    return Valve(
        c[_RESISTANCE_A], c[_RESISTANCE_B], force, force, eddies, c[_FORCE_GAIN], c[_MASS],
        c[_PRELOAD_1], c[_PRELOAD_2], c[_SPRING_1], c[_SPRING_2], c[_FRICTION], c[_ALPHA],
        c[_BETA], c[_STOP], c[_HALF_STROKE], 0.0, 0.0, 0.0,
    )  # fmt: skip


@njit(cache=True)
def _of_tables(c: FloatArray) -> _Numbers:
    a, b = _SCALARS, _SCALARS + _CURRENT_TABLE
    current = c[a:b].reshape((FLUX_NODES, POSITION_NODES))
    force = c[b : b + _FORCE_TABLE].reshape((CURRENT_NODES, POSITION_NODES))
    per_flux, per_current, reach, per_position, mutual = c[_OWN:_CURRENT_SCALE]
    tables = MapTables(current, force, per_flux, per_current, reach, per_position, mutual)
    return _Numbers(_valve(c), tables, c[_CURRENT_SCALE], c[_SUPPLY], c[_PERIOD])


@njit(cache=True)
def _of_map(c: FloatArray) -> _Numbers:
    force = c[_SCALARS:].reshape((FORCE_NODES, FORCE_NODES, PLACE_NODES))
    unused = force[:1]
    low_current, per_current, reach, per_position, largest = c[_OWN:_CURRENT_SCALE]
    tables = CoenergyTables(
        unused,
        unused,
        force,
        0.0,
        0.0,
        low_current,
        0.0,
        per_current,
        reach,
        per_position,
        largest,
    )
    return _Numbers(_valve(c), tables, c[_CURRENT_SCALE], c[_SUPPLY], c[_PERIOD])


@njit(cache=True)
def _move(run: FloatArray, v: Valve, m: Curves, i_a: float, i_b: float, period: float) -> None:
    """Move observer or free run by a sample with the mean currents of that sample."""
    x, speed, f1, f2 = run[_X], run[_SPEED], run[_FORCE], run[_FORCE_RATE]
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
    run[_X], run[_SPEED], run[_FORCE], run[_FORCE_RATE] = x, speed, f1, f2


@per_sample
def _magnetise(m: _Numbers, memory: FloatArray, inputs: FloatArray, n: int) -> None:
    """Write the currents that magnetise both coils in a sample."""
    v = m.valve
    i_a, i_b = inputs[n, 3] * m.current_scale, inputs[n, 4] * m.current_scale
    if v.eddies.gain_1 > 0.0:
        induced_a = inputs[n, 1] * m.supply - v.resistance_a * i_a
        induced_b = inputs[n, 2] * m.supply - v.resistance_b * i_b
        i_a, memory[_FAST_A], memory[_SLOW_A] = magnetising(
            v.eddies, i_a, induced_a, memory[_FAST_A], memory[_SLOW_A], m.period_s
        )
        i_b, memory[_FAST_B], memory[_SLOW_B] = magnetising(
            v.eddies, i_b, induced_b, memory[_FAST_B], memory[_SLOW_B], m.period_s
        )
    memory[_NOW_A], memory[_NOW_B] = i_a, i_b


@per_sample
def _advance(
    m: _Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    if seen == 0.0:
        memory[:] = 0.0
    if not bad:
        _magnetise(m, memory, inputs, n)
    if seen == 0.0:
        return Validity.STARTING
    if not bad:
        i_a, i_b = memory[_NOW_A], memory[_NOW_B]
        _move(followed, m.valve, m.tables, i_a, i_b, m.period_s)
        _move(free, m.valve, m.tables, i_a, i_b, m.period_s)
    return Validity.AT_SEAT if abs(followed[_X]) >= m.valve.stop else Validity.VALID


@per_sample
def _shown(m: _Numbers, value: float) -> float:
    return float(0.5 * (value / m.valve.half_stroke + 1.0))


@per_sample
def _follow(
    m: _Numbers, followed: FloatArray, memory: FloatArray, position: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    v = m.valve
    x = min(max((2.0 * position - 1.0) * v.half_stroke, -v.stop), v.stop)
    if code == Validity.STARTING:
        followed[_X], followed[_SPEED] = x, 0.0
        followed[_FORCE] = force_of(m.tables, memory[_NOW_A], memory[_NOW_B], x)
        followed[_FORCE_RATE] = 0.0
        return code
    off = x - followed[_X]
    followed[_X] = min(max(followed[_X] + _POSITION_GAIN * off, -v.stop), v.stop)
    followed[_SPEED] += _SPEED_GAIN * off / m.period_s
    return code


predict_block = predictor(_advance, _follow, run=_RUN, numbers=_of_tables, output=_X, shown=_shown)
predict_map = predictor(_advance, _follow, run=_RUN, numbers=_of_map, output=_X, shown=_shown)
