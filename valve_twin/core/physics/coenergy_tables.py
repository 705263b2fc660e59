# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A coenergy map of two coils as compiled tables: i_s(psi, i_other, x) and F(i_A, i_B, x).

Even grids, linear between their nodes, so that finding a cell takes no search. Beyond the largest
current, and below none, the flux linkages go on in straight lines with the tangent inductance at
the edge, and the force with the coenergy of these lines: the Maxwell relation holds there as well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.physics.coenergy import CoenergyMap, double_knots
from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

FLUX_NODES, OTHER_NODES = 129, 25
FORCE_NODES, PLACE_NODES = 65, 49

BEYOND = 0.1
"""How far the tables reach beyond the currents of the map on either side, of its largest [1]."""

_FINE = 8  # places between two nodes of flux at which the curve is inverted
_COILS = 2


class CoenergyTables(NamedTuple):
    """Curves of two coils on even grids, as the compiled functions take them.

    Attributes
    ----------
    current_a, current_b : (FLUX_NODES, OTHER_NODES, PLACE_NODES) arrays
        Current of a coil over its flux linkage, the other's current and the position [A].
    force : (FORCE_NODES, FORCE_NODES, PLACE_NODES) array
        Force over both currents and the position [N].
    low_flux, per_flux : float
        First node [Wb] and nodes a weber.
    low_current, per_other, per_current : float
        First node of the currents [A], nodes an ampere of the other current and of the force.
    reach, per_position : float
        Largest position [m], nodes a metre.
    largest : float
        Largest current of the map [A].
    """

    current_a: FloatArray
    current_b: FloatArray
    force: FloatArray
    low_flux: float
    per_flux: float
    low_current: float
    per_other: float
    per_current: float
    reach: float
    per_position: float
    largest: float


@njit(cache=True)
def cell(place: float, nodes: int) -> tuple[int, float]:
    """Return the node before a place counted in nodes and the share to the next [1].

    Parameters
    ----------
    place : float
        Counted from the first node; beyond the grid the share leaves 0..1.
    nodes : int
        How many there are.
    """
    k = min(max(int(place), 0), nodes - 2)
    return k, place - k


@njit(cache=True)
def trilinear(table: FloatArray, row: float, column: float, k: int, t: float) -> float:
    """Interpolate between the eight nodes around; beyond the table go on in straight lines.

    Parameters
    ----------
    table : (N, M, PLACE_NODES) array
        Values [A] or [N].
    row, column : float
        Place along the first two axes, counted in nodes [1].
    k, t : int, float
        Cell along the third, see `cell` [1].
    """
    i, r = cell(row, table.shape[0])
    j, c = cell(column, table.shape[1])
    one = np.uint64(1)  # indices without a sign need no check whether they count from the end
    a, b, d = np.uint64(i), np.uint64(j), np.uint64(k)
    e = d + one
    near = table[a, b, d] + t * (table[a, b, e] - table[a, b, d])
    beside = table[a, b + one, d] + t * (table[a, b + one, e] - table[a, b + one, d])
    a += one
    far = table[a, b, d] + t * (table[a, b, e] - table[a, b, d])
    across = table[a, b + one, d] + t * (table[a, b + one, e] - table[a, b + one, d])
    first = near + c * (beside - near)
    return float(first + r * (far + c * (across - far) - first))


@njit(cache=True)
def flux_in(m: CoenergyTables, table: FloatArray, current: float, other: float, x: float) -> float:
    """Return the flux linkage at which a table of currents has a current [Wb].

    Parameters
    ----------
    m : CoenergyTables
        Grids.
    table : (FLUX_NODES, OTHER_NODES, PLACE_NODES) array
        Of the coil [A].
    current, other : float
        Of the coil and of the other one [A].
    x : float
        Position [m].
    """
    k, t = cell((x + m.reach) * m.per_position, table.shape[2])
    column = (other - m.low_current) * m.per_other
    low, high = 0, table.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if trilinear(table, float(middle), column, k, t) > current:
            high = middle
        else:
            low = middle
    before = trilinear(table, float(low), column, k, t)
    after = trilinear(table, float(high), column, k, t)
    share = (current - before) / (after - before)
    return float(m.low_flux + (low + share) / m.per_flux)


