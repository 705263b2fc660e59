# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From a geometry to its closed loop: map, dynamics, steps of the setpoint."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.designed import SCALED, Designed
from valve_twin.design.dynamics import identify
from valve_twin.design.field import Trapezoid, make_model, run_transient
from valve_twin.design.map import MapGrid, compute_map

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.valves.designed import Designable, Loop, Numbers
    from valve_twin.design.dynamics import Dynamics
    from valve_twin.design.geometry import DoubleStroke

STEPS = (0.1, 0.25, 0.5, 1.0)
"""Steps from the middle over the way to an open port [1]."""

COARSE = MapGrid(currents=6, positions=7, fine=0.6)
"""Of an evaluation: 1.6 of 136 N and 1.0 of 168 mWb off the usual map of the reference at most."""

VARIED = 0.1
"""By how much a robust evaluation scales friction, supply and copper, assumed [1]."""

_FINE, _SKIN, _STEP_S = 0.5, 1e-3, 2e-4  # of the transient field


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a geometry does in its loop.

    Attributes
    ----------
    numbers : Numbers
        Of the valve with this solenoid.
    dynamics : tuple of Dynamics
        G_A and G_F with their fits.
    loops : mapping
        By step [1].
    robust : tuple of mapping
        The same under every combination of lower and higher friction, supply and copper; empty =
        not asked for.
    margin : float
        Least force that the largest current leaves against spring and friction [N].
    """

    numbers: Numbers
    dynamics: tuple[Dynamics, Dynamics]
    loops: Mapping[float, Loop]
    robust: tuple[Mapping[float, Loop], ...]
    margin: float


def compute_design(
    design: DoubleStroke,
    curves: CoenergyMap | None = None,
    grid: MapGrid | None = None,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Designed, tuple[Dynamics, Dynamics]]:
    """Compute what a valve needs of a double-stroke solenoid.

    Parameters
    ----------
    design : DoubleStroke
        The geometry with its surroundings.
    curves : CoenergyMap, optional
        Its map, where it is computed already.
    grid : MapGrid, optional
        Where the map is computed otherwise.
    advance : callable
        Called once a field of the map.

    Raises
    ------
    ValueError
        If a restriction is broken, or the map is that of another section or ends too early.
    """
    section = design.section()
    if curves is None:
        curves = compute_map(section, grid, advance)
    elif curves.provenance.get("section") != repr(section):
        message = "the map was computed of another section: compute one of this design"
        raise ValueError(message)
    model = make_model(section, _FINE, _SKIN)
    time_s, currents = Trapezoid(step=_STEP_S).record(len(section.coils))
    found = run_transient(model, time_s, currents, np.zeros(len(time_s)), "euler")
    of_current, of_force = identify(found, curves)
    designed = Designed(
        curves=curves,
        resistance=design.winding().resistance,
        mass=design.moving_mass(),
        stroke=design.stroke,
        current_dynamics=_numbers(of_current),
        force_dynamics=_numbers(of_force),
        around=design.valve,
    )
    return designed, (of_current, of_force)


def evaluate(
    design: DoubleStroke,
    valve: Designable,
    *,
    robust: bool = False,
    advance: Callable[[], None] = lambda: None,
) -> Evaluation:
    """Follow steps of a valve with a designed solenoid.

    Parameters
    ----------
    design : DoubleStroke
        The geometry with its surroundings.
    valve : Designable
        The valve that it moves.
    robust : bool
        Also with friction, supply and copper scaled.
    advance : callable
        Called once a field of the map.

    Raises
    ------
    ValueError
        If the design cannot be computed or a number does not fit the valve.
    """
    designed, dynamics = compute_design(design, grid=COARSE, advance=advance)
    numbers = valve.of_design(designed)
    cases: list[dict[str, float]] = [{}]
    if robust:
        corners = product((1.0 - VARIED, 1.0 + VARIED), repeat=len(SCALED))
        cases += [dict(zip(SCALED, corner, strict=True)) for corner in corners]
    runs = [{share: valve.loop(numbers, share, case) for share in STEPS} for case in cases]
    return Evaluation(numbers, dynamics, runs[0], tuple(runs[1:]), valve.force_margin(numbers))


def _numbers(found: Dynamics) -> tuple[float, float, float, float]:
    return found.b1, found.b2, found.a1, found.a2
