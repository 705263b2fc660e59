# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Faults of any valve as changes of its motion and of its sensor, whatever moves it.

They act between the true position and what is logged: for a valve whose controller reads another
sensor, or none. Lengths are shares of the span of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.generic.moves import find_moves
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.diagnosis.generic.moves import Move
    from valve_twin.core.types import FloatArray

_RANDOM = 7
"""Stream of the random numbers of faults."""


@dataclass(frozen=True, slots=True)
class Sensed:
    """A stretch of motion and what the sensor adds to it.

    Attributes
    ----------
    motion : (N,) array
        True position as the sensor sees it, over the span [1].
    noise : (N,) array
        What the sensor adds, over the span [1].
    period_s : float
        Sampling time [s].
    random : numpy.random.Generator
        Of what comes and goes by chance.
    known : tuple of Move, optional
        Moves of the motion, where they were found before.
    """

    motion: FloatArray
    noise: FloatArray
    period_s: float
    random: np.random.Generator
    known: tuple[Move, ...] | None = None

    @property
    def moves(self) -> tuple[Move, ...]:
        """Moves of the motion."""
        return find_moves(self.motion)[0] if self.known is None else self.known

    def with_motion(self, motion: FloatArray) -> FloatArray:
        """Return what is measured of another motion (N,) [1]."""
        return motion + self.noise


def source(seed: int, cycle: int) -> np.random.Generator:
    """Return the random numbers of a fault in a cycle of a record."""
    return np.random.default_rng([seed, cycle, _RANDOM])


def _offset(s: Sensed, size: float) -> FloatArray:
    return s.with_motion(s.motion + size)


def _gain(s: Sensed, size: float) -> FloatArray:
    return s.with_motion((1.0 + size) * s.motion)


def _freeze(s: Sensed, size: float) -> FloatArray:
    y = s.with_motion(s.motion)
    fresh = s.random.random(len(y)) >= size
    fresh[0] = True
    return np.asarray(y[np.maximum.accumulate(np.where(fresh, np.arange(len(y)), 0))])


def _noise(s: Sensed, size: float) -> FloatArray:
    return s.motion + (1.0 + size) * s.noise


def _lost(s: Sensed, size: float) -> FloatArray:
    """Lose moves; the next one sets off from where the valve stayed."""
    out, off = np.array(s.motion), 0.0
    for move in s.moves:
        part, begin = slice(move.first, move.next), float(s.motion[move.first])
        if s.random.random() < size:
            out[part] = place = begin + off
            off = place - float(s.motion[move.next - 1])
        elif off:
            out[part] += off * (1.0 - np.minimum((s.motion[part] - begin) / move.way, 1.0))
            off = 0.0
    return s.with_motion(out)


@njit(cache=True)
def _play(x: FloatArray, width: float, out: FloatArray) -> None:
    place = x[0]
    for n in range(len(x)):
        place = min(max(place, x[n] - 0.5 * width), x[n] + 0.5 * width)
        out[n] = place


@njit(cache=True)
def _stick(x: FloatArray, hold: FloatArray, out: FloatArray) -> None:
    place = x[0]
    for n in range(len(x)):
        if abs(x[n] - place) > hold[n]:
            place = x[n]
        out[n] = place


@njit(cache=True)
def _slip(x: FloatArray, grip: float, slide: float, stop: float, out: FloatArray) -> None:
    place, way = x[0], 0.0
    for n in range(len(x)):
        if way != 0.0:
            end = x[n] - way * slide
            if (x[n] - x[n - 1]) * way < stop or (end - place) * way <= 0.0:
                way = 0.0
            else:
                place = end
        if way == 0.0 and abs(x[n] - place) > grip:
            way = 1.0 if x[n] > place else -1.0
            place = x[n] - way * slide
        out[n] = place


def slipping(motion: FloatArray, band: float, jump: float) -> FloatArray:
    """Return the motion (N,) of what stands until it lags by half of S + J and slips by J.

    Parameters
    ----------
    motion : (N,) array
        Without friction [any unit].
    band : float
        Stick band S: what it lags by in motion is half of S - J [same unit].
    jump : float
        Slip jump J, 0 for play [share of the band].
    """
    out = np.empty_like(motion)
    stop = _STOPS * float(np.abs(np.diff(motion)).max(initial=0.0))
    _slip(motion, 0.5 * band * (1.0 + jump), 0.5 * band * (1.0 - jump), stop, out)
    return out


