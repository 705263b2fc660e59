# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Forces of contact: friction of a seal over speed, and stops that are pressed gradually."""

from __future__ import annotations

from math import exp, tanh

from valve_twin.kernels import njit


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


@njit(cache=True)
def stop(x: float, travel: float, stiffness: float, onset: float) -> tuple[float, float]:
    """Return the force of a stop on either side [N], and its slope [N/m].

    k b^2/(b + onset) with b how far x is beyond: straight after the onset, smooth at contact.

    Parameters
    ----------
    x, travel : float
        Position from the middle, and where the stops stand [m].
    stiffness, onset : float
        k [N/m], and the depth over which it comes up [m].
    """
    beyond = abs(x) - travel
    if beyond <= 0.0:
        return 0.0, 0.0
    whole = beyond + onset
    force = stiffness * beyond * beyond / whole
    slope = stiffness * beyond * (beyond + 2.0 * onset) / (whole * whole)
    return (force if x > 0.0 else -force), slope
