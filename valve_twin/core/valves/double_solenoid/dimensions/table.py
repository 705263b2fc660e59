# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""How worn dimensions of a designed solenoid change its coenergy, as the options hold it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.physics.coenergy import CoenergyMap
from valve_twin.core.valves.double_solenoid.dimensions.published import DIMENSIONS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Wear
    from valve_twin.core.valves.double_solenoid.parameters import DoubleSolenoidOptions

_COILS = ("A", "B")


@dataclass(frozen=True, slots=True)
class DimensionTable:
    """Changes of the coenergy over the sizes of D dimensions.

    Attributes
    ----------
    names : tuple of str
        Of the dimensions, of `DIMENSIONS`.
    changes : tuple of CoenergyMap
        Change of the coenergy for a size of 1, a map each.
    """

    names: tuple[str, ...]
    changes: tuple[CoenergyMap, ...]

    def forces(self, currents: FloatArray, x: FloatArray) -> FloatArray:
        """Return the changes of the force (D, N) [N].

        Parameters
        ----------
        currents : (N, 2) array
            Of both coils [A]; beyond the map as at its edge.
        x : (N,) array
            Position [m]; the same.
        """
        return np.array([c.force(*_inside(c, currents, x)) for c in self.changes])

    def fluxes(self, currents: FloatArray, x: FloatArray, coil: int) -> FloatArray:
        """Return the changes of a coil's flux linkage (D, N) [Wb].

        Parameters
        ----------
        currents, x : (N, 2) array, (N,) array
            As in `forces` [A], [m].
        coil : int
            0 = A, 1 = B.
        """
        return np.array([c.flux(*_inside(c, currents, x))[:, coil] for c in self.changes])


def _inside(c: CoenergyMap, currents: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    return (
        np.clip(currents, c.currents[0], c.currents[-1]),
        np.clip(x, c.positions[0], c.positions[-1]),
    )


def options_of(wear: Sequence[Wear]) -> Mapping[str, object]:
    """Return the options of a twin that judges the dimensions of its design.

    Parameters
    ----------
    wear : sequence of Wear
        At least one, all on the same nodes.

    Raises
    ------
    ValueError
        If there is none, a name is not known, or the nodes differ.
    """
    if not wear:
        message = "no worn dimension: compute at least one"
        raise ValueError(message)
    first = wear[0].change
    for of in wear:
        if of.name not in DIMENSIONS:
            message = f"dimension '{of.name}': must be one of {', '.join(DIMENSIONS)}"
            raise ValueError(message)
        same = of.change.coefficients.shape == first.coefficients.shape
        if not (same and np.array_equal(of.change.positions, first.positions)):
            message = f"dimension '{of.name}' stands on other nodes than '{wear[0].name}'"
            raise ValueError(message)
    return {
        "dimension_names": tuple(of.name for of in wear),
        "dimension_current": tuple(first.currents.tolist()),
        "dimension_position": tuple(first.positions.tolist()),
        "dimension_coenergy": tuple(
            float(f"{v:.8g}") for of in wear for v in of.change.coefficients.ravel().tolist()
        ),
    }


def table_of(options: DoubleSolenoidOptions) -> DimensionTable:
    """Return the table of the options.

    Raises
    ------
    ValueError
        If there is none, or its lists do not fit each other; says which.
    """
    return _table(
        tuple(options.dimension_names),
        tuple(options.dimension_current),
        tuple(options.dimension_position),
        tuple(options.dimension_coenergy),
    )


@lru_cache(maxsize=8)
def _table(
    names: tuple[str, ...],
    currents: tuple[float, ...],
    positions: tuple[float, ...],
    coenergy: tuple[float, ...],
) -> DimensionTable:
    if not names:
        message = (
            "dimension_names is empty: valve-twin design export --faults writes the options that "
            "the estimator 'dimensions' needs"
        )
        raise ValueError(message)
    unknown = [n for n in names if n not in DIMENSIONS]
    if unknown:
        message = f"dimension_names: '{unknown[0]}' must be one of {', '.join(DIMENSIONS)}"
        raise ValueError(message)
    for name, nodes in (("dimension_current", currents), ("dimension_position", positions)):
        if len(nodes) < 2 or not (np.diff(nodes) > 0.0).all():
            message = f"{name} has {len(nodes)} values: must be 2 or more, rising"
            raise ValueError(message)
    shape = (2 * len(currents), 2 * len(currents), 2 * len(positions))
    wanted = len(names) * int(np.prod(shape))
    if len(coenergy) != wanted or not np.isfinite(coenergy).all():
        message = f"dimension_coenergy has {len(coenergy)} values: must be {wanted}, all finite"
        raise ValueError(message)
    values = np.array(coenergy).reshape((len(names), *shape))
    axes = np.array(currents), np.array(positions)
    changes = tuple(CoenergyMap(_COILS, *axes, np.ascontiguousarray(v), {}) for v in values)
    return DimensionTable(names, changes)
