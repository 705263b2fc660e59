# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Characteristic curves of coupled coils from one coenergy: W'(i_1, .., i_C, x).

    psi_k = dW'/di_k      F = dW'/dx      L_kl = d2W'/(di_k di_l)

W' is piecewise cubic in every variable with continuous first derivatives, so flux linkages and
force are continuous, dF/di_k = dpsi_k/dx holds exactly, and no closed cycle makes energy. At the
nodes it has the values and slopes of a field computation. Paper 000, section 2.1, takes psi and F
from two tables; then the Maxwell relation holds only as well as the tables do.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from scipy.interpolate import NdBSpline

    from valve_twin.core.types import FloatArray

_DEGREE = 3
_HALVINGS = 60
_CHECKED = 4  # places between two nodes at which the inductance is looked at
_BEYOND = 1e-9  # of a range that rounding may leave it by [1]


@dataclass(frozen=True, slots=True)
class CoenergyMap:
    """Coenergy of C coils (1 or 2) over their currents and a position.

    Attributes
    ----------
    coils : tuple of str
        Names of the coils.
    currents, positions : (I,), (X,) arrays
        Nodes of each current, from 0, and of the position, rising [A], [m].
    coefficients : (2 I, .., 2 X) array
        Of the spline [J].
    provenance : mapping
        What it was computed from and with.
    """

    coils: tuple[str, ...]
    currents: FloatArray
    positions: FloatArray
    coefficients: FloatArray
    provenance: Mapping[str, object]
    _spline: NdBSpline = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the spline."""
        from scipy.interpolate import NdBSpline  # slow to import

        axes = (*[self.currents] * len(self.coils), self.positions)
        knots = tuple(double_knots(nodes) for nodes in axes)
        object.__setattr__(self, "_spline", NdBSpline(knots, self.coefficients, _DEGREE))

    def coenergy(self, currents: FloatArray, position: FloatArray) -> FloatArray:
        """Return the coenergy (N,) [J]; parameters as `flux`."""
        return self._slope(currents, position, (0,) * (len(self.coils) + 1))

    def flux(self, currents: FloatArray, position: FloatArray) -> FloatArray:
        """Return the flux linkages (N, C) [Wb].

        Parameters
        ----------
        currents : (N, C) array
            Of the coils [A].
        position : (N,) array
            Of the armature [m].

        Raises
        ------
        ValueError
            If a value lies beyond the map, named with its range, or shapes do not fit.
        """
        coils = range(len(self.coils))
        return np.stack([self._slope(currents, position, self._order(k)) for k in coils], axis=-1)

    def force(self, currents: FloatArray, position: FloatArray) -> FloatArray:
        """Return the force towards positive x (N,) [N]; parameters as `flux`."""
        return self._slope(currents, position, self._order(len(self.coils)))

    def inductance(self, currents: FloatArray, position: FloatArray) -> FloatArray:
        """Return the tangent inductances (N, C, C) [H]; parameters as `flux`."""
        coils = range(len(self.coils))
        rows = [
            np.stack([self._slope(currents, position, self._order(k, m)) for m in coils], axis=-1)
            for k in coils
        ]
        return np.stack(rows, axis=-2)

    def current(
        self, coil: int, flux: FloatArray, others: FloatArray, position: FloatArray
    ) -> FloatArray:
        """Return i_s(psi, i_other, x) of a coil, (N,) [A]: the inverse of `flux`, which rises.

        Parameters
        ----------
        coil : int
            Which coil.
        flux : (N,) array
            Its flux linkage [Wb].
        others : (N, C) array
            Currents; that of the coil itself is ignored [A].
        position : (N,) array
            Of the armature [m].

        Raises
        ------
        ValueError
            If the flux linkage needs a current beyond the map.
        """
        flux = np.asarray(flux, dtype=np.float64)
        guess = np.array(others, dtype=np.float64)
        low, high = np.zeros(len(flux)), np.full(len(flux), self.currents[-1])
        ends = []
        for value in (low, high):
            guess[:, coil] = value
            ends.append(self._slope(guess, position, self._order(coil)))
        tolerance = _BEYOND * np.abs(ends[1])
        bad = np.flatnonzero(~((flux >= ends[0] - tolerance) & (flux <= ends[1] + tolerance)))
        if len(bad):
            n = int(bad[0])
            message = (
                f"psi_{self.coils[coil]} = {flux[n]:g}: beyond the map, from {ends[0][n]:g} to "
                f"{ends[1][n]:g} [Wb] there"
            )
            raise ValueError(message)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            guess[:, coil] = middle
            above = self._slope(guess, position, self._order(coil)) > flux
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        found: FloatArray = 0.5 * (low + high)
        return found

    def on_nodes(self, currents: FloatArray, positions: FloatArray) -> CoenergyMap:
        """Return the map on other nodes within its own, with its values and slopes there.

        Parameters
        ----------
        currents, positions : (I,), (X,) arrays
            Rising [A], [m].

        Raises
        ------
        ValueError
            If a node lies beyond the map; names it and the range.
        """
        axes = (*[currents] * len(self.coils), positions)
        grid = np.meshgrid(*axes, indexing="ij")
        at = np.column_stack([of.ravel() for of in grid[:-1]]), grid[-1].ravel()
        values = np.empty(tuple(2 * len(nodes) for nodes in axes))
        for order in np.ndindex(*[2] * len(axes)):
            part = tuple(slice(slope, None, 2) for slope in order)
            values[part] = self._slope(*at, order).reshape(grid[0].shape)
        return replace(
            self,
            currents=currents,
            positions=positions,
            coefficients=spline_coefficients(values, axes),
        )

    def _order(self, *axes: int) -> tuple[int, ...]:
        return tuple(axes.count(k) for k in range(len(self.coils) + 1))

    def _slope(
        self, currents: FloatArray, position: FloatArray, order: tuple[int, ...]
    ) -> FloatArray:
        coils = ", ".join(self.coils)
        if np.ndim(currents) != 2 or np.shape(currents) != (np.size(position), len(self.coils)):
            message = (
                f"currents of shape {np.shape(currents)}, {np.size(position)} positions: must be "
                f"a row for each position, a column for each coil, {coils}"
            )
            raise ValueError(message)
        points = np.column_stack([currents, position]).astype(np.float64)
        names = [f"i_{name}" for name in self.coils] + ["x"]
        for column, name in enumerate(names):
            nodes, unit = (self.positions, "m") if name == "x" else (self.currents, "A")
            spare = _BEYOND * (nodes[-1] - nodes[0])
            value = points[:, column]
            bad = np.flatnonzero(~((value >= nodes[0] - spare) & (value <= nodes[-1] + spare)))
            if len(bad):
                message = (
                    f"{name} = {value[bad[0]]:g}: beyond the map, from {nodes[0]:g} to "
                    f"{nodes[-1]:g} [{unit}]"
                )
                raise ValueError(message)
            np.clip(value, nodes[0], nodes[-1], out=value)
        found: FloatArray = self._spline(points, nu=order)
        return found


def double_knots(nodes: FloatArray) -> FloatArray:
    """Return the knots (2 N + 4,) of cubics that meet at N nodes with one derivative."""
    ends = nodes[:1], nodes[-1:]
    return np.concatenate(
        [np.repeat(ends[0], 4), np.repeat(nodes[1:-1], 2), np.repeat(ends[1], 4)]
    )


def spline_coefficients(values: FloatArray, axes: tuple[FloatArray, ...]) -> FloatArray:
    """Return the coefficients of the spline with given values and slopes at its nodes.

    Parameters
    ----------
    values : (2 N, 2 M, ..) array
        Along each axis alternately value and slope at a node, so that [0::2, 1::2] holds slopes
        over the second variable and [1::2, 1::2] mixed ones [J over the units of the axes].
    axes : tuple of arrays
        Nodes (N,), (M,), .. of each variable [A], [m].
    """
    from scipy.interpolate import BSpline

    for axis, nodes in enumerate(axes):
        count = 2 * len(nodes)
        basis = BSpline(double_knots(nodes), np.eye(count), _DEGREE)
        matrix = np.empty((count, count))
        matrix[0::2], matrix[1::2] = basis(nodes), basis(nodes, nu=1)
        along: FloatArray = np.moveaxis(values, axis, 0)
        solved = np.asarray(np.linalg.solve(matrix, along.reshape(count, -1)), dtype=np.float64)
        values = np.moveaxis(solved.reshape(along.shape), 0, axis)
    return np.ascontiguousarray(values)


def linear_map(
    own: float, mutual: float, gap: float, currents: int, positions: int
) -> CoenergyMap:
    """Return the map of two coils without iron: what is known of it is exact.

    W' = L (i_A^2 (1 + x/x0) + i_B^2 (1 - x/x0))/2 + M i_A i_B, to 3 A and 1 mm.

    Parameters
    ----------
    own, mutual : float
        L and M [H].
    gap : float
        x0, above 1 mm [m].
    currents, positions : int
        Nodes [1].
    """
    i, places = np.linspace(0.0, 3.0, currents), np.linspace(-1e-3, 1e-3, positions)
    a, b, x = np.meshgrid(i, i, places / gap, indexing="ij")
    slopes = np.zeros(tuple(2 * n for n in a.shape))
    slopes[0::2, 0::2, 0::2] = 0.5 * own * (a**2 * (1 + x) + b**2 * (1 - x)) + mutual * a * b
    slopes[1::2, 0::2, 0::2] = own * a * (1 + x) + mutual * b
    slopes[0::2, 1::2, 0::2] = own * b * (1 - x) + mutual * a
    slopes[0::2, 0::2, 1::2] = 0.5 * own * (a**2 - b**2) / gap
    slopes[1::2, 1::2, 0::2] = mutual
    slopes[1::2, 0::2, 1::2], slopes[0::2, 1::2, 1::2] = own * a / gap, -own * b / gap
    return CoenergyMap(("A", "B"), i, places, spline_coefficients(slopes, (i, i, places)), {})


def check_inductances(curves: CoenergyMap) -> float:
    """Return the least tangent inductance of a coil alone, also between the nodes [H].

    Raises
    ------
    ValueError
        If a flux linkage falls with its current somewhere: it would have no inverse.
    """
    steps = [_between(curves.currents)] * len(curves.coils)
    grid = np.meshgrid(*steps, _between(curves.positions), indexing="ij")
    currents = np.column_stack([axis.ravel() for axis in grid[:-1]])
    position = grid[-1].ravel()
    least = np.inf
    for k, name in enumerate(curves.coils):
        own = curves.inductance(currents, position)[:, k, k]
        n = int(own.argmin())
        if not own[n] > 0.0:
            message = (
                f"psi_{name} falls with its current at {currents[n].tolist()} A, x = "
                f"{position[n]:g} m: compute the map at more currents"
            )
            raise ValueError(message)
        least = min(least, float(own[n]))
    return least


def _between(nodes: FloatArray) -> FloatArray:
    """Return nodes and places between them; at a node both sides are looked at."""
    parts = np.linspace(1e-6, 1.0 - 1e-6, _CHECKED)
    found: FloatArray = (nodes[:-1, None] + parts * np.diff(nodes)[:, None]).ravel()
    return found
