# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Fields on a grid of currents and positions, each started from the tangent of a neighbour.

A solenoid that is a mirror of itself is computed for x >= 0 only:

    psi_A(i_A, i_B, x) = psi_B(i_B, i_A, -x)      F(i_A, i_B, x) = -F(i_B, i_A, -x)
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.design.field.solve import solve_field
from valve_twin.design.field.tangent import Tangent
from valve_twin.design.geometry.section import mirrored

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel
    from valve_twin.design.field.solve import Field
    from valve_twin.design.geometry.section import Region, Section

_ROUND = 9  # decimals of a metre to which corners of mirror images agree
_MOST_COILS = 2


@dataclass(frozen=True, slots=True)
class Sweep:
    """Fields of a section with C coils on a grid: I currents of each coil, X positions.

    Attributes
    ----------
    currents, positions : (I,), (X,) arrays
        The grid, rising [A], [m].
    coenergy, force : (I, .., X) arrays
        One axis a coil, then the position [J], [N].
    flux, force_slope : (C, I, .., X) arrays
        Flux linkages [Wb] and the slope of the force over the currents [N/A].
    inductance : (C, C, I, .., X) array
        Slope of the flux linkages over the currents [H].
    solved, steps : int
        Fields solved and Newton steps taken.
    """

    currents: FloatArray
    positions: FloatArray
    coenergy: FloatArray
    force: FloatArray
    flux: FloatArray
    force_slope: FloatArray
    inductance: FloatArray
    solved: int
    steps: int


def sweep_fields(
    model: FieldModel,
    currents: FloatArray,
    positions: FloatArray,
    advance: Callable[[], None] = lambda: None,
) -> Sweep:
    """Compute the field at every pair of currents and every position.

    Parameters
    ----------
    model : FieldModel
        The section's field problem, with one or two coils.
    currents : (I,) array
        Of each coil, rising from 0 [A].
    positions : (X,) array
        Rising [m].
    advance : callable
        Called once a field.

    Raises
    ------
    ValueError
        If the grid is none or the section has another number of coils.
    """
    coils = len(model.section.coils)
    _check_axes(coils, currents, positions)
    mirror = is_mirror(model.section) and bool(
        np.allclose(positions, -positions[::-1], atol=1e-12)
    )
    shape = (len(currents),) * coils + (len(positions),)
    out = Sweep(currents, positions, np.zeros(shape), np.zeros(shape), np.zeros((coils, *shape)),
                np.zeros((coils, *shape)), np.zeros((coils, coils, *shape)), 0, 0)  # fmt: skip
    solved, steps, tangent = 0, 0, Tangent(model)
    last = len(positions) - 1
    for k in np.argsort(np.abs(positions), kind="stable").tolist():
        if mirror and k < last - k:
            continue
        row: dict[tuple[int, ...], Field] = {}
        for at in product(range(len(currents)), repeat=coils):
            if mirror and 2 * k == last and at[1] > at[0]:
                continue
            wanted = currents[list(at)]
            start = _start(row, at, wanted)
            field = solve_field(model, wanted, float(positions[k]), start, tangent)
            row[at] = field
            solved, steps = solved + 1, steps + field.steps
            _keep(out, (*at, k), field, (0, 1)[:coils], 1.0)
            if mirror:
                _keep(out, (*at[::-1], last - k), field, (1, 0), -1.0)
            advance()
    return Sweep(out.currents, out.positions, out.coenergy, out.force, out.flux, out.force_slope,
                 out.inductance, solved, steps)  # fmt: skip


def is_mirror(section: Section) -> bool:
    """Return whether coil B is the mirror image of coil A, and the rest its own."""
    if len(section.coils) != _MOST_COILS or section.excited:
        return False
    motion = section.motion
    ends = (motion.low, motion.still_low) if motion else ()
    images = (-motion.high, -motion.still_high) if motion else ()
    for end, image in zip((section.low, *ends), (-section.high, *images), strict=True):
        if round(end - image, _ROUND):
            return False
    one, other = section.coils
    swapped = {one: other, other: one, "": ""}
    there = {_key(r, r.outline, r.coil, 1.0) for r in section.regions}
    # all currents reversed change no flux linkage over its current, and no force
    return any(
        there == {_key(r, mirrored(r.outline), swapped[r.coil], sign) for r in section.regions}
        for sign in (1.0, -1.0)
    )


def _key(
    region: Region, outline: tuple[tuple[float, float], ...], coil: str, sign: float
) -> object:
    corners = frozenset((round(r, _ROUND), round(z, _ROUND) + 0.0) for r, z in outline)
    return region.material, corners, coil, sign * region.turns


def _start(
    row: dict[tuple[int, ...], Field], at: tuple[int, ...], wanted: FloatArray
) -> FloatArray | None:
    """Return where to start from: the tangent of the neighbour with one current less."""
    for axis in reversed(range(len(at))):
        near = row.get((*at[:axis], at[axis] - 1, *at[axis + 1 :]))
        if near is not None:
            found: FloatArray = near.potential + (wanted - near.currents) @ near.potential_slope
            return found
    return None


def _keep(
    out: Sweep, place: tuple[int, ...], field: Field, order: tuple[int, ...], sign: float
) -> None:
    """Write a field, or its mirror image, to its place."""
    out.coenergy[place] = field.coenergy
    out.force[place] = sign * field.force
    for k, one in enumerate(order):
        out.flux[(k, *place)] = field.flux[one]
        out.force_slope[(k, *place)] = sign * field.force_slope[one]
        for m, other in enumerate(order):
            out.inductance[(k, m, *place)] = field.inductance[one, other]


def _check_axes(coils: int, currents: FloatArray, positions: FloatArray) -> None:
    if not 1 <= coils <= _MOST_COILS:
        message = f"a map is made of 1 or {_MOST_COILS} coils; the section has {coils}"
        raise ValueError(message)
    for name, values, least in (("currents", currents, 4), ("positions", positions, 4)):
        if len(values) < least or not (np.diff(values) > 0.0).all():
            message = f"{name} = {values.tolist()}: must be {least} or more, rising"
            raise ValueError(message)
    if currents[0] != 0.0:
        message = f"currents[0] = {currents[0]:g}: must be 0 [A]"
        raise ValueError(message)
