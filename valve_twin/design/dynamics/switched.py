# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""G_A and G_F from a trapezoid of current whose flux a switched bridge can make.

Paper 000, section 3.2: the smooth flux linkage of the field is approximated by one from switched
voltages, since the model's coil is fed by a bridge; where the voltage does not suffice the
approximation is bad, and the flanks are made less steep until it is good.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.control.current_loop import SAMPLE_S, SUB_STEPS
from valve_twin.core.control.flux_reconstruction import reconstruct_flux
from valve_twin.design.dynamics.identify import fit_dynamics, identify
from valve_twin.design.field import run_transient

if TYPE_CHECKING:
    from valve_twin.core.control.flux_reconstruction import Reconstruction
    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.design.dynamics.identify import Dynamics
    from valve_twin.design.field import FieldModel, Transient, Trapezoid

LONGER = 1.5
"""By how much a flank that is too steep is made longer [1], assumed."""

_TRIES = 8
_SPARE = 1.1  # of the largest error where the voltage suffices, U times half a sample [1], assumed


@dataclass(frozen=True, slots=True)
class Bridge:
    """What feeds the coil.

    Attributes
    ----------
    resistance, supply : float
        Of the coil [ohm], its levels + and - [V].
    """

    resistance: float
    supply: float

    @property
    def limit(self) -> float:
        """Largest error of the flux linkage that counts as good [Wb]."""
        return _SPARE * 0.5 * SAMPLE_S * self.supply


@dataclass(frozen=True, slots=True)
class Switched:
    """Dynamics from a switched flux linkage, and what they were fitted to.

    Attributes
    ----------
    shape : Trapezoid
        The current of the last try.
    found : Transient
        The field under it, a time every control sample.
    rebuilt : Reconstruction
        Flux linkage of the first coil from switched voltages.
    static : (8 N + 1,) array
        i_s of that flux linkage, every sub-step [A].
    of_current, of_force, smooth : Dynamics
        G_A from `static`, G_F, and G_A from the smooth flux linkage.
    tries : int
        Trapezoids that were computed.
    reached : bool
        Whether the error stays within the limit of the bridge.
    """

    shape: Trapezoid
    found: Transient
    rebuilt: Reconstruction
    static: FloatArray
    of_current: Dynamics
    of_force: Dynamics
    smooth: Dynamics
    tries: int
    reached: bool


def identify_switched(
    model: FieldModel,
    curves: CoenergyMap,
    bridge: Bridge,
    shape: Trapezoid,
    criterion: str = "interval",
) -> Switched:
    """Fit G_A and G_F to a trapezoid, with flatter flanks until the bridge can make the flux.

    Parameters
    ----------
    model : FieldModel
        The section's field problem.
    curves : CoenergyMap
        Its static curves.
    bridge : Bridge
        What feeds the coil.
    shape : Trapezoid
        The first try; its step becomes a control sample.
    criterion : str
        What decides on a pattern, see `reconstruct_flux`; the paper's is "interval".

    Raises
    ------
    ValueError
        If the record goes beyond the map.
    """
    shape = replace(shape, step=SAMPLE_S)
    for tries in range(1, _TRIES + 1):
        time_s, currents = sampled(shape, len(model.section.coils))
        found = run_transient(model, time_s, currents)
        fine_s = np.linspace(0.0, time_s[-1], SUB_STEPS * (len(time_s) - 1) + 1)
        current = np.interp(fine_s, time_s, currents[:, 0])
        rebuilt = reconstruct_flux(
            found.flux[:, 0], current[:-1], bridge.resistance, bridge.supply, criterion
        )
        reached = rebuilt.largest <= bridge.limit
        if reached or tries == _TRIES:
            break
        shape = replace(shape, slope=LONGER * shape.slope)
    others = np.column_stack([np.interp(fine_s, time_s, i) for i in currents.T])
    static = curves.current(0, rebuilt.flux, others, np.zeros(len(fine_s)))
    smooth, of_force = identify(found, curves)
    of_current = fit_dynamics(fine_s, static, current)
    return Switched(
        shape, found, rebuilt, static, of_current, of_force, smooth, tries, bool(reached)
    )


def sampled(shape: Trapezoid, coils: int) -> tuple[FloatArray, FloatArray]:
    """Return a trapezoid's currents (T, C) [A] at whole control samples (T,) [s].

    Parameters
    ----------
    shape : Trapezoid
        The trapezoid.
    coils : int
        How many there are.
    """
    time_s, currents = shape.record(coils)
    count = int(np.ceil(time_s[-1] / SAMPLE_S - 1e-9)) + 1
    whole: FloatArray = SAMPLE_S * np.arange(count, dtype=np.float64)
    return whole, np.column_stack([np.interp(whole, time_s, i) for i in currents.T])
