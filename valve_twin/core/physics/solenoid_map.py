# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Characteristic curves of a solenoid: current over flux linkage, force over current.

Both come from one energy. With the flux linkage psi(i, x) of a coil alone, the coenergy is
W'(i, x) = integral of psi over i, the force is F = dW'/dx, and the current i(psi, x) is the
inverse of psi. Two coils share a mutual inductance M, so the coenergy of both is

    W'(i_A, i_B, x) = W'(i_A, x) + W'(i_B, -x) + M i_A i_B

and coil A carries i_s(psi_A, i_B, x) = i(psi_A - M i_B, x), which is explicit. M moves no force.
Paper 000, section 2.1: characteristic curves with a simple cross coupling.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

VACUUM = 4e-7 * np.pi
"""Permeability of vacuum [V s/(A m)]."""

SATURATION_EXPONENT = 9
"""Of the saturating part of the current, (psi / psi_s)^9 A, assumed; equations.md 5.2."""

FLUX_NODES, CURRENT_NODES = 97, 97
POSITION_NODES = 65

_NEWTON_STEPS = 60


class MapTables(NamedTuple):
    """Curves of one coil on even grids, as the compiled functions take them.

    Attributes
    ----------
    current : (FLUX_NODES, POSITION_NODES) array
        Current over flux linkage from 0 and position from -reach to reach [A].
    force : (CURRENT_NODES, POSITION_NODES) array
        Force over current from 0 and position [N].
    per_flux, per_current : float
        Nodes a weber, nodes an ampere.
    reach : float
        Largest position of the tables [m].
    per_position : float
        Nodes a metre.
    mutual : float
        Mutual inductance of the two coils [H].
    """

    current: FloatArray
    force: FloatArray
    per_flux: float
    per_current: float
    reach: float
    per_position: float
    mutual: float


@dataclass(frozen=True, slots=True)
class FluxCurves:
    """Flux linkage of one coil without current in the other, as a field computation gives it.

    Attributes
    ----------
    current : (I,) array
        Currents from 0, increasing [A].
    position : (X,) array
        Positions of the armature, increasing, symmetric about 0; positive draws this coil's gap
        shut [m].
    flux : (I, X) array
        Flux linkage [Wb]; its first row is 0.
    mutual : float
        Mutual inductance of the coils [H].
    """

    current: FloatArray
    position: FloatArray
    flux: FloatArray
    mutual: float


@njit(cache=True)
def column_at(m: MapTables, x: float) -> tuple[int, float]:
    """Return the column of the tables before a position and the share to the next [1].

    Parameters
    ----------
    m : MapTables
        Curves of one coil.
    x : float
        Position, positive towards this coil [m].
    """
    place = (x + m.reach) * m.per_position
    k = min(max(int(place), 0), POSITION_NODES - 2)
    return k, place - k


@njit(cache=True)
def _bilinear(table: FloatArray, row: float, k: int, t: float) -> float:
    """Interpolate between the four nodes around; beyond the table go on in straight lines."""
    j = min(max(int(row), 0), table.shape[0] - 2)
    s = row - j
    near = table[j, k] + t * (table[j, k + 1] - table[j, k])
    far = table[j + 1, k] + t * (table[j + 1, k + 1] - table[j + 1, k])
    return float(near + s * (far - near))


@njit(cache=True)
def current_at(m: MapTables, flux: float, other: float, k: int, t: float) -> float:
    """Return `coil_current` at a column and share of `column_at` [A].

    Parameters
    ----------
    m : MapTables
        Tables of both coils.
    flux : float
        Flux linkage of the coil [Wb].
    other : float
        Current of the other coil [A].
    k : int
        Column of `column_at`.
    t : float
        Share of the way to the next column [1].
    """
    own = flux - m.mutual * other
    found = _bilinear(m.current, abs(own) * m.per_flux, k, t)
    return found if own >= 0.0 else -found


