# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Friction of a seal over speed: viscous, Coulomb and the higher force at which it breaks away."""

from __future__ import annotations

from math import exp, tanh

from numba import njit


@njit(cache=True)
def stribeck(
    v: float, coulomb: float, static: float, viscous: float, creep: float, decay: float
) -> tuple[float, float]:
    """Return the friction force [N] at a speed, and its slope [N s/m].

    F = (F_c + (F_s - F_c) exp(-(v/v_d)^2)) tanh(v/v_c) + b v: odd, and smooth through rest.

    Parameters
    ----------
    v : float
        Speed [m/s].
    coulomb, static : float
        Friction in motion and break-away force [N].
    viscous : float
        b [N s/m].
    creep, decay : float
        Speed v_c over which the force turns its sign, and v_d over which it falls to the Coulomb
        friction [m/s].
    """
    bell = (static - coulomb) * exp(-((v / decay) ** 2))
    turn = tanh(v / creep)
    slope = -2.0 * v / decay**2 * bell * turn + (coulomb + bell) * (1.0 - turn * turn) / creep
    return (coulomb + bell) * turn + viscous * v, slope + viscous
