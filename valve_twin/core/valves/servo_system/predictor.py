# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled prediction of the piston from the desired position: one step ahead, and free.

Both simulate the whole loop. One step ahead, piston and load are moved towards each measured
position; the free run starts from there at the beginning of a cycle.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np

from valve_twin.core.physics.hysteresis import PLAYS
from valve_twin.core.types import FloatArray, Validity
from valve_twin.core.valves.kit.bind import per_sample
from valve_twin.core.valves.kit.prediction import predictor, state_size
from valve_twin.core.valves.servo_system import dynamics as dyn
from valve_twin.core.valves.servo_system import numbers as num
from valve_twin.core.valves.servo_system.integrate import FIRST_STEP, advance, rest
from valve_twin.kernels import njit

N_COEFFICIENTS = num.COUNT + 1
"""Numbers of the loop, and the sampling time [s]."""

_RUN = dyn.STATES + PLAYS + 1  # states, the motor's memory, next step
_LAST, _ALIVE = 0, 1  # desired position [1], whether the integration goes on
STATE_SIZE = state_size(_RUN, 2)

_GAIN = 0.1  # share of the distance to a measured position that is corrected [1], assumed
_RTOL = 1e-4


@njit(cache=True)
def _shift(y: FloatArray, p: FloatArray, way: float) -> None:
    """Move piston and load together [m]."""
    y[dyn.XP] += way
    y[dyn.TH] += way / p[num.ARM]


@njit(cache=True)
def _begin(run: FloatArray, p: FloatArray, place: float) -> bool:
    """Write a loop at rest about a position [m]."""
    y, memory = run[: dyn.STATES], run[dyn.STATES : dyn.STATES + PLAYS]
    memory[:] = 0.0
    run[dyn.STATES + PLAYS] = FIRST_STEP
    settled = rest(place, p, y, memory)
    _shift(y, p, place - y[dyn.XP])
    return bool(settled and np.isfinite(y).all())


@njit(cache=True)
def _move(run: FloatArray, p: FloatArray, u: FloatArray, period: float) -> bool:
    """Let a loop run for a sample; False where the integration fails."""
    y, memory = run[: dyn.STATES], run[dyn.STATES : dyn.STATES + PLAYS]
    h, reached, _ = advance(y, memory, p, u, period, max(run[-1], FIRST_STEP), _RTOL)
    run[dyn.STATES + PLAYS] = h
    return bool(reached >= period * (1.0 - 1e-9) and np.isfinite(y).all())


class _Numbers(NamedTuple):
    """Numbers of the loop (num.COUNT,), its controls (dyn.CONTROLS,), sampling time [s]."""

    p: FloatArray
    u: FloatArray
    period_s: float


@njit(cache=True)
def _numbers(c: FloatArray) -> _Numbers:
    u = np.zeros(dyn.CONTROLS)
    u[dyn.FED_BACK] = nan
    return _Numbers(c[: num.COUNT], u, c[num.COUNT])


@per_sample
def _advance(
    m: _Numbers, seen: float, followed: FloatArray, free: FloatArray, memory: FloatArray,
    inputs: FloatArray, n: int, bad: bool,
) -> Validity:  # fmt: skip
    if seen > 0.0 and memory[_ALIVE] > 0.0:
        m.u[dyn.WANTED] = (memory[_LAST] - 0.5) * m.p[num.STROKE]
        alive = _move(followed, m.p, m.u, m.period_s) and _move(free, m.p, m.u, m.period_s)
        memory[_ALIVE] = 1.0 if alive else 0.0
    if not bad:
        memory[_LAST] = min(max(inputs[n, 0], -1.0), 2.0)
    return Validity.VALID if seen > 0.0 and memory[_ALIVE] > 0.0 else Validity.STARTING


@per_sample
def _shown(m: _Numbers, value: float) -> float:
    return float(value / m.p[num.STROKE] + 0.5)


@per_sample
def _follow(
    m: _Numbers, followed: FloatArray, memory: FloatArray, position: float,
    inputs: FloatArray, n: int, code: Validity,
) -> Validity:  # fmt: skip
    place = (min(max(position, -0.2), 1.2) - 0.5) * m.p[num.STROKE]
    if code == Validity.STARTING:
        memory[_ALIVE] = 1.0 if _begin(followed, m.p, place) else 0.0
    else:
        _shift(followed, m.p, _GAIN * (place - followed[dyn.XP]))
    return code


predict_block = predictor(
    _advance, _follow, run=_RUN, numbers=_numbers, output=dyn.XP, shown=_shown
)
