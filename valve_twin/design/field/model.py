# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The field problem of a section: mesh, unknowns, materials, coils, order of elimination."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.solenoid_map import VACUUM
from valve_twin.design.field.grid import Grid, make_grid
from valve_twin.design.field.kernel import Elements
from valve_twin.design.field.steady import Steady, make_steady
from valve_twin.design.materials import Linear, Magnet, Steel

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray, IntArray
    from valve_twin.design.geometry.section import Motion, Region, Section

_TABLE_STEPS = 300
_QUADRATURE = 4  # exact degree: 6 points


@dataclass(frozen=True, slots=True)
class FieldModel:
    """What every solution of a section shares.

    Attributes
    ----------
    section : Section
        What is computed.
    fine : float
        Elements along a line over those of the default mesh [1].
    grid : Grid
        The mesh at x = 0.
    elements : Elements
        For the compiled assembly.
    place : (N,) int array
        Row of each unknown in the matrix, -1 = held at 0.
    columns, rows : int arrays
        Pattern of the matrix in compressed columns.
    coils : (C, N) array
        Flux linkage of each coil over the unknowns [m].
    shift : (P,) array
        Movement of each corner over that of the armature [1].
    stretched : (S,) int array
        Triangles that a movement deforms.
    steady : Steady
        What nothing changes.
    """

    section: Section
    fine: float
    grid: Grid
    elements: Elements
    place: IntArray
    columns: IntArray
    rows: IntArray
    coils: FloatArray
    shift: FloatArray
    stretched: IntArray
    steady: Steady

    @property
    def unknowns(self) -> int:
        """How many unknowns are solved for."""
        return len(self.columns) - 1

    def moved(self, position: float) -> FloatArray:
        """Return the corners (2, P) with the armature at a position [m].

        Parameters
        ----------
        position : float
            Shift of the armature along the axis [m].

        Raises
        ------
        ValueError
            If it is beyond the stroke.
        """
        m = self.section.motion
        most = 0.0 if m is None else m.stroke
        if not abs(position) <= most * (1.0 + 1e-6):
            message = f"position = {position:g}: must be from {-most:g} to {most:g} [m]"
            raise ValueError(message)
        points = self.grid.points.copy()
        points[1] += position * self.shift
        return points


def make_model(section: Section, fine: float = 1.0, skin: float = math.inf) -> FieldModel:
    """Return the field problem of a section.

    Parameters
    ----------
    section : Section
        What is computed.
    fine : float
        Elements along a line over those of the default mesh [1].
    skin : float
        Largest size of elements at the surfaces of regions, for eddy currents [m].

    Raises
    ------
    ValueError
        If the mesh cannot be made, or the air that a movement stretches holds more than air.
    """
    import skfem

    grid = make_grid(section, fine, skin)
    mesh = skfem.MeshTri(grid.points, grid.triangles)
    basis = skfem.Basis(mesh, skfem.ElementTriP2(), intorder=_QUADRATURE)
    dofs = np.asarray(basis.element_dofs, dtype=np.int64)
    at, weights = (np.asarray(part, dtype=np.float64) for part in basis.quadrature)
    shapes = [basis.elem.lbasis(at, n) for n in range(6)]
    r, z = basis.doflocs
    held = (r < 1e-12) | np.isclose(r, section.radius, rtol=1e-9)
    held |= np.isclose(z, section.low, rtol=1e-9) | np.isclose(z, section.high, rtol=1e-9)
    place, columns, rows, scatter = _pattern(dofs, held)
    steel, nu, remanence = _materials(section, grid)
    tables, per_tesla = _tables(section)
    elements = Elements(
        triangles=np.ascontiguousarray(grid.triangles),
        dofs=np.ascontiguousarray(dofs),
        scatter=scatter,
        phi=np.array([phi for phi, _ in shapes]),
        d_phi=np.ascontiguousarray(np.swapaxes(np.array([d for _, d in shapes]), 0, 1)),
        at=np.ascontiguousarray(at),
        weights=np.ascontiguousarray(weights),
        steel=steel,
        nu=nu,
        remanence=remanence,
        tables=tables,
        per_tesla=per_tesla,
    )
    shift = _shift(section, grid)
    ends = shift[grid.triangles]
    stretched = np.flatnonzero(np.ptp(ends, axis=0) > 0.0)
    _check_stretched(section, grid, ends, stretched)
    coils = _coils(section, grid, elements, len(held))
    steady = make_steady(elements, grid.points, stretched, (len(held), len(rows)))
    return FieldModel(
        section, fine, grid, elements, place, columns, rows, coils, shift, stretched, steady
    )


