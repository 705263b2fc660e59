# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""A solenoid's map: its fields on a grid become one coenergy spline."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import version
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from valve_twin import __version__
from valve_twin.core.physics.coenergy import CoenergyMap, check_inductances, spline_coefficients
from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.design.field.model import make_model
from valve_twin.design.map.sweep import sweep_fields

if TYPE_CHECKING:
    from collections.abc import Callable

    from valve_twin.core.types import FloatArray
    from valve_twin.design.field.model import FieldModel
    from valve_twin.design.geometry.section import Section
    from valve_twin.design.map.sweep import Sweep


@dataclass(frozen=True, slots=True)
class MapGrid:
    """Where the fields of a map are computed."""

    largest_current: float = assumed(3.0, "A", "Of each coil", 1e-3, 1e4)
    currents: int = assumed(7, "1", "Currents of each coil, from 0", 4, 60)
    positions: int = assumed(9, "1", "Positions over the stroke", 4, 60)
    fine: float = assumed(0.8, "1", "Elements along a line over the usual mesh", 0.2, 6.0)
    skin: float = assumed(1.0, "m", "Elements at surfaces, as of a transient field", 2e-5, 1.0)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)


def compute_map(
    section: Section, grid: MapGrid | None = None, advance: Callable[[], None] = lambda: None
) -> CoenergyMap:
    """Return the coenergy map of a section with one or two coils.

    Parameters
    ----------
    section : Section
        What is computed; its motion says the stroke.
    grid : MapGrid, optional
        Where.
    advance : callable
        Called once a field.

    Raises
    ------
    ValueError
        If nothing moves, the section cannot be computed, or the grid is too coarse for its curves.
    """
    grid = MapGrid() if grid is None else grid
    motion = section.motion
    if motion is None or not motion.stroke > 0.0:
        message = "motion.stroke: a map needs an armature that moves; give a stroke above 0 [m]"
        raise ValueError(message)
    model = make_model(section, grid.fine, grid.skin)
    currents = np.linspace(0.0, grid.largest_current, grid.currents)
    positions = np.linspace(-motion.stroke, motion.stroke, grid.positions)
    sweep = sweep_fields(model, currents, positions, advance)
    found = map_of(sweep, section.coils, _provenance(model, grid, sweep))
    check_inductances(found)
    return found


def map_of(sweep: Sweep, coils: tuple[str, ...], provenance: dict[str, object]) -> CoenergyMap:
    """Return the spline through the coenergies of a sweep with their slopes.

    Parameters
    ----------
    sweep : Sweep
        Fields on a grid.
    coils : tuple of str
        Names of the coils.
    provenance : dict
        What is to be said of its origin.
    """
    from scipy.interpolate import CubicSpline

    count = len(coils)
    values = np.zeros(tuple(2 * n for n in sweep.coenergy.shape))

    def part(*axes: int) -> tuple[slice, ...]:
        return tuple(slice(int(k in axes), None, 2) for k in range(count + 1))

    values[part()] = sweep.coenergy
    values[part(count)] = sweep.force
    for k in range(count):
        values[part(k)] = sweep.flux[k]
        values[part(k, count)] = sweep.force_slope[k]
    for k, m in combinations(range(count), 2):
        mutual = sweep.inductance[k, m]
        values[part(k, m)] = mutual
        # the only slope that no field gives
        values[part(k, m, count)] = CubicSpline(sweep.positions, mutual, axis=count)(
            sweep.positions, 1
        )
    axes = (*[sweep.currents] * count, sweep.positions)
    coefficients = spline_coefficients(values, axes)
    return CoenergyMap(coils, sweep.currents, sweep.positions, coefficients, provenance)


def unlike(curves: CoenergyMap, section: Section, grid: MapGrid) -> tuple[str, ...]:
    """Return in what a map is not that which would be computed now, what it is and what it would.

    Parameters
    ----------
    curves : CoenergyMap
        The map.
    section : Section
        Of which it is to be.
    grid : MapGrid
        Where its fields would be computed.

    Raises
    ------
    ValueError
        If it is the map of another section.
    """
    held = curves.provenance
    if held.get("section") != repr(section):
        message = "the map was computed of another section: compute one of this design"
        raise ValueError(message)
    now: dict[str, object] = {**asdict(grid), **_versions()}
    versions = held.get("versions")
    then = {**held, **(versions if isinstance(versions, dict) else {})}
    return tuple(
        f"{name} {then.get(name, 'unknown')} (now {value})"
        for name, value in now.items()
        if then.get(name) != value
    )


def _provenance(model: FieldModel, grid: MapGrid, sweep: Sweep) -> dict[str, object]:
    """Return what a map was computed from and with."""
    section = model.section
    arrays: tuple[FloatArray, ...] = (sweep.coenergy, sweep.force, sweep.flux, sweep.inductance)
    digest = hashlib.sha256(repr(section).encode())
    for values in arrays:
        digest.update(np.round(values, 12).tobytes())
    return {
        "name": section.name,
        "section": repr(section),
        **asdict(grid),
        "unknowns": model.unknowns,
        "fields": sweep.solved,
        "newton_steps": sweep.steps,
        "versions": _versions(),
        "sha256": digest.hexdigest(),
    }


def _versions() -> dict[str, str]:
    import scipy
    import skfem

    return {
        "valve_twin": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": version("numba"),
        "scikit-fem": skfem.__version__,
    }
