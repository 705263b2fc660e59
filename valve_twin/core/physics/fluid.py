# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A compressible fluid with air in it, and a line that carries it."""

from __future__ import annotations

from math import pi, sqrt

from valve_twin.kernels import njit

ATMOSPHERE = 1.013e5
"""Pressure at which the share of air is meant [Pa]."""

POLYTROPIC = 1.4
"""Exponent of the air, compressed without losing heat [1]."""

LOWEST_PRESSURE = 1e4
"""Absolute pressure below which the air is not stretched further [Pa]."""


@njit(cache=True)
def compressibility(pressure: float, bulk: float, air: float) -> tuple[float, float]:
    """Return 1/beta of a fluid with entrained air [1/Pa], and its slope over pressure [1/Pa^2].

    Parameters
    ----------
    pressure : float
        Above atmosphere [Pa].
    bulk : float
        Bulk modulus of the fluid without air [Pa].
    air : float
        Share of air in the volume at atmospheric pressure [1].
    """
    total = pressure + ATMOSPHERE
    if total < LOWEST_PRESSURE:
        squeezed = air * (ATMOSPHERE / LOWEST_PRESSURE) ** (1.0 / POLYTROPIC)
        return 1.0 / bulk + squeezed / (POLYTROPIC * LOWEST_PRESSURE), 0.0
    share = air * (ATMOSPHERE / total) ** (1.0 / POLYTROPIC) / (POLYTROPIC * total)
    return 1.0 / bulk + share, -share * (1.0 / POLYTROPIC + 1.0) / total


@njit(cache=True)
def smooth_root(drop: float, linear: float) -> tuple[float, float]:
    """Return sgn(d) sqrt(|d|), smooth and linear close to zero, and its slope.

    d / (d^2 + e^2)^(1/4): 6e-6 below the root at 1 MPa with e = 5 kPa.

    Parameters
    ----------
    drop : float
        Pressure drop d [Pa].
    linear : float
        Drop e below which the flow is linear [Pa].
    """
    square = drop * drop + linear * linear
    root = sqrt(sqrt(square))
    return drop / root, (1.0 - 0.5 * drop * drop / square) / root


@njit(cache=True)
def laminar(viscosity: float, length: float, bore: float) -> float:
    """Return pressure loss over flow of a laminar line, 128 mu l/(pi d^4) [Pa s/m^3].

    Parameters
    ----------
    viscosity : float
        Dynamic viscosity [Pa s].
    length, bore : float
        Of the line [m].
    """
    return 128.0 * viscosity * length / (pi * bore**4)


@njit(cache=True)
def fittings(coefficient: float, density: float, area: float) -> float:
    """Return pressure loss over flow squared of fittings, k rho/(2 A^2) [Pa s^2/m^6].

    Parameters
    ----------
    coefficient : float
        Loss coefficient k of all fittings [1].
    density : float
        Of the fluid [kg/m^3].
    area : float
        Of the line [m^2].
    """
    return 0.5 * coefficient * density / (area * area)
