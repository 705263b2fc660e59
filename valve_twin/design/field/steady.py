# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What air, coils and magnets give to the field's energy, where no movement deforms them.

Their energy is a quadratic form of the unknowns, the same at any currents and place of the
armature (a triangle that is carried along the axis keeps it): it is made once a mesh. Steel and
the stretched air, less than half of the triangles, are assembled anew each time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.design.field.kernel import assemble

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.design.field.kernel import Elements


class Steady(NamedTuple):
    """The form: energy + pull a + a stiff a / 2.

    Attributes
    ----------
    energy : float
        Without a potential: that of magnets [J].
    pull : (N,) array
        Slope there [A m].
    stiff : (N, N) sparse array
        [A m^2/Wb].
    entries : (M,) array
        The same as `assemble` orders the tangent.
    varying : (V,) int array
        Triangles that are not part of it.
    """

    energy: float
    pull: FloatArray
    stiff: csr_array
    entries: FloatArray
    varying: IntArray


def make_steady(
    elements: Elements, points: FloatArray, stretched: IntArray, sizes: tuple[int, int]
) -> Steady:
    """Return the form of a mesh.

    Parameters
    ----------
    elements : Elements
        The mesh and its materials.
    points : (2, P) array
        Corners [m].
    stretched : (S,) int array
        Triangles that a movement deforms.
    sizes : tuple of int
        N unknowns, those held at 0 among them, and M entries of the tangent.
    """
    from scipy.sparse import csr_array

    varies = elements.steel >= 0
    varies[stretched] = True
    of = np.flatnonzero(~varies)
    count, length = sizes
    pull, entries = np.empty(count), np.empty(length)
    energy = assemble(elements, of, points, np.zeros(count), pull, entries)
    # the same without the rows and columns that are held left out, each triangle by itself
    local = elements._replace(scatter=np.arange(36 * len(of)).reshape(-1, 36))
    local = local._replace(
        triangles=np.ascontiguousarray(elements.triangles[:, of]),
        dofs=np.ascontiguousarray(elements.dofs[:, of]),
        steel=elements.steel[of], nu=elements.nu[of], remanence=elements.remanence[of],
    )  # fmt: skip
    values = np.empty(36 * len(of))
    assemble(local, np.arange(len(of)), points, np.zeros(count), np.empty(count), values)
    dofs = elements.dofs[:, of].T
    places = np.repeat(dofs, 6, axis=1).ravel(), np.tile(dofs, (1, 6)).ravel()
    stiff = csr_array((values, places), shape=(count, count))
    return Steady(energy, pull, stiff, entries, np.flatnonzero(varies))
