# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Newton's method with a line search on the field's energy, with or without eddy currents.

Static: W(A) - s A is least. In a step of time, dA/dt = c (A - A_before), conductors M:

    W(A) - s A + c/2 (A - A_before) M (A - A_before)   is least.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.design.field.kernel import assemble
from valve_twin.design.field.tangent import Tangent

if TYPE_CHECKING:
    from scipy.sparse import csc_array

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel

_MOST_STEPS = 60

CLOSE = 1e-12
"""Newton's decrement over the energy before the last step, of a single field [1]."""

NEAR = 1e-10
"""The same of the times of a transient: the step leaves some 1e-9 of the potential [1]."""

_LEAST_ENERGY = 1e-18  # below which there is no field [J]
_ENOUGH = 1e-4  # of the promised descent that a step has to give [1]
_HALVINGS = 25
_SOLVED = 1e-4  # error of a step that its linear equations leave at least, over the step [1]


class Eddy(NamedTuple):
    """A step in time.

    Attributes
    ----------
    mass : (N, N) sparse array
        Conductors: M of the module's text [A m s/Wb].
    entries : (M,) array
        The same as `assemble` orders the tangent.
    rate : float
        c of the module's text [1/s].
    before : (N,) array
        Vector potential from which the rate counts [Wb/m].
    """

    mass: csc_array
    entries: FloatArray
    rate: float
    before: FloatArray


class Minimum(NamedTuple):
    """What was found: potential (N,) [Wb/m], energy of the field [J], tangent, Newton steps."""

    potential: FloatArray
    energy: float
    tangent: Tangent
    steps: int


def minimise(
    model: FieldModel,
    points: FloatArray,
    start: FloatArray,
    source: FloatArray,
    eddy: Eddy | None = None,
    tangent: Tangent | None = None,
    close: float = CLOSE,
) -> Minimum:
    """Return the potential of least energy.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    points : (2, P) array
        Corners, moved [m].
    start : (N,) array
        Vector potential to start from [Wb/m].
    source : (N,) array
        Currents times flux linkages over the unknowns [A m].
    eddy : Eddy, optional
        A step in time; default a static field.
    tangent : Tangent, optional
        Of a field near, whose factors may serve; goes on to those of this one.
    close : float
        Newton's decrement over the energy before the last step [1].

    Raises
    ------
    ValueError
        If no minimum is found.
    """
    tangent = tangent or Tangent(model)
    state = _State(model, points, source, eddy)
    free = model.place >= 0
    order = model.place[free]
    a, value = start.copy(), state.at(start)
    for steps in range(1, _MOST_STEPS + 1):
        slope = np.empty(model.unknowns)
        slope[order] = state.slope[free]
        tangent.take(state.matrix)
        step = np.zeros(len(a))
        step[free] = tangent.solve(slope, _SOLVED, state.energy)[order]
        promised = float(step[free] @ state.slope[free])
        if promised <= close * abs(state.energy) + _LEAST_ENERGY:
            # along the last step the sum is a parabola to all digits: no further assembly
            a = a - step
            energy = value - 0.5 * promised + float(source @ a) - state.eddy_part(a)
            return Minimum(a, energy, tangent, steps)
        a, value = state.along(a, step, value, promised)
    message = f"no field found in {_MOST_STEPS} steps; check the magnetisation curves"
    raise ValueError(message)


class _State:
    """The sum that is made least, with its slope and tangent at the last place."""

    def __init__(
        self, model: FieldModel, points: FloatArray, source: FloatArray, eddy: Eddy | None
    ) -> None:
        self._model, self._points, self._source, self._eddy = model, points, source, eddy
        self.slope, self.matrix = np.empty(len(source)), np.empty(len(model.rows))
        self.energy = 0.0

    def at(self, a: FloatArray) -> float:
        model, steady = self._model, self._model.steady
        varying = assemble(
            model.elements, steady.varying, self._points, a, self.slope, self.matrix
        )
        image = steady.stiff @ a
        self.energy = varying + steady.energy + float(a @ (steady.pull + 0.5 * image))
        self.slope += steady.pull + image - self._source
        self.matrix += steady.entries
        value = self.energy - float(self._source @ a)
        if self._eddy is None:
            return value
        change = a - self._eddy.before
        pull = self._eddy.rate * (self._eddy.mass @ change)
        self.slope += pull
        self.matrix += self._eddy.rate * self._eddy.entries
        return value + 0.5 * float(change @ pull)

    def eddy_part(self, a: FloatArray) -> float:
        if self._eddy is None:
            return 0.0
        change = a - self._eddy.before
        return 0.5 * self._eddy.rate * float(change @ (self._eddy.mass @ change))

    def along(
        self, a: FloatArray, step: FloatArray, before: float, promised: float
    ) -> tuple[FloatArray, float]:
        """Go along a step until the sum falls."""
        share = 1.0
        rounding = 1e-13 * (abs(self.energy) + abs(before))
        for _ in range(_HALVINGS):
            tried = a - share * step
            value = self.at(tried)
            if value <= before - _ENOUGH * share * promised + rounding:
                break
            share *= 0.5
        return tried, value
