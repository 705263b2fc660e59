# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Turbulent orifice flow, odd in the pressure drop and linear close to zero."""

from __future__ import annotations

import math

from valve_twin.kernels import njit

LINEAR_PRESSURE = 5e3
"""Pressure drop below which the flow is taken as linear, so that its slope stays finite [Pa]."""


@njit(cache=True)
def signed_root(pressure_drop: float) -> float:
    """Return sgn(dp) sqrt(|dp|), linear below `LINEAR_PRESSURE`.

    Parameters
    ----------
    pressure_drop : float
        Pressure before minus pressure behind the orifice [Pa].

    Returns
    -------
    float
        [Pa^0.5]; flow = c_d w y sqrt(2/rho) times this (paper 002, eq. (5)).
    """
    size = abs(pressure_drop)
    if size <= LINEAR_PRESSURE:
        return pressure_drop / math.sqrt(LINEAR_PRESSURE)
    return math.copysign(math.sqrt(size), pressure_drop)


@njit(cache=True)
def root_slope(pressure_drop: float) -> float:
    """Return the derivative of `signed_root` [Pa^-0.5]."""
    size = abs(pressure_drop)
    if size <= LINEAR_PRESSURE:
        return 1.0 / math.sqrt(LINEAR_PRESSURE)
    return 0.5 / math.sqrt(size)
