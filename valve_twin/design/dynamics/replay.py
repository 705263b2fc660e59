# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The closed loop once more in the moving field, where the lumped force is checked.

Currents and motion of a step are given to the field computation with eddy currents and a moving
armature. Its force against that of the lumped valve says what G_A and G_F, fitted at one bias and
one place, are worth on the way that the valve takes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.prediction import fit_percent
from valve_twin.design.dynamics.eddies import magnetising
from valve_twin.design.dynamics.identify import fit_dynamics
from valve_twin.design.field import make_model, run_transient

if TYPE_CHECKING:
    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Loop
    from valve_twin.design.field import FieldModel, Transient
    from valve_twin.design.geometry.section import Section

FOLLOWED_S = 0.03
"""How much of a step is replayed, assumed [s]."""

WANTED = 75.0
"""Fit of the model's force that a replayed step should have, ours [%]."""

LACKS = {
    "second_order": (
        "G_A and G_F filter current and force, but the force follows the flux, and eddy currents "
        "make that late; the next order is --dynamics eddies: two branches of them a coil, driven "
        "by the flux"
    ),
    "eddies": (
        "its branches have the same gains at any current, and are fitted to trapezoids, which "
        "excite otherwise than this step; the next order is --dynamics growing: gains that grow "
        "with the current, fitted to steps in the moving field"
    ),
    "growing": (
        "what is left is not the flux that eddy currents make late but how it spreads in the "
        "steel: the same flux linkages do not always mean the same force; no next order is offered"
    ),
}
"""What each form of `FORMS` lacks where a step fits worse."""


@dataclass(frozen=True, slots=True)
class Replay:
    """Forces of a step, N samples.

    Attributes
    ----------
    time_s : (N,) array
        Since the step [s].
    field, lumped, static : (N,) arrays
        Force of the moving field, of the valve's model, of the static curves alone, currents and
        the model's force as means over two control samples [N].
    fit, without : float
        100 (1 - |field - shown| / |field - mean|) of the model and of the static curves [%].
    refitted : float
        The same of a G_F of the same order that was fitted to this very record [%].
    """

    time_s: FloatArray
    field: FloatArray
    lumped: FloatArray
    static: FloatArray
    fit: float
    without: float
    refitted: float

    @property
    def error(self) -> float:
        """Root of the mean square of lumped less field [N]."""
        return float(np.sqrt(np.mean((self.lumped - self.field) ** 2)))


def replay(
    section: Section, curves: CoenergyMap, loop: Loop, fine: float = 0.5, skin: float = 1e-3
) -> Replay:
    """Replay the first 30 ms of a step in the moving field.

    Parameters
    ----------
    section : Section
        Of the solenoid.
    curves : CoenergyMap
        Its static curves.
    loop : Loop
        The step, with its currents, force and position every 0.1 ms.
    fine, skin : float
        Of the field's mesh, as of `Fidelity` [1], [m].

    Raises
    ------
    ValueError
        If the loop has no such signals, or the armature leaves the meshed stroke.
    """
    try:
        force = dict(loop.rows)["force [N]"]["F"]
    except KeyError as err:
        raise ValueError(_missing(err)) from err
    record = step_record(make_model(section, fine, skin), curves, loop)
    time_s, found, x = record.time_s, record.force, record.position
    lumped = evened(force[: len(time_s)])
    inside = np.clip(record.currents, curves.currents[0], curves.currents[-1])
    static = curves.force(inside, np.clip(x, curves.positions[0], curves.positions[-1]))
    again = fit_dynamics(time_s, static, found)
    return Replay(
        time_s,
        found,
        lumped,
        static,
        fit_percent(found, lumped),
        fit_percent(found, static),
        again.fit,
    )


def step_record(model: FieldModel, curves: CoenergyMap, loop: Loop) -> Transient:
    """Return the moving field under currents and motion of the first 30 ms of a step.

    Parameters
    ----------
    model : FieldModel
        The solenoid's field problem.
    curves : CoenergyMap
        Its static curves.
    loop : Loop
        The step, with its currents, flux linkages and position every 0.1 ms.

    Raises
    ------
    ValueError
        If the loop has no such signals, or the armature leaves the meshed stroke.
    """
    rows = dict(loop.rows)
    try:
        current, place = rows["current [A]"], rows["position [mm]"]["x"]
        both = [current["A"], current["B"]]
        linked = rows["flux linkage [mWb]"]
        flux = 1e-3 * np.array([[linked["A"][0], linked["B"][0]]])
    except KeyError as err:
        raise ValueError(_missing(err)) from err
    count = int(np.searchsorted(loop.time_s, FOLLOWED_S)) + 1
    currents, x = evened(np.column_stack(both)[:count]), 1e-3 * place[:count]
    try:
        currents[0] = magnetising(curves, flux, currents[:1], x[:1])[0]  # at rest
    except ValueError:  # a coil that holds against the other's flux lies beyond its map
        currents[0] = currents[1]
    return run_transient(model, loop.time_s[:count], currents, x, "euler")


def _missing(err: KeyError) -> str:
    return f"the loop shows no {err}: a replay needs currents, force and position"


def evened(values: FloatArray) -> FloatArray:
    """Return means of each sample and the one before: a bridge's patterns alternate.

    Parameters
    ----------
    values : (N,) or (N, C) array
        A row a control sample [A] or [N].
    """
    found: FloatArray = values.copy()
    found[1:] = 0.5 * (values[1:] + values[:-1])
    return found