_STOPS = 0.02
"""Share of its greatest speed below which what slides stands again, assumed [1]."""


def _lost_motion(s: Sensed, size: float) -> FloatArray:
    out = np.empty_like(s.motion)
    _play(s.motion, size, out)
    return s.with_motion(out)


def _sticking(s: Sensed, size: float) -> FloatArray:
    out = np.empty_like(s.motion)
    hold = size * s.random.uniform(0.5, 1.5, len(out))  # no two grips are alike, assumed
    _stick(s.motion, hold, out)
    return s.with_motion(out)


def _delay(s: Sensed, size: float) -> FloatArray:
    n = np.arange(len(s.motion), dtype=np.float64)
    return s.with_motion(np.interp(n - size / s.period_s, n, s.motion))


def _slow(ways: tuple[float, ...]) -> Callable[[Sensed, float], FloatArray]:
    def slower(s: Sensed, size: float) -> FloatArray:
        out = np.array(s.motion)
        for move in s.moves:
            if np.sign(move.way) in ways:
                t = np.arange(move.next - move.first, dtype=np.float64)
                out[move.first : move.next] = np.interp(
                    t / (1.0 + size), t, s.motion[move.first : move.next]
                )
        return s.with_motion(out)

    return slower


def _upper(s: Sensed, size: float) -> FloatArray:
    return s.with_motion(np.minimum(s.motion, s.motion.max() - size))


def _lower(s: Sensed, size: float) -> FloatArray:
    return s.with_motion(np.maximum(s.motion, s.motion.min() + size))


def _oscillation(s: Sensed, size: float) -> FloatArray:
    wave = 2.0 * np.pi / s.random.uniform(*_WAVE)
    phase = s.random.uniform(0.0, 2.0 * np.pi)
    return s.with_motion(s.motion + size * np.sin(wave * np.arange(len(s.motion)) + phase))


_WAVE = (8.0, 30.0)
"""Shortest and longest period of an oscillation, assumed [samples]."""

FAULTS: dict[str, Callable[[Sensed, float], FloatArray]] = {
    "sensor_offset": _offset,
    "sensor_gain": _gain,
    "sensor_freeze": _freeze,
    "sensor_noise": _noise,
    "command_loss": _lost,
    "lost_motion": _lost_motion,
    "sticking": _sticking,
    "delay": _delay,
    "slow": _slow((1.0, -1.0)),
    "slow_up": _slow((1.0,)),
    "slow_down": _slow((-1.0,)),
    "end_stop_upper": _upper,
    "end_stop_lower": _lower,
    "oscillation": _oscillation,
}
"""Faults by name: what is measured of a motion under a fault of a size (N,) [1]."""

FIRST_SIZES = {
    "sensor_offset": 1e-3,
    "sensor_gain": 2e-3,
    "sensor_freeze": 0.01,
    "sensor_noise": 0.1,
    "command_loss": 0.08,
    "lost_motion": 2e-3,
    "sticking": 4e-3,
    "delay": 1e-3,
    "slow": 0.01,
    "slow_up": 0.01,
    "slow_down": 0.01,
    "end_stop_upper": 2e-3,
    "end_stop_lower": 2e-3,
    "oscillation": 1e-3,
}
"""Where the search for a small size of each fault begins [unit of the fault]."""

SET_SIZES = {"command_loss": 0.09}
"""Small size of a fault that any cycle either shows or does not [1]."""

LARGEST = {
    "sensor_freeze": 0.9,
    "command_loss": 0.9,
    "lost_motion": 0.5,
    "sticking": 0.5,
    "slow": 2.0,
    "slow_up": 2.0,
    "slow_down": 2.0,
    "end_stop_upper": 0.5,
    "end_stop_lower": 0.5,
}
"""Greatest size of a fault that has one [unit of the fault]."""
