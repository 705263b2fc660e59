# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Orifice and leakage areas of the suspension valve, paper 003 eqs. (7) to (11), for every x_v.

The printed branch limits are wrong (orifice 1 closes at x_v = -u_s, not -u_r) and the printed arc
cosines leave [-1, 1] beyond the underlap: the distances are limited instead,

    d1 = clip(2 r - x - u_s, 0, 2 r),  d2 with -x,  s3 = clip(u_r - x, 0, 2 r),  s4 with -x,
    L_j = 8 r c acos(d_j / 2r),
    A1 = L1 + 8 r^2 acos(d1 / 2r) - 2 d1 sqrt(4 r^2 - d1^2),      A2 with d2,
    A3 = 8 pi r c - L1 + seg(s3),  A4 = 8 pi r c - L2 + seg(s4),  A_L = 8 pi r c - L1 - L2,
    seg(s) = 4 (r^2 acos((r - s) / r) - (r - s) sqrt(2 r s - s^2)),

so that A1(x) = A2(-x), A3(x) = A4(-x) and L1 + L2 + A_L = 8 pi r c at any opening.
"""

from __future__ import annotations

from math import acos, pi, sqrt
from typing import TYPE_CHECKING

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

ORIFICES = 5
"""Supply to chamber 1 and 2, chamber 1 and 2 to return, supply to return."""

_LEAST_ROOT = 1e-3
"""Smallest sqrt(1 - (d/2r)^2) in a slope: the true slope is infinite where an edge opens [1]."""


@njit(cache=True)
def _supply(x: float, r: float, c: float, underlap: float) -> tuple[float, float, float, float]:
    """Return strip and opening of a supply orifice [m^2], and their slopes [m]."""
    d = max(2.0 * r - x - underlap, 0.0)
    if d >= 2.0 * r:
        return 0.0, 0.0, 0.0, 0.0
    ratio = d / (2.0 * r)
    root = sqrt(max(1.0 - ratio * ratio, 0.0))
    angle = acos(ratio)
    strip = 8.0 * r * c * angle
    lens = 8.0 * r * r * angle - 4.0 * r * d * root
    if d <= 0.0:
        return strip, lens, 0.0, 0.0
    return strip, lens, 4.0 * c / max(root, _LEAST_ROOT), 8.0 * r * root


@njit(cache=True)
def _segments(x: float, r: float, underlap: float) -> tuple[float, float]:
    """Return the opening of a return orifice [m^2], and its slope [m]."""
    s = underlap - x
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 2.0 * r:
        return 4.0 * pi * r * r, 0.0
    inner = sqrt(max(2.0 * r * s - s * s, 0.0))
    return 4.0 * (r * r * acos((r - s) / r) - (r - s) * inner), -8.0 * inner


@njit(cache=True)
def areas(
    x: float, r: float, c: float, u_s: float, u_r: float, area: FloatArray, slope: FloatArray
) -> None:
    """Write the five areas A1, A2, A3, A4, A_L [m^2] and their slopes over x_v [m].

    Parameters
    ----------
    x : float
        Valve position x_v [m].
    r, c : float
        Radius of the orifices and clearance of the pipe tip [m].
    u_s, u_r : float
        Underlap of supply and return orifices [m].
    area, slope : (ORIFICES,) arrays
        Overwritten: areas [m^2], slopes [m].
    """
    strip1, lens1, strip1_x, lens1_x = _supply(x, r, c, u_s)
    strip2, lens2, strip2_x, lens2_x = _supply(-x, r, c, u_s)
    segment3, segment3_x = _segments(x, r, u_r)
    segment4, segment4_x = _segments(-x, r, u_r)
    whole = 8.0 * pi * r * c
    area[0], slope[0] = strip1 + lens1, strip1_x + lens1_x
    area[1], slope[1] = strip2 + lens2, -strip2_x - lens2_x
    area[2], slope[2] = whole - strip1 + segment3, -strip1_x + segment3_x
    area[3], slope[3] = whole - strip2 + segment4, strip2_x - segment4_x
    area[4], slope[4] = whole - strip1 - strip2, strip2_x - strip1_x
