# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The valve alone under a sinusoidal current, as in figures 5 to 7 of paper 003."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics import hysteresis
from valve_twin.core.valves.servo_system.dynamics import motor
from valve_twin.core.valves.servo_system.numbers import BV, KV, MV, REACH
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.servo_system.plant import ServoSystemPlant

FREQUENCIES_HZ = (0.105, 1.08, 6.30)
"""Of figures 5, 6 and 7."""

_LONGEST_STEP_S = 5e-5
_POINTS = 800


@dataclass(frozen=True, slots=True)
class Loop:
    """A closed loop of the valve: current (N,) [A], valve position (N,) [m]."""

    current: FloatArray
    position: FloatArray

    @property
    def width(self) -> float:
        """Return the largest distance between both branches at the same position [A]."""
        middle = len(self.current) // 2
        level = np.linspace(-0.5, 0.5, 41) * np.abs(self.position).max()
        branches = []
        for part in (slice(0, middle), slice(middle, None)):
            order = np.argsort(self.position[part])
            branches.append(
                np.interp(level, self.position[part][order], self.current[part][order])
            )
        return float(np.abs(branches[0] - branches[1]).max())

    @property
    def area(self) -> float:
        """Return the enclosed area [A m]."""
        return abs(float(np.trapezoid(self.position, self.current)))


@njit(cache=True)
def _drive(
    p: FloatArray, current: FloatArray, step: float, memory: FloatArray, position: FloatArray
) -> None:
    """Write the valve's position (N,) under a current (N,) given every half step [A].

    Runge-Kutta of order 4 for m x'' + b x' + k x = F(i), without flow.
    """
    x, v, rate = 0.0, 0.0, 0.0
    for n in range(len(position)):
        position[n] = x
        force = np.empty(3)
        for j in range(3):
            i = current[2 * n + j]
            if j > 0:
                rate = i - current[2 * n + j - 1]
            force[j] = motor(i, rate, p, memory)[0]
            hysteresis.remember(i, memory, p[REACH])
        k1x, k1v = v, (force[0] - p[BV] * v - p[KV] * x) / p[MV]
        x2, v2 = x + 0.5 * step * k1x, v + 0.5 * step * k1v
        k2x, k2v = v2, (force[1] - p[BV] * v2 - p[KV] * x2) / p[MV]
        x3, v3 = x + 0.5 * step * k2x, v + 0.5 * step * k2v
        k3x, k3v = v3, (force[1] - p[BV] * v3 - p[KV] * x3) / p[MV]
        x4, v4 = x + step * k3x, v + step * k3v
        k4x, k4v = v4, (force[2] - p[BV] * v4 - p[KV] * x4) / p[MV]
        x += step * (k1x + 2.0 * k2x + 2.0 * k3x + k4x) / 6.0
        v += step * (k1v + 2.0 * k2v + 2.0 * k3v + k4v) / 6.0


def sine_response(
    plant: ServoSystemPlant,
    frequency_hz: float,
    amplitude: float,
    *,
    mean: float = 0.0,
    periods: int = 3,
) -> tuple[FloatArray, FloatArray]:
    """Return current [A] and valve position [m], (N,) each, under a sine from a fresh motor.

    Parameters
    ----------
    plant : ServoSystemPlant
        The valve.
    frequency_hz, amplitude, mean : float
        Of the current [Hz], [A], [A].
    periods : int
        How many; a period has a multiple of 800 samples [1].
    """
    period = 1.0 / frequency_hz
    steps = _POINTS * ceil(period / _POINTS / _LONGEST_STEP_S)
    total = periods * steps
    angle = np.pi * np.arange(2 * total + 1) / steps
    current = mean + amplitude * np.sin(angle)
    memory, position = np.zeros(hysteresis.PLAYS), np.empty(total)
    _drive(plant.numbers(), current, period / steps, memory, position)
    return np.ascontiguousarray(current[: 2 * total : 2]), position


def valve_loop(
    plant: ServoSystemPlant, frequency_hz: float, amplitude: float, *, mean: float = 0.0
) -> Loop:
    """Return the loop that a sine runs through after two periods.

    Parameters
    ----------
    plant : ServoSystemPlant
        The valve.
    frequency_hz, amplitude, mean : float
        Of the current [Hz], [A], [A].
    """
    current, position = sine_response(plant, frequency_hz, amplitude, mean=mean)
    steps = len(position) // 3
    shown = slice(steps + steps // 4, 2 * steps + steps // 4)  # from crest to crest
    every = steps // _POINTS
    return Loop(
        np.ascontiguousarray(current[shown][::every]),
        np.ascontiguousarray(position[shown][::every]),
    )
