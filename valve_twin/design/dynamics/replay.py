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
        "its branches are fitted to trapezoids of 0.5 and 1 A, which excite otherwise than this "
        "step; of the reference, the same branches fitted to steps of 50 and 100 % reach 86 and "
        "83 %, the next order, gains that grow with the current, 91 and 90 %, which no plant has "
        "(docs/design.md)"
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
    rows = dict(loop.rows)
    try:
        current, force = rows["current [A]"], rows["force [N]"]["F"]
        both, place = [current["A"], current["B"]], rows["position [mm]"]["x"]
        linked = rows["flux linkage [mWb]"]
        flux = 1e-3 * np.array([[linked["A"][0], linked["B"][0]]])
    except KeyError as err:
        message = f"the loop shows no {err}: a replay needs currents, force and position"
        raise ValueError(message) from err
    count = int(np.searchsorted(loop.time_s, FOLLOWED_S)) + 1
    currents, x = evened(np.column_stack(both)[:count]), 1e-3 * place[:count]
    currents[0] = magnetising(curves, flux, currents[:1], x[:1])[0]  # at rest
    time_s, lumped = loop.time_s[:count], evened(force[:count])
    model = make_model(section, fine, skin)
    found = run_transient(model, time_s, currents, x, "euler").force
    inside = np.clip(currents, curves.currents[0], curves.currents[-1])
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
