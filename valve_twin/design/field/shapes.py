# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Flux density and other fields inside triangles, outside the compiled assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.design.field.model import FieldModel


class Shapes(NamedTuple):
    """Of S triangles at their Q points of quadrature.

    Attributes
    ----------
    b_r, b_z : (6, S, Q) arrays
        Flux density over the potential at the unknowns [1/m].
    weight : (S, Q) array
        Volume that a point stands for [m^3].
    slope_r, slope_z : (3, S) arrays
        Slopes of the linear functions that are 1 at a corner [1/m].
    radius, along : (S, Q) arrays
        Places of the points [m].
    """

    b_r: FloatArray
    b_z: FloatArray
    weight: FloatArray
    slope_r: FloatArray
    slope_z: FloatArray
    radius: FloatArray
    along: FloatArray


def shapes_at(model: FieldModel, points: FloatArray, of: IntArray) -> Shapes:
    """Return the shape functions of some triangles.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    points : (2, P) array
        Corners, moved [m].
    of : (S,) int array
        Which triangles.
    """
    e = model.elements
    (r0, z0), (r1, z1), (r2, z2) = (points[:, e.triangles[k, of]] for k in range(3))
    r1, z1, r2, z2 = r1 - r0, z1 - z0, r2 - r0, z2 - z0
    det = r1 * z2 - r2 * z1
    radius = r0[:, None] + r1[:, None] * e.at[0] + r2[:, None] * e.at[1]
    along = z0[:, None] + z1[:, None] * e.at[0] + z2[:, None] * e.at[1]
    s, t = e.d_phi[0][:, None, :], e.d_phi[1][:, None, :]
    d = det[:, None]
    b_r = -(r1[:, None] * t - r2[:, None] * s) / d
    b_z = (z2[:, None] * s - z1[:, None] * t) / d + e.phi[:, None, :] / radius
    weight = 2.0 * np.pi * radius * np.abs(d) * e.weights
    slope_r = np.array([z1 - z2, z2, -z1]) / det
    slope_z = np.array([r2 - r1, -r2, r1]) / det
    return Shapes(b_r, b_z, weight, slope_r, slope_z, radius, along)


def flux_density(
    model: FieldModel, points: FloatArray, potential: FloatArray, of: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return B_r and B_z of some triangles at their points, (S, Q) each [T].

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    points : (2, P) array
        Corners, moved [m].
    potential : (N,) array
        Vector potential at the unknowns [Wb/m].
    of : (S,) int array
        Which triangles.
    """
    shapes = shapes_at(model, points, of)
    values = potential[model.elements.dofs[:, of]]
    b_r: FloatArray = np.einsum("neq,ne->eq", shapes.b_r, values)
    b_z: FloatArray = np.einsum("neq,ne->eq", shapes.b_z, values)
    return b_r, b_z
