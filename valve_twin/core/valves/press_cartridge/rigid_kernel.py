# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The press valve with incompressible water, with and without the paper's Taylor polynomials.

The chamber pressure follows from A_B w = Q_in - Q_out at once (paper 002, eq. (8)). With the flow
functions f_in, f_out expanded about the balance pressure Pc0 and p = Pc - Pc0,

    A_B w = Q_in(Pc0) - Q_out(Pc0) + r(p) - p/g,        eqs. (9)-(12), r the remainder of f,

and 1/g is exact, or that of g linearised about v_in = v_out = v0 (the polynomial behind eq. (14)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.plant_kernel import SHUT, PressCoefficients, opening
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_ITERATIONS = 60
_PRESSURE_STEP = 1.0
"""A Newton step below this settles the pressure [Pa]."""


@njit(cache=True)
def _settle(
    c: PressCoefficients,
    g_in: float,
    g_out: float,
    inverse_gain: float,
    with_remainder: bool,
    speed: float,
    pressure: float,
) -> float:
    """Return p [Pa] at the end of a step that begins with `speed` [m/s] and `pressure` [Pa]."""
    balance = c.top_force / c.piston_area
    root_in, root_out = np.sqrt(c.supply_pressure - balance), np.sqrt(balance)
    inertia = 1.0 + c.step_s * c.damping / c.mass
    pull = c.step_s * c.piston_area / (c.mass * inertia)
    net = g_in * root_in - g_out * root_out
    p = pressure
    for _ in range(_ITERATIONS):
        rest, slope = 0.0, 0.0
        if with_remainder:
            p = min(max(p, -0.999 * balance), 0.999 * (c.supply_pressure - balance))
            now_in, now_out = np.sqrt(c.supply_pressure - balance - p), np.sqrt(balance + p)
            rest = g_in * (now_in - root_in + 0.5 * p / root_in)
            rest -= g_out * (now_out - root_out - 0.5 * p / root_out)
            slope = 0.5 * g_in * (1.0 / root_in - 1.0 / now_in)
            slope -= 0.5 * g_out * (1.0 / now_out - 1.0 / root_out)
        error = net + rest - p * inverse_gain - c.piston_area * (speed / inertia + pull * p)
        tangent = min(slope, 0.0) - inverse_gain - c.piston_area * pull
        move = -error / tangent
        p += move
        if abs(move) < _PRESSURE_STEP:
            break
    return p


@njit(cache=True)
def run_rigid(
    c: PressCoefficients,
    commands: FloatArray,
    steps_per_sample: int,
    with_remainder: bool,
    exact_gain: bool,
    v0: float,
    position: FloatArray,
) -> None:
    """Run N samples from rest on the closed seat; writes `position` (N,) [1].

    Parameters
    ----------
    c : PressCoefficients
        The valve.
    commands : (N, 2) array
        v_in, v_out, each held for one sample [1].
    steps_per_sample : int
        Steps of `c.step_s` in a sample.
    with_remainder : bool
        With the flow functions themselves; else with their first-order polynomials.
    exact_gain : bool
        With g(v_in, v_out) itself; else with its first-order polynomial about v0.
    v0 : float
        Command about which g is expanded [1].
    position : (N,) array
        Result [1].
    """
    balance = c.top_force / c.piston_area
    slope_in = 0.5 / np.sqrt(c.supply_pressure - balance)
    slope_out = 0.5 / np.sqrt(balance)
    middle = slope_in * c.conductance_in * opening(v0 + c.offset_in, c.offset_in, c.saturation_in)
    middle += slope_out * (
        c.conductance_out * opening(v0 + c.offset_out, c.offset_out, c.saturation_out) + c.leak
    )
    inertia = 1.0 + c.step_s * c.damping / c.mass
    pull = c.step_s * c.piston_area / (c.mass * inertia)
    travel, speed, p, y_in, y_out = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(len(position)):
        position[n] = travel / c.stroke
        target_in = opening(commands[n, 0], c.offset_in, c.saturation_in)
        target_out = opening(commands[n, 1], c.offset_out, c.saturation_out)
        for _ in range(steps_per_sample):
            y_in += c.pilot_share * (target_in - y_in)
            y_out += c.pilot_share * (target_out - y_out)
            g_in = c.conductance_in * y_in
            g_out = c.conductance_out * y_out + c.leak
            inverse_gain = slope_in * g_in + slope_out * g_out
            if not exact_gain:
                inverse_gain = middle / max(2.0 - inverse_gain / middle, 1e-3)
            p = _settle(c, g_in, g_out, inverse_gain, with_remainder, speed, p)
            speed = speed / inertia + pull * p
            travel += c.step_s * speed
            if travel < 0.0 or travel > c.stroke:
                travel = min(max(travel, 0.0), c.stroke)
                speed, p = 0.0, 0.0
        y_in = y_in if y_in > SHUT else 0.0
        y_out = y_out if y_out > SHUT else 0.0
