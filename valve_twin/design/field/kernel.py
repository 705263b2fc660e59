# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Compiled assembly of the field equations: P2 triangles, axisymmetric, exact tangent.

The vector potential A (azimuthal) minimises

    Pi(A) = integral of w(B) 2 pi r dA - sum of i psi(A)     B_r = -dA/dz, B_z = dA/dr + A/r

with w the energy density of the material: H(B) integrated; -Pi at the minimum is the coenergy.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray, IntArray


_NO_FIELD = 1e-12  # flux density below which the direction of B is none [T]


class Elements(NamedTuple):
    """What does not change between two assemblies.

    Attributes
    ----------
    triangles : (3, E) int array
        Corners.
    dofs : (6, E) int array
        Unknowns of each triangle, three corners and three edges.
    scatter : (E, 36) int array
        Where each entry of its matrix goes, -1 = nowhere.
    phi, d_phi : (6, Q), (2, 6, Q) arrays
        Shape functions and their slopes on the reference triangle.
    at, weights : (2, Q), (Q,) arrays
        Points of the quadrature on it, and their weights.
    steel : (E,) int array
        Which table, -1 = linear.
    nu, remanence : (E,), (E, 2) arrays
        Reluctivity [m/H] and remanence [T] of a linear material.
    tables : (T, N, 3) array
        H [A/m], dH/dB [m/H] and energy density [J/m^3] over B in even steps from 0.
    per_tesla : (T,) array
        Steps of each table a tesla.
    """

    triangles: IntArray
    dofs: IntArray
    scatter: IntArray
    phi: FloatArray
    d_phi: FloatArray
    at: FloatArray
    weights: FloatArray
    steel: IntArray
    nu: FloatArray
    remanence: FloatArray
    tables: FloatArray
    per_tesla: FloatArray


@njit(cache=True)
def steel_at(table: FloatArray, per_tesla: float, b: float) -> tuple[float, float, float]:
    """Return H [A/m], dH/dB [m/H] and energy density [J/m^3]; vacuum's slope beyond the table.

    Parameters
    ----------
    table : (N, 3) array
        As `Elements.tables`.
    per_tesla : float
        Steps a tesla [1/T].
    b : float
        Flux density, not negative [T].
    """
    last = table.shape[0] - 1
    place = b * per_tesla
    if place >= last:
        over = b - last / per_tesla
        nu = 1.0 / (4e-7 * math.pi)
        h0 = table[last, 0]
        return h0 + nu * over, nu, table[last, 2] + h0 * over + 0.5 * nu * over * over
    k = int(place)
    t = place - k
    step = 1.0 / per_tesla
    h0, h1 = table[k, 0], table[k + 1, 0]
    d0, d1 = table[k, 1] * step, table[k + 1, 1] * step
    c2 = 3.0 * (h1 - h0) - 2.0 * d0 - d1
    c3 = 2.0 * (h0 - h1) + d0 + d1
    h = h0 + t * (d0 + t * (c2 + t * c3))
    slope = (d0 + t * (2.0 * c2 + 3.0 * t * c3)) * per_tesla
    w = t * (h0 + t * (d0 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0))) * step
    return h, slope, table[k, 2] + w


@njit(cache=True)
def assemble(
    e: Elements, of: IntArray, points: FloatArray, a: FloatArray, residual: FloatArray,
    matrix: FloatArray,
) -> float:  # fmt: skip
    """Assemble slope and tangent of the energy of some triangles; return that energy [J].

    Parameters
    ----------
    e : Elements
        The mesh and its materials.
    of : (V,) int array
        Which triangles.
    points : (2, P) array
        Corners, moved [m].
    a : (N,) array
        Vector potential at the unknowns [Wb/m].
    residual : (N,) array
        Overwritten by the slope of the energy over the unknowns [A m].
    matrix : (M,) array
        Overwritten by the tangent's entries, as `scatter` says [A m^2/Wb].
    """
    residual[:] = 0.0
    matrix[:] = 0.0
    energy = 0.0
    br, bz, local = np.empty(6), np.empty(6), np.empty((6, 6))
    for k in of:
        i0, i1, i2 = e.triangles[0, k], e.triangles[1, k], e.triangles[2, k]
        r0, z0 = points[0, i0], points[1, i0]
        r1, z1 = points[0, i1] - r0, points[1, i1] - z0
        r2, z2 = points[0, i2] - r0, points[1, i2] - z0
        det = r1 * z2 - r2 * z1
        local[:] = 0.0
        for q in range(len(e.weights)):
            r = r0 + r1 * e.at[0, q] + r2 * e.at[1, q]
            b_r, b_z = 0.0, 0.0
            for n in range(6):
                s, t = e.d_phi[0, n, q], e.d_phi[1, n, q]
                br[n] = -(r1 * t - r2 * s) / det
                bz[n] = (z2 * s - z1 * t) / det + e.phi[n, q] / r
                value = a[e.dofs[n, k]]
                b_r += br[n] * value
                b_z += bz[n] * value
            weight = 2.0 * math.pi * r * abs(det) * e.weights[q]
            if e.steel[k] < 0:
                nu, bend = e.nu[k], 0.0
                b_r -= e.remanence[k, 0]
                b_z -= e.remanence[k, 1]
                w = 0.5 * nu * (b_r * b_r + b_z * b_z)
            else:
                b = math.sqrt(b_r * b_r + b_z * b_z)
                which = e.steel[k]
                h, slope, w = steel_at(e.tables[which], e.per_tesla[which], b)
                nu = h / b if b > _NO_FIELD else slope
                bend = (slope - nu) / (b * b) if b > _NO_FIELD else 0.0
            energy += weight * w
            for n in range(6):
                along = br[n] * b_r + bz[n] * b_z
                residual[e.dofs[n, k]] += weight * nu * along
                for m in range(n + 1):
                    both = br[n] * br[m] + bz[n] * bz[m]
                    other = br[m] * b_r + bz[m] * b_z
                    local[n, m] += weight * (nu * both + bend * along * other)
        for n in range(6):
            for m in range(6):
                place = e.scatter[k, 6 * n + m]
                if place >= 0:
                    matrix[place] += local[max(n, m), min(n, m)]
    return energy