def _pattern(dofs: IntArray, held: BoolArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Return the numbers of the unknowns, the matrix's pattern, and where each entry goes."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    first = np.full(len(held), -1)
    count = int(np.sum(~held))
    first[~held] = np.arange(count)
    row, column = _entries(first, dofs)
    used = (row >= 0) & (column >= 0)
    ones = np.ones(int(used.sum()))
    graph = csc_array((ones, (row[used], column[used])), shape=(count, count))
    graph.data[:] = -1.0
    graph.setdiag(graph.shape[0])
    order = splu(graph, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).perm_c
    place = np.full(len(held), -1)
    place[~held] = order
    row, column = _entries(place, dofs)
    used = (row >= 0) & (column >= 0)
    keys, where = np.unique(column[used] * count + row[used], return_inverse=True)
    scatter = np.full(len(row), -1)
    scatter[used] = where
    columns = np.searchsorted(keys, np.arange(count + 1) * count)
    return place, columns, keys % count, scatter.reshape(-1, 36)


def _entries(place: IntArray, dofs: IntArray) -> tuple[IntArray, IntArray]:
    at = place[dofs.T]
    return np.repeat(at, 6, axis=1).ravel(), np.tile(at, (1, 6)).ravel()


def _materials(section: Section, grid: Grid) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return table of steel, reluctivity and remanence of each triangle."""
    count = grid.triangles.shape[1]
    steel, nu = np.full(count, -1), np.full(count, 1.0 / VACUUM)
    remanence = np.zeros((count, 2))
    steels = _steels(section)
    for k, region in enumerate(section.regions):
        of, material = grid.region == k, section.materials[region.material]
        if isinstance(material, Steel):
            steel[of] = steels.index(material)
            continue
        nu[of] = 1.0 / (material.permeability * VACUUM)
        if isinstance(material, Magnet):
            remanence[of, int(material.direction == "axial")] = material.remanence
    return steel, nu, remanence


def _tables(section: Section) -> tuple[FloatArray, FloatArray]:
    """Return the tables of all steels and their steps a tesla."""
    made = [steel_table(m) for m in _steels(section)] or [(np.zeros((2, 3)), 1.0)]
    return np.array([table for table, _ in made]), np.array([steps for _, steps in made])


def _steels(section: Section) -> list[Steel]:
    return [m for m in section.materials.values() if isinstance(m, Steel)]


def steel_table(steel: Steel) -> tuple[FloatArray, float]:
    """Return H, dH/dB and energy density over B in even steps, and the steps a tesla.

    Parameters
    ----------
    steel : Steel
        The material.

    Returns
    -------
    table : (301, 3) array
        See `Elements.tables`.
    per_tesla : float
        Steps a tesla [1/T].
    """
    from scipy.interpolate import PchipInterpolator

    h, b = steel.curve()
    curve = PchipInterpolator(b, h)
    nodes = np.linspace(0.0, b[-1], _TABLE_STEPS + 1)
    step = nodes[1]
    field, slope = curve(nodes), np.minimum(curve(nodes, 1), 1.0 / VACUUM)
    if steel.table_b == ():
        slope[0] = h[1] / b[1]
    slope = np.maximum(slope, 1e-6 / VACUUM)
    secant = np.diff(field) / step  # a Hermite curve rises where its slopes are at most 3 secants
    slope[:-1] = np.minimum(slope[:-1], 3.0 * secant)
    slope[1:] = np.minimum(slope[1:], 3.0 * secant)
    parts = step * (0.5 * (field[1:] + field[:-1]) + step / 12.0 * (slope[:-1] - slope[1:]))
    energy = np.concatenate([[0.0], np.cumsum(parts)])
    return np.column_stack([field, slope, energy]), 1.0 / step


def _shift(section: Section, grid: Grid) -> FloatArray:
    """Return how far each corner moves with the armature [1]."""
    m = section.motion
    r, z = grid.points
    if m is None:
        return np.zeros(len(r))
    # the lines of the grid are those of the corners up to rounding
    around = np.interp(r, [m.radius, m.still_radius], [1.0, 0.0])
    along = np.interp(z, [m.still_low, m.low, m.high, m.still_high], [0.0, 1.0, 1.0, 0.0])
    found: FloatArray = around * along
    found[found < 1e-9] = 0.0
    found[found > 1.0 - 1e-9] = 1.0
    return found


def _check_stretched(section: Section, grid: Grid, ends: FloatArray, stretched: IntArray) -> None:
    """Refuse a movement that deforms what is no air, or moves a coil or a part of a region."""
    for k, region in enumerate(section.regions):
        of = grid.region == k
        of_air = section.materials[region.material] == Linear()
        if of_air and not region.coil:
            continue
        moves = ends[:, of]
        if np.isin(stretched, np.flatnonzero(of)).any() or np.ptp(moves) > 0.0:
            raise ValueError(_in_the_way(region, section.motion))
        if region.coil and moves.any():
            message = f"{region.name}: a coil cannot move: keep it outside motion.still_radius"
            raise ValueError(message)


def _in_the_way(region: Region, m: Motion | None) -> str:
    """Return where a region lies that the motion would deform, and where it must not lie."""
    r, z = zip(*region.outline, strict=True)
    at = f"r = {min(r):g} to {max(r):g}, z = {min(z):g} to {max(z):g}"
    if m is None:
        return f"{region.name}: {at} [m] lies in the air that the motion stretches: move it out"
    return (
        f"{region.name}: {at} lies in the air that the motion stretches, r below "
        f"{m.still_radius:g} and z from {m.still_low:g} to {m.still_high:g} except r below "
        f"{m.radius:g} and z from {m.low:g} to {m.high:g} [m]: move it out"
    )


def _coils(section: Section, grid: Grid, elements: Elements, count: int) -> FloatArray:
    """Return the flux linkage of each coil over the unknowns [m]."""
    found = np.zeros((len(section.coils), count))
    corners = grid.points[:, grid.triangles]
    side1, side2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.abs(side1[0] * side2[1] - side1[1] * side2[0])
    radius = corners[0, 0, :, None] + side1[0, :, None] * elements.at[0]
    radius += side2[0, :, None] * elements.at[1]
    for k, region in enumerate(section.regions):
        if not region.coil:
            continue
        of = grid.region == k
        density = region.turns / area[of].sum()
        weight = 4.0 * np.pi * density * area[of, None] * radius[of] * elements.weights
        share = weight @ elements.phi.T
        np.add.at(found[section.coils.index(region.coil)], elements.dofs[:, of].T, share)
    return found