@njit(cache=True)
def force_at(m: MapTables, current: float, k: int, t: float) -> float:
    """Return `coil_force` at a column and share of `column_at` [N].

    Parameters
    ----------
    m : MapTables
        Tables of both coils.
    current : float
        Current of the coil [A].
    k : int
        Column of `column_at`.
    t : float
        Share of the way to the next column [1].
    """
    return _bilinear(m.force, abs(current) * m.per_current, k, t)


@njit(cache=True)
def coil_current(m: MapTables, flux: float, other: float, x: float) -> float:
    """Return i_s(psi, i_other, x) [A].

    Parameters
    ----------
    m : MapTables
        Curves of one coil.
    flux : float
        Flux linkage of the coil [Wb].
    other : float
        Current of the other coil [A].
    x : float
        Position, positive towards this coil [m]: coil B takes -x.
    """
    k, t = column_at(m, x)
    return current_at(m, flux, other, k, t)


@njit(cache=True)
def coil_force(m: MapTables, current: float, x: float) -> float:
    """Return the force of one coil towards positive x [N]; even in the current.

    Parameters
    ----------
    m : MapTables
        Curves of one coil.
    current : float
        Its current [A].
    x : float
        Position, positive towards this coil [m].
    """
    k, t = column_at(m, x)
    return force_at(m, current, k, t)


@njit(cache=True)
def coil_flux(m: MapTables, current: float, other: float, x: float) -> float:
    """Return psi with i_s(psi, other, x) = current [Wb].

    Parameters
    ----------
    m : MapTables
        Curves of one coil.
    current, other : float
        Its current and that of the other coil [A].
    x : float
        Position, positive towards this coil [m].
    """
    k, t = column_at(m, x)
    wanted = abs(current)
    low, high = 0, m.current.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if _bilinear(m.current, float(middle), k, t) < wanted:
            low = middle
        else:
            high = middle
    before = _bilinear(m.current, float(low), k, t)
    rise = _bilinear(m.current, float(high), k, t) - before
    share = (wanted - before) / rise if rise > 0.0 else 0.5
    flux = (low + share) / m.per_flux
    return float((flux if current >= 0.0 else -flux) + m.mutual * other)


def pole_curves(
    turns: float,
    pole_area: float,
    gap: float,
    saturation_flux: float,
    *,
    mutual: float,
    reach: float,
    largest_flux: float,
    largest_current: float,
) -> MapTables:
    """Return the curves of a pole with a gap and a saturating iron path.

    i(psi, x) = psi (gap - x) / K + (psi / psi_s)^9 with K = mu_0 N^2 A, so F = psi^2 / (2 K).

    Parameters
    ----------
    turns, pole_area, gap : float
        Turns [1], area of the pole [m^2], gap with the armature in the middle, residual gap
        included [m].
    saturation_flux : float
        Flux linkage at which the iron takes 1 A [Wb].
    mutual : float
        Mutual inductance of the coils [H].
    reach, largest_flux, largest_current : float
        Ranges of the tables: position [m], flux linkage [Wb], current [A].
    """
    constant = VACUUM * turns**2 * pole_area
    x_flux = np.linspace(-reach, reach, POSITION_NODES)
    flux = np.linspace(0.0, largest_flux, FLUX_NODES)
    iron = (flux / saturation_flux) ** SATURATION_EXPONENT
    current = flux[:, None] * (gap - x_flux[None, :]) / constant + iron[:, None]
    x_force = np.linspace(-reach, reach, POSITION_NODES)
    wanted = np.linspace(0.0, largest_current, CURRENT_NODES)[:, None]
    linear = (gap - x_force[None, :]) / constant
    psi = np.minimum(wanted / linear, 2.0 * saturation_flux)
    for _ in range(_NEWTON_STEPS):  # convex from above: it falls onto the root
        power = (psi / saturation_flux) ** (SATURATION_EXPONENT - 1)
        value = psi * linear + power * psi / saturation_flux - wanted
        slope = linear + SATURATION_EXPONENT * power / saturation_flux
        psi = psi - value / slope
    return _tables(
        current, psi**2 / (2.0 * constant), largest_flux, largest_current, reach, mutual
    )


