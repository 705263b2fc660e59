# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What each approximation of paper 002 changes in the position: rows (g) to (k) of its Table 5.

Each is the difference of two free runs under the same recorded commands that differ in this one
approximation. The paper draws white noise of the same variance instead; the difference itself
keeps where in the cycle the error stands, which is what an estimator answers to.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.simulation.plant import Drive
from valve_twin.core.valves.interface import Approximation
from valve_twin.core.valves.press_cartridge.rigid_kernel import run_rigid
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.press_cartridge.plant import PressCartridgePlant

V0 = 0.6
"""Command about which g is expanded (paper 002, Table 3: 0.5 to 0.7) [1], assumed."""


def press_approximations(
    plant: PressCartridgePlant,
    commands: FloatArray,
    period_s: float,
    theta: Mapping[str, float],
) -> tuple[Approximation, ...]:
    """Return the error signals of rows (g) to (k).

    Parameters
    ----------
    plant : PressCartridgePlant
        The valve.
    commands : (N, 2) array
        Recorded v_in, v_out of one cycle that begins at rest on the closed seat [1].
    period_s : float
        Sampling time [s].
    theta : mapping
        Identified theta_1, theta_2, theta_3, theta_5; row (g) is left out where one is missing.

    Returns
    -------
    tuple of Approximation
        Position with the approximation less position without it, sign reversed: what the real
        valve does beyond the model [1].
    """
    soft = _compressible(plant, commands, period_s)
    full, flat_f, flat_g, flat = (
        _rigid(plant, commands, period_s, with_remainder=f, exact_gain=g)
        for f, g in ((True, True), (False, True), (True, False), (False, False))
    )
    made = [
        Approximation("h", "flow functions to first order, eqs. (9) and (10)", full - flat_f),
        Approximation("i", "gain g to first order, eq. (12)", flat_f - flat),
        Approximation(
            "j", "both together, eqs. (9), (10) and (12)", full - flat_f - flat_g + flat
        ),
        Approximation("k", "compressibility of the water", soft - full),
    ]
    names = ("theta_1", "theta_2", "theta_3", "theta_5")
    values = np.array([theta.get(name, np.nan) for name in names])
    if np.isfinite(values).all():
        made.insert(0, Approximation("g", "Euler forward method", euler_error(values, commands)))
    return tuple(made)


def euler_error(theta: FloatArray, commands: FloatArray) -> FloatArray:
    """Return position of the continuous model less that of its Euler form: (N,) [1].

    Both have the coefficients of eq. (14) that belong to theta_1, theta_2, theta_3, theta_5 (4,);
    commands are held for a sample. Exact integration of the one, eq. (17) for the other.
    """
    exact, euler = np.empty(len(commands)), np.empty(len(commands))
    _run_both(theta, np.ascontiguousarray(commands), exact, euler)
    return exact - euler


@njit(cache=True)
def _run_both(
    theta: FloatArray, commands: FloatArray, exact: FloatArray, euler: FloatArray
) -> None:
    """Run both forms from rest; time in samples."""
    rate = max(-theta[0], 1e-12)
    stay = np.exp(-rate)
    part = -np.expm1(-rate) / rate
    x, speed = 0.0, 0.0
    x1, d1 = 0.0, 0.0
    pending = 0.0
    for n in range(len(commands)):
        exact[n], euler[n] = x, x1
        v_in, v_out = commands[n, 0], commands[n, 1]
        push = theta[1] * v_in + theta[2] * v_out + theta[3] * v_out * v_out
        ahead = x + part * speed + push / rate * (1.0 - part)
        speed = stay * speed + part * push
        x = min(max(ahead, 0.0), 1.0)
        if x != ahead:
            speed = 0.0
        d1 = (1.0 + theta[0]) * d1 + pending
        ahead = x1 + d1
        x1 = min(max(ahead, 0.0), 1.0)
        if x1 != ahead:
            d1 = 0.0
        pending = push


def _compressible(plant: PressCartridgePlant, commands: FloatArray, period_s: float) -> FloatArray:
    samples = len(commands)
    ticks = samples * plant.ticks_per_sample(period_s)
    drive = Drive(np.zeros(ticks), np.zeros(ticks, np.bool_), commands, np.zeros(samples))
    return plant.run(plant.initial_state(), drive, period_s).position


def _rigid(
    plant: PressCartridgePlant,
    commands: FloatArray,
    period_s: float,
    *,
    with_remainder: bool,
    exact_gain: bool,
) -> FloatArray:
    position = np.empty(len(commands))
    steps = round(period_s / plant.step)
    held = np.ascontiguousarray(commands)
    run_rigid(plant.coefficients(), held, steps, with_remainder, exact_gain, V0, position)
    return position
