# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Linear equations with the tangent of a field's energy, by factors that serve more than one.

From one Newton step, one time, one current to the next the tangent changes little. Its factors are
kept, and conjugate gradients that they precondition solve with the tangents that follow (they are
symmetric and positive definite): new factors cost as much as some 25 iterations. Where iterations
become many, the tangent gets factors of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import SuperLU

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel

_MANY = 6  # iterations after which the next tangent gets factors of its own
_MOST = 12  # iterations after which this one does
_LOOSEST = 1e-2
"""Most of a step's energy that it may leave; else the share that it has of the field's [1]."""


class Tangent:
    """The tangent at hand, and factors of it or of one before.

    Parameters
    ----------
    model : FieldModel
        Has its pattern.
    """

    def __init__(self, model: FieldModel) -> None:
        from scipy.sparse import csc_array

        nothing = np.zeros(len(model.rows))
        self._matrix: csc_array = csc_array(
            (nothing, model.rows, model.columns), shape=(model.unknowns,) * 2
        )
        self._factors: SuperLU | None = None
        self._own = False  # whether the factors are those of the tangent at hand

    def take(self, entries: FloatArray) -> None:
        """Go on to another tangent of the same pattern.

        Parameters
        ----------
        entries : (M,) array
            As `assemble` writes them; not copied [A m^2/Wb].
        """
        self._matrix.data, self._own = entries, False

    def solve(self, right: FloatArray, close: float, energy: float = 0.0) -> FloatArray:
        """Return the solution (N,) of the equations with the tangent at hand [Wb/m].

        Parameters
        ----------
        right : (N,) array
            In the order of elimination [A m].
        close : float
            Largest error over the solution, both measured by the root of their energy [1].
        energy : float
            Of the field, where the solution is a step of Newton's: one that is not the last may
            be off by as much as the curves bend over it; 0 = no such step [J].
        """
        if self._factors is not None and not self._own:
            found, count = _iterate(self._matrix, self._factors, right, close, energy)
            if count > _MANY:
                self._factors = None
            if count <= _MOST:
                return found
        if self._factors is None:
            self._factors, self._own = _factorised(self._matrix), True
        return np.asarray(self._factors.solve(right), dtype=np.float64)


def _iterate(
    matrix: csc_array, factors: SuperLU, right: FloatArray, close: float, energy: float
) -> tuple[FloatArray, int]:
    """Return a solution by conjugate gradients and how many iterations it took."""
    found, rest = np.zeros(len(right)), right.copy()
    nearer = factors.solve(rest)
    along, left = nearer.copy(), float(rest @ nearer)
    bent = min(left / energy, _LOOSEST) if energy > 0.0 else 0.0
    enough = max(close * close, bent) * left
    for count in range(_MOST + 1):
        if left <= enough:
            return found, count
        image = matrix @ along
        share = left / float(along @ image)
        found += share * along
        rest -= share * image
        nearer = factors.solve(rest)
        before, left = left, float(rest @ nearer)
        along *= left / before
        along += nearer
    return found, _MOST + 1


def _factorised(matrix: csc_array) -> SuperLU:
    from scipy.sparse.linalg import splu

    # small supernodes: four times faster here than the default
    return splu(
        matrix,
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        relax=1,
        options={"SymmetricMode": True},
    )
