# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Water through the control valve and its bypass: flow, choking, force on the rod.

Transcribed from the actuator library of the DAMADICS benchmark, version 1.22 (block diagram).
"""

from __future__ import annotations

from math import exp, pi, sqrt

from valve_twin.kernels import njit

KV_MAX = 120.0
"""Flow coefficient of the open valve [m3/h]."""
KV_BYPASS = 19.75
"""Flow coefficient of the open bypass valve [m3/h]."""
PLUG_AREA = pi * 0.050**2 / 4.0
"""Area of the plug on which the pressure drop acts [m2]."""

_KM = (1.0, 0.95, 0.90, 0.85, 0.785, 0.725, 0.67, 0.61, 0.555, 0.5, 0.45, 0.40)
_KM_BYPASS = (0.45, 0.5, 0.555, 0.61, 0.67, 0.725, 0.785, 0.85, 0.90, 0.95, 1.0)
_RC_AT = (0.0, 1723763.0, 3447527.0, 6895055.0, 13790111.0, 17237639.0, 20685166.0)
_RC = (0.94, 0.87, 0.84, 0.79, 0.75, 0.725, 0.685)
_C_AT = (0.0, 10.0, 20.0, 50.0, 110.0)
_C = (5.26e-10, 5.02e-10, 4.81e-10, 4.69e-10, 4.42e-10)


@njit(cache=True)
def look_up(x: float, at: tuple[float, ...], values: tuple[float, ...]) -> float:
    """Interpolate linearly in a table, and extrapolate from its end pieces.

    Parameters
    ----------
    x : float
        Where [unit of `at`].
    at, values : tuple of float
        Points of the table, increasing, and what it holds there [any unit].
    """
    i = 0
    while i < len(at) - 2 and x > at[i + 1]:
        i += 1
    return values[i] + (values[i + 1] - values[i]) * (x - at[i]) / (at[i + 1] - at[i])


@njit(cache=True)
def recovery(x: float) -> float:
    """Return the pressure recovery Km of the valve at a position x, 0 = open .. 1 = closed."""
    percent = 100.0 * x
    if percent >= 99.0:
        return _KM[10] + (_KM[11] - _KM[10]) * (percent - 99.0)
    i = min(int(0.1 * percent), 9)
    width = 10.0 if i < 9 else 9.0
    return _KM[i] + (_KM[i + 1] - _KM[i]) * (percent - 10.0 * i) / width


@njit(cache=True)
def vapour_pressure(temperature: float) -> float:
    """Return the vapour pressure of water [Pa] at a temperature [C]."""
    return float(10.0 ** (10.7167 - 2141.0 / (temperature + 273.15)))


@njit(cache=True)
def density(pressure: float, temperature: float) -> float:
    """Return the density of water [kg/m3] at a pressure [Pa] and a temperature [C]."""
    t = min(max(temperature, 0.0), 110.0)
    if t >= 30.0:
        drop = (t - 4.0) ** 2 / 466700.0 * (t + 273.0) * 1000.0 * (350.0 - t)
        rho = 1000.0 - drop / ((t + 67.0) * (365.0 - t))
    else:
        rho = 1000.0 - (t - 4.0) ** 2 / 503570.0 * (t + 283.0) * 1000.0 / (t + 67.2)
    return rho / (1.0 - look_up(t, _C_AT, _C) * pressure)


@njit(cache=True)
def driving_drop(km: float, p1: float, p2: float, pv: float) -> float:
    """Return the pressure drop that drives the flow: the whole one, or that of choked flow.

    Parameters
    ----------
    km : float
        Pressure recovery [1].
    p1, p2 : float
        Pressures before and behind the valve [Pa].
    pv : float
        Vapour pressure [Pa].
    """
    allowed = max(0.0, km * (p1 - look_up(p1, _RC_AT, _RC) * pv))
    return min(p1 - p2, allowed)


@njit(cache=True)
def relative_coefficient(x: float) -> float:
    """Return the equal-percentage characteristic at a position x, 0 = open .. 1 = closed."""
    kvr = exp(-5.0 * min(x, 0.975))
    if x > 0.975:
        kvr *= 1.0 - (x - 0.975) / 0.025
    return kvr


@njit(cache=True)
def valve_flow(x: float, kvr: float, p1: float, p2: float, temperature: float) -> float:
    """Return the flow through the control valve [t/h].

    Parameters
    ----------
    x : float
        Position, 0 = open .. 1 = closed [1].
    kvr : float
        Flow coefficient as part of that of the open valve [1].
    p1, p2 : float
        Pressures before and behind the valve [Pa].
    temperature : float
        Of the water [C].
    """
    pv = vapour_pressure(temperature)
    p1 = max(p1, pv)
    rho = density(p1, temperature)
    drop = driving_drop(recovery(x), p1, p2, pv)
    return KV_MAX * kvr * 100.0 * sqrt(abs(drop) * 1e-6 / rho) * rho / 1000.0


@njit(cache=True)
def bypass_flow(opening: float, p1: float, p2: float, temperature: float) -> float:
    """Return the flow through the bypass valve [m3/h], which the benchmark adds to t/h.

    Parameters
    ----------
    opening : float
        0 = closed .. 1 = open [1].
    p1, p2 : float
        Pressures before and behind the valve [Pa].
    temperature : float
        Of the water [C].
    """
    percent = 100.0 * (1.0 - opening)
    i = min(int(0.1 * percent), 9)
    km = _KM_BYPASS[i] + (_KM_BYPASS[i + 1] - _KM_BYPASS[i]) * (percent - 10.0 * i) / 10.0
    drop = driving_drop(km, p1, p2, vapour_pressure(temperature))
    return KV_BYPASS * opening * 100.0 * sqrt(abs(drop) * 1e-6 / 1000.0)


@njit(cache=True)
def rod_force(x: float, p1: float, p2: float) -> float:
    """Return the force of the flow on the rod [N], against closing.

    Parameters
    ----------
    x : float
        Position, 0 = open .. 1 = closed [1].
    p1, p2 : float
        Pressures before, not below the vapour pressure, and behind the valve [Pa].
    """
    return (p1 - p2) / recovery(x) * PLUG_AREA