def make_tables(curves: CoenergyMap) -> CoenergyTables:
    """Return the tables of a map of two coils.

    Parameters
    ----------
    curves : CoenergyMap
        Two coils, positions symmetric about 0.

    Raises
    ------
    ValueError
        If it has another number of coils, other positions, or a flux linkage that falls with its
        current.
    """
    reach = float(curves.positions[-1])
    if len(curves.coils) != _COILS:
        message = f"map of {len(curves.coils)} coils: this valve has {_COILS}"
        raise ValueError(message)
    if abs(curves.positions[0] + reach) > 1e-9 * reach:
        message = (
            f"map_position from {curves.positions[0]:g} to {reach:g} m: must be symmetric about 0"
        )
        raise ValueError(message)
    largest = float(curves.currents[-1])
    low, high = -BEYOND * largest, (1.0 + BEYOND) * largest
    others = np.linspace(low, high, OTHER_NODES)
    fine = np.linspace(low, high, _FINE * (FLUX_NODES - 1) + 1)
    places = np.linspace(-reach, reach, PLACE_NODES)
    flux = [_evaluate(curves, (fine, others, places), (1, 0, 0)),
            np.swapaxes(_evaluate(curves, (others, fine, places), (0, 1, 0)), 0, 1)]  # fmt: skip
    for name, values in zip(curves.coils, flux, strict=True):
        bad = np.argwhere(~(np.diff(values, axis=0) > 0.0))
        if len(bad):
            i, j, k = bad[0]
            message = (
                f"map_coenergy: psi_{name} falls with its current at {fine[i]:.3g} A, "
                f"{others[j]:.3g} A in the other coil and x = {places[k]:.3g} m"
            )
            raise ValueError(message)
    ends = min(float(f[0].min()) for f in flux), max(float(f[-1].max()) for f in flux)
    nodes = np.linspace(*ends, FLUX_NODES)
    currents = np.linspace(low, high, FORCE_NODES)
    return CoenergyTables(
        current_a=_inverse(flux[0], fine, nodes),
        current_b=_inverse(flux[1], fine, nodes),
        force=np.ascontiguousarray(_evaluate(curves, (currents, currents, places), (0, 0, 1))),
        low_flux=ends[0],
        per_flux=(FLUX_NODES - 1) / (ends[1] - ends[0]),
        low_current=low,
        per_other=(OTHER_NODES - 1) / (high - low),
        per_current=(FORCE_NODES - 1) / (high - low),
        reach=reach,
        per_position=(PLACE_NODES - 1) / (2.0 * reach),
        largest=largest,
    )


def coupling_of(m: CoenergyTables) -> float:
    """Return by how much the current of a coil changes at most with the other's [1]."""
    steps = [np.abs(np.diff(table, axis=1)).max() for table in (m.current_a, m.current_b)]
    return float(max(steps)) * m.per_other


def _inverse(flux: FloatArray, current: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return currents (FLUX_NODES, M, X) at flux linkages, with straight lines beyond."""
    out = np.empty((len(nodes), *flux.shape[1:]))
    width = nodes[-1] - nodes[0]
    for j, k in np.ndindex(flux.shape[1:]):
        psi = flux[:, j, k]
        first, last = (current[[1, -1]] - current[[0, -2]]) / (psi[[1, -1]] - psi[[0, -2]])
        along = np.concatenate([[psi[0] - width], psi, [psi[-1] + width]])
        value = np.concatenate(
            [[current[0] - width * first], current, [current[-1] + width * last]]
        )
        out[:, j, k] = np.interp(nodes, along, value)
    return out


def _evaluate(
    curves: CoenergyMap, axes: tuple[FloatArray, ...], order: tuple[int, ...]
) -> FloatArray:
    """Return a slope of the coenergy on a grid, one factor an axis."""
    nodes = (*[curves.currents] * _COILS, curves.positions)
    rows = [_factor(*one) for one in zip(nodes, axes, order, strict=True)]
    found: FloatArray = np.einsum("ai,bj,ck,ijk->abc", *rows, curves.coefficients, optimize=True)
    return found


def _factor(nodes: FloatArray, at: FloatArray, order: int) -> FloatArray:
    """Return a slope of the basis functions (P, 2 N), their parabolas at the edge beyond it."""
    from scipy.interpolate import BSpline

    basis = BSpline(double_knots(nodes), np.eye(2 * len(nodes)), 3)
    inside = np.clip(at, nodes[0], nodes[-1])
    beyond = (at - inside)[:, None]
    found: FloatArray = basis(inside, nu=order)
    if order < 2 and beyond.any():
        found = found + np.where(beyond == 0.0, 0.0, basis(inside, nu=order + 1) * beyond)
    if order == 0 and beyond.any():
        found = found + np.where(beyond == 0.0, 0.0, 0.5 * basis(inside, nu=2) * beyond**2)
    return found