def map_from_curves(curves: FluxCurves) -> MapTables:
    """Return the tables of given flux curves: force and inverse follow from their coenergy.

    Parameters
    ----------
    curves : FluxCurves
        At least 4 currents and 4 positions.

    Raises
    ------
    ValueError
        If they are no curves of a solenoid; the message names what, where and which value.
    """
    check_curves(curves)
    from scipy.interpolate import RectBivariateSpline  # slow to import

    i, x, reach = curves.current, curves.position, float(curves.position[-1])
    spline = RectBivariateSpline(i, x, curves.flux, kx=3, ky=3, s=0)
    x_force = np.linspace(-reach, reach, POSITION_NODES)
    fine = np.linspace(0.0, i[-1], 8 * (CURRENT_NODES - 1) + 1)
    slope = spline(fine, x_force, dx=0, dy=1)
    step = fine[1]
    simpson = step / 3.0 * (slope[:-2:2] + 4.0 * slope[1:-1:2] + slope[2::2])
    summed = np.concatenate([np.zeros((1, len(x_force))), np.cumsum(simpson, axis=0)])
    x_flux = np.linspace(-reach, reach, POSITION_NODES)
    psi = spline(fine, x_flux)
    if np.any(np.diff(psi, axis=0) <= 0.0):
        message = (
            "map_flux: the curve through the values does not rise with the current everywhere"
        )
        raise ValueError(message)
    largest = float(psi[-1].min())
    nodes = np.linspace(0.0, largest, FLUX_NODES)
    current = np.column_stack([np.interp(nodes, column, fine) for column in psi.T])
    return _tables(current, summed[::4], largest, float(i[-1]), reach, curves.mutual)


def check_curves(curves: FluxCurves) -> None:
    """Refuse what cannot be a solenoid's flux curves.

    Raises
    ------
    ValueError
        Names the list, the place and the value.
    """
    shape = (len(curves.current), len(curves.position))
    if min(shape) < 4 or curves.flux.shape != shape:
        message = (
            f"map_flux: {curves.flux.size} values for {shape[0]} currents and {shape[1]} "
            "positions; needs at least 4 of each and one value for every pair"
        )
        raise ValueError(message)
    for name, values in (("map_current", curves.current), ("map_position", curves.position)):
        bad = np.flatnonzero(~(np.diff(values) > 0.0))
        if len(bad):
            message = f"{name}[{bad[0] + 1}] = {values[bad[0] + 1]:g}: must rise"
            raise ValueError(message)
    if curves.current[0] != 0.0 or np.any(curves.flux[0] != 0.0):
        message = "map_current and map_flux: the first current must be 0, with a flux of 0"
        raise ValueError(message)
    if abs(curves.position[0] + curves.position[-1]) > 1e-9 * abs(curves.position[-1]):
        message = (
            f"map_position from {curves.position[0]:g} to {curves.position[-1]:g} m: "
            "must be symmetric about 0"
        )
        raise ValueError(message)
    for axis, what in ((0, "current"), (1, "position")):
        steps = np.diff(curves.flux[1:] if axis else curves.flux, axis=axis)
        bad_pairs = np.argwhere(~(steps > 0.0))
        if len(bad_pairs):
            j, k = (int(n) for n in bad_pairs[0])
            row, column = (j + 1, k + 1) if axis else (j + 1, k)
            message = (
                f"map_flux[{row}][{column}] = {curves.flux[row, column]:g} Wb: must rise with the "
                f"{what}"
            )
            raise ValueError(message)


def _tables(
    current: FloatArray,
    force: FloatArray,
    largest_flux: float,
    largest_current: float,
    reach: float,
    mutual: float,
) -> MapTables:
    return MapTables(
        current=np.ascontiguousarray(current),
        force=np.ascontiguousarray(force),
        per_flux=(FLUX_NODES - 1) / largest_flux,
        per_current=(CURRENT_NODES - 1) / largest_current,
        reach=reach,
        per_position=(POSITION_NODES - 1) / (2.0 * reach),
        mutual=mutual,
    )
