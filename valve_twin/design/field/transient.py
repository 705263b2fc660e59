# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fields with eddy currents in solid conductors, currents and position of the armature given.

    sigma dA/dt + curl H = J

The nodes move with the armature, so dA/dt at a node is the rate in the metal, motion included;
the stretched air conducts nothing. Implicit Euler, or the second-order backward formula (BDF2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.design.field.excitation import check_currents
from valve_twin.design.field.newton import NEAR, Eddy, minimise
from valve_twin.design.field.shapes import shapes_at
from valve_twin.design.field.solve import force_of, potential_slopes, solve_field
from valve_twin.design.field.tangent import Tangent

if TYPE_CHECKING:
    from scipy.sparse import csc_array

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel
    from valve_twin.design.field.solve import Field

METHODS = ("euler", "bdf2")
_REFRESHED = 12  # times after which the slopes of the potential over the currents are found anew
_ROUGH = 1e-2  # to which they are solved: they say where to start from [1]
_EVEN = 1e-6  # to which the steps of BDF2 have to be equal [1]


@dataclass(frozen=True, slots=True)
class Transient:
    """What followed from currents and positions at T times.

    Attributes
    ----------
    time_s : (T,) array
        Times [s].
    currents : (T, C) array
        Of the coils [A].
    position : (T,) array
        Of the armature [m].
    flux : (T, C) array
        Flux linkages [Wb].
    force : (T,) array
        On the armature towards +z [N].
    energy : (T,) array
        Of the field [J].
    joule : (T,) array
        Power of the eddy currents in the step before [W].
    """

    time_s: FloatArray
    currents: FloatArray
    position: FloatArray
    flux: FloatArray
    force: FloatArray
    energy: FloatArray
    joule: FloatArray


def run_transient(
    model: FieldModel,
    time_s: FloatArray,
    currents: FloatArray,
    position: FloatArray | None = None,
    method: str = "euler",
) -> Transient:
    """Follow the field from rest at the first currents.

    Parameters
    ----------
    model : FieldModel
        The section's field problem; `skin` of its mesh decides on what is resolved.
    time_s : (T,) array
        Rising [s].
    currents : (T, C) array
        Of the coils [A].
    position : (T,) array, optional
        Of the armature, default 0 [m].
    method : str
        euler or bdf2; the latter needs even steps.

    Raises
    ------
    ValueError
        If the records do not fit each other or the section.
    """
    count = len(time_s)
    x = np.zeros(count) if position is None else np.asarray(position, dtype=np.float64)
    _check(model, time_s, currents, x, method)
    mass, entries = conductors(model)
    start = solve_field(model, currents[0], float(x[0]))
    flux, force = np.empty((count, len(model.section.coils))), np.empty(count)
    energy, joule = np.empty(count), np.zeros(count)
    flux[0], force[0], energy[0] = start.flux, start.force, start.energy
    older, old = start.potential, start.potential
    tangent = Tangent(model)
    bends = np.diff(currents, 2, axis=0, prepend=currents[:1])
    slopes = np.zeros((currents.shape[1], len(old)))
    for k in range(1, count):
        step = float(time_s[k] - time_s[k - 1])
        second = method == "bdf2" and k > 1
        rate = 1.5 / step if second else 1.0 / step
        before = (4.0 * old - older) / 3.0 if second else old
        points = model.moved(float(x[k]))
        eddy = Eddy(mass, entries, rate, before)
        source = currents[k] @ model.coils
        near = 2.0 * old - older + bends[k - 1] @ slopes
        found = minimise(model, points, near, source, eddy, tangent, NEAR)
        if k % _REFRESHED == 1:
            slopes = potential_slopes(model, found.tangent, _ROUGH)
        change = rate * (found.potential - before)
        joule[k] = float(change @ (mass @ change))
        flux[k], energy[k] = model.coils @ found.potential, found.energy
        force[k], _ = force_of(model, points, found.potential)
        older, old = old, found.potential
    return Transient(time_s, currents, x, flux, force, energy, joule)


def static_force(model: FieldModel, currents: FloatArray, position: FloatArray) -> FloatArray:
    """Return the force (T,) that the same currents have without eddy currents [N].

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    currents : (T, C) array
        Of the coils [A].
    position : (T,) array
        Of the armature [m].
    """
    found = np.empty(len(position))
    near: Field | None = None
    tangent = Tangent(model)
    for k, (i, x) in enumerate(zip(currents, position, strict=True)):
        start = (
            None if near is None else near.potential + (i - near.currents) @ near.potential_slope
        )
        near = solve_field(model, i, float(x), start, tangent)
        found[k] = near.force
    return found


def conductors(model: FieldModel) -> tuple[csc_array, FloatArray]:
    """Return sigma integrated over pairs of shape functions, as a matrix and by its entries.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.

    Returns
    -------
    mass : (N, N) sparse array
        [A m s/Wb].
    entries : (M,) array
        The same in the order of the tangent.
    """
    from scipy.sparse import csc_array

    sigma = np.zeros(model.grid.triangles.shape[1])
    for k, region in enumerate(model.section.regions):
        conducts = model.section.materials[region.material].conductivity
        sigma[model.grid.region == k] = conducts
    of = np.flatnonzero(sigma > 0.0)
    shapes = shapes_at(model, model.grid.points, of)
    phi = model.elements.phi
    local = np.einsum("nq,mq,eq->enm", phi, phi, sigma[of, None] * shapes.weight)
    dofs, size = model.elements.dofs[:, of].T, model.coils.shape[1]
    rows, columns = np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, (1, 6)).ravel()
    mass = csc_array((local.ravel(), (rows, columns)), shape=(size, size))
    entries = np.zeros(len(model.rows))
    place = model.elements.scatter[of].ravel()
    np.add.at(entries, place[place >= 0], local.ravel()[place >= 0])
    return mass, entries


def _check(
    model: FieldModel, time_s: FloatArray, currents: FloatArray, x: FloatArray, method: str
) -> None:
    count, coils = len(time_s), len(model.section.coils)
    if method not in METHODS:
        message = f"method = '{method}': must be one of {', '.join(METHODS)}"
        raise ValueError(message)
    steps = np.diff(time_s)
    if count < 2 or not (steps > 0.0).all():
        message = f"time_s: {count} times; must be 2 or more, rising"
        raise ValueError(message)
    if method == "bdf2" and np.ptp(steps) > _EVEN * steps[0]:
        message = f"time_s: steps from {steps.min():g} to {steps.max():g} s; bdf2 needs even ones"
        raise ValueError(message)
    if currents.shape != (count, coils) or x.shape != (count,):
        message = (
            f"currents {currents.shape} and position {x.shape}: must be ({count}, {coils}) and "
            f"({count},), a row a time"
        )
        raise ValueError(message)
    check_currents(model.section, currents)
