# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Theta from design parameters over the box of paper 002, Table 3, and its published tables."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

PERIOD_S = 0.03
"""Sampling time T of the data [s]."""

DENSITY = 1000.0
"""Density of the water [kg/m^3]."""

SUPPLY_PRESSURE = 3e7
"""Supply pressure P_z [Pa]."""

PILOTS = 3
"""Pilot valves in each group, m = n [1]."""

FITTED = (1, 2, 3, 5)
"""Terms of theta_3, eq. (32)."""

PUBLISHED = {
    "LS3": {1: -1.16, 2: 1.01e-2, 3: -4.34e-2},
    "LS5": {1: -1.24, 2: 7.04e-3, 3: -6.03e-2, 4: 6.33e-2, 5: 3.37e-2},
    "QP4": {1: -0.99, 2: 1.01e-2, 3: -5.61e-2, 5: 2.78e-2},
}
"""Table 1: theta by estimator and term [1]."""

PUBLISHED_MSE = {"LS3": (3.5e-5, 3.8e-5), "LS5": (3.2e-5, 3.8e-5), "QP4": (3.6e-5, 4.5e-5)}
"""Table 1: mean squared one-step error, training and test [1]."""

PUBLISHED_BOX = {1: (-300.0, -1.0), 2: (1e-3, 1.0), 3: (-4.0, -8e-3), 5: (0.01, 0.6)}
"""Table 4: interval of each term [1]."""

PUBLISHED_ERRORS = {
    "a": (1.0e-6, 5.5e-3, 1.3e-3, 2.7e-2),
    "b": (1.0e-6, 1.7e-2, 1.6e-2, 9.4e-2),
    "c": (1.0e-6, 1.0e-6, 1.0e-6, 1.0e-6),
    "d": (1.0e-6, 1.0e-3, 1.2e-3, 3.1e-3),
    "e": (1.0e-6, 1.7e-4, 1.4e-2, 3.6e-2),
    "f": (1.0e-6, 1.7e-3, 3.9e-3, 1.6e-2),
    "g": (1.0e-6, 1.0e-2, 9.0e-2, 2.2e-1),
    "h": (0.0, 3.0e-2, 4.0e-5, 4.0e-5),
    "i": (1.1e-3, 3.0e-6, 7.0e-6, 2.0e-5),
    "j": (0.0, 3.0e-5, 1.0e-6, 1.0e-6),
    "k": (1.0e-6, 1.0e-3, 5.7e-2, 1.5e-1),
}
"""Table 5: relative error of the terms of `FITTED` by row [1]; a dash is 0."""

PUBLISHED_TOTALS = (1.1e-2, 6.5e-2, 1.8e-1, 5.4e-1)
"""Table 5: totals [1]."""


@dataclass(frozen=True, slots=True)
class Box:
    """Ranges of the design parameters (paper 002, Table 3), SI; each is (lower, upper)."""

    mass: tuple[float, float] = (65.0, 100.0)
    damping: tuple[float, float] = (1000.0, 4500.0)
    piston_area: tuple[float, float] = (5e-4, 5e-3)
    area_ratio: tuple[float, float] = (0.95, 0.97)
    stroke: tuple[float, float] = (0.8, 1.0)
    pilot_area: tuple[float, float] = (0.8e-6, 1e-5)
    v0: tuple[float, float] = (0.5, 0.7)


def physical_theta(
    mass: FloatArray,
    damping: FloatArray,
    piston_area: FloatArray,
    area_ratio: FloatArray,
    stroke: FloatArray,
    area_in: FloatArray,
    area_out: FloatArray,
    v0: FloatArray,
) -> FloatArray:
    """Return theta_1 ... theta_5 of paper 002, eq. (18) with eqs. (9)-(15), for K designs.

    Parameters
    ----------
    mass, damping, piston_area, area_ratio, stroke : (K,) arrays
        M [kg], B [N s/m], A_B [m^2], A_T/A_B [1], x_max [m].
    area_in, area_out : (K,) arrays
        R_1, R_2: opening of each pilot group at full command [m^2].
    v0 : (K,) array
        Command about which g is linearised [1].

    Returns
    -------
    (K, 5) array
        Forward Euler parameters, dimensionless; the gain g taken at v_in = v_out = v0.
    """
    balance = area_ratio * SUPPLY_PRESSURE
    f_in = np.sqrt(2.0 * (SUPPLY_PRESSURE - balance) / DENSITY)
    f_out = np.sqrt(2.0 * balance / DENSITY)
    slope_in, slope_out = -area_in / (DENSITY * f_in), area_out / (DENSITY * f_out)
    g = 1.0 / ((slope_out - slope_in) * v0)
    mean_g = 2.0 * g  # g - v0 (g_in + g_out), exactly
    g_in, g_out = g * g * slope_in, -g * g * slope_out
    inertia = mass / piston_area
    friction = damping / piston_area + mean_g * piston_area
    scale = PERIOD_S**2 / (inertia * stroke)
    return np.stack(
        [
            -friction * PERIOD_S / inertia,
            mean_g * f_in * area_in * scale,
            -mean_g * f_out * area_out * scale,
            g_in * f_in * area_in * scale,
            -g_out * f_out * area_out * scale,
        ],
        axis=1,
    )


def corner_theta(*, identical: bool) -> FloatArray:
    """Return theta_1 ... theta_5 at all corners of the box of Table 3: (K, 5).

    Parameters
    ----------
    identical : bool
        Both pilot groups have the same area, as the paper says; else each its own.
    """
    box = Box()
    own = box.pilot_area if not identical else (1.0,)
    corners = np.array(
        list(
            product(
                box.mass,
                box.damping,
                box.piston_area,
                box.area_ratio,
                box.stroke,
                box.pilot_area,
                own,
                box.v0,
            )
        )
    ).T
    if identical:
        corners[6] = corners[5]
    corners[5:7] *= PILOTS
    return physical_theta(*corners)


def pole_frequency_hz(pole: float) -> float:
    """Return the frequency that a real pole z of the sampled model rings at [Hz].

    A negative real pole alternates from sample to sample: half the sampling frequency, whatever
    its size.
    """
    return float(abs(np.angle(complex(pole, 0.0)))) / (2.0 * np.pi * PERIOD_S)
