# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Static fields: flux linkages, force by virtual work, inductances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.solenoid_map import VACUUM
from valve_twin.design.field.excitation import check_currents
from valve_twin.design.field.newton import CLOSE, minimise
from valve_twin.design.field.shapes import shapes_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel
    from valve_twin.design.field.tangent import Tangent

_SOLVED = 1e-7  # to which slopes over the currents are solved [1]


@dataclass(frozen=True, slots=True)
class Field:
    """A solution.

    Attributes
    ----------
    model : FieldModel
        What was computed.
    currents : (C,) array
        Of the coils [A].
    position : float
        Of the armature [m].
    potential : (N,) array
        Vector potential at the unknowns [Wb/m].
    potential_slope : (C, N) array
        Its slope over the currents [H/m].
    flux : (C,) array
        Flux linkages [Wb].
    energy, coenergy : float
        Of the field, that of magnets included [J].
    force : float
        On the armature towards +z [N].
    inductance : (C, C) array
        Slope of the flux linkages over the currents [H].
    force_slope : (C,) array
        Slope of the force over the currents [N/A]: that of the flux linkages over the position.
    steps : int
        Newton's.
    """

    model: FieldModel
    currents: FloatArray
    position: float
    potential: FloatArray
    potential_slope: FloatArray
    flux: FloatArray
    energy: float
    coenergy: float
    force: float
    inductance: FloatArray
    force_slope: FloatArray
    steps: int


def solve_field(
    model: FieldModel,
    currents: Sequence[float] | FloatArray,
    position: float = 0.0,
    start: FloatArray | None = None,
    tangent: Tangent | None = None,
    close: float = CLOSE,
) -> Field:
    """Return the field at given currents and position.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    currents : (C,) sequence of float
        Of the coils in the order of `Section.coils` [A].
    position : float
        Of the armature [m].
    start : (N,) array, optional
        Vector potential near the solution [Wb/m]; default 0.
    tangent : Tangent, optional
        Of a field near, whose factors may serve; goes on to those of this one.
    close : float
        As of `minimise`.

    Raises
    ------
    ValueError
        If currents or position do not fit the section, no coil bears them, or no solution is
        found.
    """
    i = np.asarray(currents, dtype=np.float64)
    if i.shape != (len(model.section.coils),) or not np.isfinite(i).all():
        names = ", ".join(model.section.coils) or "of which there is none"
        message = f"currents = {i.tolist()}: must be one finite number for each coil, {names} [A]"
        raise ValueError(message)
    check_currents(model.section, i)
    points = model.moved(position)
    a = np.zeros(model.coils.shape[1]) if start is None else start
    try:
        found = minimise(model, points, a, i @ model.coils, tangent=tangent, close=close)
    except ValueError as err:
        message = f"currents = {i.tolist()} A, position = {position:g} m: {err}"
        raise ValueError(message) from err
    a = found.potential
    flux = model.coils @ a
    slopes = potential_slopes(model, found.tangent, _SOLVED)
    force, force_over_a = force_of(model, points, a)
    return Field(
        model=model,
        currents=i,
        position=position,
        potential=a,
        potential_slope=slopes,
        flux=flux,
        energy=found.energy,
        coenergy=float(i @ flux) - found.energy,
        force=force,
        inductance=model.coils @ slopes.T,
        force_slope=slopes @ force_over_a,
        steps=found.steps,
    )


def potential_slopes(model: FieldModel, tangent: Tangent, close: float) -> FloatArray:
    """Return the slopes (C, N) of the potential over the currents of the coils [H/m].

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    tangent : Tangent
        At the field.
    close : float
        Largest error, as of `Tangent.solve` [1].
    """
    free = model.place >= 0
    order = model.place[free]
    slopes = np.zeros(model.coils.shape)
    for slope, of in zip(slopes, model.coils, strict=True):
        row = np.zeros(model.unknowns)
        row[order] = of[free]
        slope[free] = tangent.solve(row, close)[order]
    return slopes


def force_of(model: FieldModel, points: FloatArray, a: FloatArray) -> tuple[float, FloatArray]:
    """Return the force on the armature by virtual work, and its slope over the unknowns.

    The exact derivative of the discrete coenergy over the position, from the stretched air alone:
    F = - integral of [w dg/dz + H . (-dg/dz B_r, dg/dr B_r)] 2 pi r dA.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    points : (2, P) array
        Corners, moved [m].
    a : (N,) array
        Vector potential [Wb/m].

    Returns
    -------
    force : float
        Towards +z [N].
    slope : (N,) array
        [N m/Wb].
    """
    slope = np.zeros(len(a))
    if not len(model.stretched):
        return 0.0, slope
    of = model.stretched
    shapes = shapes_at(model, points, of)
    dofs = model.elements.dofs[:, of]
    b_r, b_z = (np.einsum("neq,ne->eq", part, a[dofs]) for part in (shapes.b_r, shapes.b_z))
    g = model.shift[model.elements.triangles[:, of]]
    g_r, g_z = (np.sum(part * g, axis=0)[:, None] for part in (shapes.slope_r, shapes.slope_z))
    w = 0.5 * (b_r**2 + b_z**2) / VACUUM
    pull = w * g_z + (-g_z * b_r**2 + g_r * b_r * b_z) / VACUUM
    force = -float(np.sum(shapes.weight * pull))
    over_r = (-g_z * b_r + g_r * b_z) / VACUUM
    over_z = (g_z * b_z + g_r * b_r) / VACUUM
    part = np.einsum("neq,eq->ne", shapes.b_r, shapes.weight * over_r)
    part += np.einsum("neq,eq->ne", shapes.b_z, shapes.weight * over_z)
    np.add.at(slope, dofs, -part)
    return force, slope
