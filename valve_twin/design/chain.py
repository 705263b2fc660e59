# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""From a geometry to its closed loop: map, dynamics, steps of the setpoint."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.core.valves.designed import SCALED, Designed, find_designable
from valve_twin.design.dynamics import (
    branch_records,
    fit_branches,
    fit_growing,
    identify,
    step_record,
)
from valve_twin.design.dynamics.growing import FITTED
from valve_twin.design.field import Trapezoid, make_model, run_transient
from valve_twin.design.map import MapGrid, compute_map, unlike

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Designable, Loop, Numbers
    from valve_twin.design.dynamics import Dynamics
    from valve_twin.design.geometry import DoubleStroke, Section

STEPS = (0.1, 0.25, 0.5, 1.0)
"""Steps from the middle over the way to an open port [1]."""

COARSE = MapGrid(currents=6, positions=7, fine=0.6)
"""Of an evaluation: 1.6 of 136 N and 1.0 of 168 mWb off the usual map of the reference at most."""

AMPERE_TURNS = 1700.0
"""At most at the end of a map: 1.5 times those of the reference, as its nodes do not become more,
assumed [A]."""

VARIED = 0.1
"""By how much a robust evaluation scales friction, supply and copper, assumed [1]."""


@dataclass(frozen=True, slots=True)
class Fidelity:
    """How finely the fields of a design are computed."""

    grid: MapGrid = field(default_factory=MapGrid)
    fine: float = assumed(0.5, "1", "Of the transient field: elements along a line", 0.2, 6.0)
    skin: float = assumed(1e-3, "m", "Of it: elements at surfaces", 2e-5, 1.0)
    step: float = assumed(2e-4, "s", "Of it: step", 1e-7, 1e-2)
    draws: int = assumed(1, "1", "Draws of the sensors' noise that figures are means of", 1, 1000)
    stretched: bool = False  # changed designs on the stretched mesh of the one that they change

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)


_SEARCH = Fidelity(MapGrid(currents=5, positions=5, fine=0.4), fine=0.4, step=4e-4)

FIDELITIES = {
    "search": _SEARCH,
    "usual": Fidelity(COARSE),
    "twice": Fidelity(replace(COARSE, fine=2.0 * COARSE.fine), fine=1.0, skin=5e-4, step=1e-4),
    "export": Fidelity(),
    "matched": Fidelity(MapGrid(fine=0.5, skin=1e-3)),
    "evened": replace(_SEARCH, draws=5, stretched=True),
}
"""For many designs; of an evaluation; to check it, twice its elements along a line; of a file; map
and eddy currents on one mesh, to look at dynamics alone; for sensitivities, as one draw of the
sensors' noise moves the loop as much as a dimension does, and a line of the mesh more or less the
fields."""

FORMS = ("second_order", "eddies", "growing")
"""What stands beside static curves: G_A and G_F of paper 000, two branches of eddy currents fitted
to trapezoids, or such whose gains grow with the current, fitted to steps."""

USUAL_FORM = "eddies"
"""Where nothing else is said: on steps it comes nearer to the moving field than G_A and G_F."""


def find_fidelity(name: str) -> Fidelity:
    """Return what a name of `FIDELITIES` stands for.

    Raises
    ------
    ValueError
        If there is none of the name.
    """
    if name not in FIDELITIES:
        message = f"fidelity '{name}': must be one of {', '.join(FIDELITIES)}"
        raise ValueError(message)
    return FIDELITIES[name]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a geometry does in its loop.

    Attributes
    ----------
    numbers : Numbers
        Of the valve with this solenoid.
    designed : Designed
        What was computed of the solenoid.
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
    designed: Designed
    dynamics: tuple[Dynamics, Dynamics]
    loops: Mapping[float, Loop]
    robust: tuple[Mapping[float, Loop], ...]
    margin: float


def reaching(grid: MapGrid, design: DoubleStroke) -> MapGrid:
    """Return a grid whose map ends where the power of a design's coils does, if that is later.

    Its nodes stay as many: as power and winding space give the ampere turns, they lie as close
    in those. Above `AMPERE_TURNS` the map ends earlier, see `short_of_current`.

    Parameters
    ----------
    grid : MapGrid
        Of the solenoid of the reference.
    design : DoubleStroke
        With its power.
    """
    by_power = math.sqrt(design.valve.power / design.winding().resistance)
    end = min(math.ceil(10.0 * by_power) / 10.0, AMPERE_TURNS / design.turns)
    return replace(grid, largest_current=max(grid.largest_current, end))


def short_of_current(designed: Designed) -> str:
    """Return one line where a coil gets less current than its power allows; "" where it does not.

    Parameters
    ----------
    designed : Designed
        With its map and its surroundings.
    """
    around, end = designed.around, float(designed.curves.currents[-1])
    by_power = math.sqrt(around.power / designed.resistance)
    allowed = f"the {by_power:.3g} A that valve.power = {around.power:g} W allows"
    if end < by_power:
        return (
            f"the map ends at {end:.3g} A, below {allowed}: force margin and steps are those of "
            f"{end:.3g} A; lower valve.power or give a map with a higher --largest-current"
        )
    if around.bias + around.span < by_power:
        return (
            f"valve.bias + valve.span = {around.bias + around.span:.3g} A: the steps get no more, "
            f"the force margin is that of {allowed}; raise valve.span"
        )
    return ""


def compute_design(
    design: DoubleStroke,
    curves: CoenergyMap | None = None,
    fidelity: Fidelity | None = None,
    advance: Callable[[], None] = lambda: None,
    form: str = USUAL_FORM,
    valve: Designable | None = None,
    like: DoubleStroke | None = None,
) -> tuple[Designed, tuple[Dynamics, Dynamics]]:
    """Compute what a valve needs of a double-stroke solenoid.

    Parameters
    ----------
    design : DoubleStroke
        The geometry with its surroundings.
    curves : CoenergyMap, optional
        Its map, where it is computed already.
    fidelity : Fidelity, optional
        How finely fields are computed, default "export" of `FIDELITIES`.
    advance : callable
        Called once a field of the map.
    form : str
        One of `FORMS`; with eddies two more transient fields are computed, with growing three
        moving ones, G_A and G_F are found as well.
    valve : Designable, optional
        Whose steps growing is fitted to, default the only one.
    like : DoubleStroke, optional
        Whose mesh is stretched to the design, default a mesh of its own.

    Raises
    ------
    ValueError
        If a restriction is broken, the map is that of another section or ends too early, or there
        is no such form.
    """
    if form not in FORMS:
        message = f"dynamics '{form}': must be one of {', '.join(FORMS)}"
        raise ValueError(message)
    section, of = design.section(), fidelity or FIDELITIES["export"]
    if like is not None:
        section = replace(section, like=like.section())
    if curves is None:
        curves = compute_map(section, reaching(of.grid, design), advance)
    else:
        unlike(curves, section, of.grid)
    model = make_model(section, of.fine, of.skin)
    time_s, currents = Trapezoid(step=of.step).record(len(section.coils))
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
    if form == "eddies":
        constant = fit_branches(branch_records(model, of.step), curves)
        designed = replace(designed, eddies=constant.numbers())
    elif form == "growing":  # the steps of G_A and G_F excite as those of any form do
        moved = valve or find_designable()
        numbers = moved.of_design(designed)
        loops = [moved.loop(numbers, end, {}, start) for start, end in FITTED]
        records = [step_record(model, curves, loop) for loop in loops]
        grown = fit_growing(records, _matched(section, curves, of, advance))
        designed = replace(designed, eddies=grown.numbers())
    return designed, (of_current, of_force)


def evaluate(
    design: DoubleStroke,
    valve: Designable,
    *,
    robust: bool = False,
    fidelity: Fidelity | None = None,
    computed: tuple[Designed, tuple[Dynamics, Dynamics]] | None = None,
    advance: Callable[[], None] = lambda: None,
    form: str = USUAL_FORM,
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
    fidelity : Fidelity, optional
        How finely fields are computed, default "usual" of `FIDELITIES`.
    computed : tuple, optional
        What `compute_design` returned of this design, where it is known already.
    advance : callable
        Called once a field of the map.
    form : str
        Dynamics of the simulated valve and its controller, one of `FORMS`; those of `computed`
        where it is given.

    Raises
    ------
    ValueError
        If the design cannot be computed or a number does not fit the valve.
    """
    of = fidelity or FIDELITIES["usual"]
    designed, dynamics = computed or compute_design(
        design, fidelity=of, advance=advance, form=form, valve=valve
    )
    numbers = valve.of_design(designed)
    cases: list[dict[str, float]] = [{}]
    if robust:
        corners = product((1.0 - VARIED, 1.0 + VARIED), repeat=len(SCALED))
        cases += [dict(zip(SCALED, corner, strict=True)) for corner in corners]
    runs = [
        {s: evened([valve.loop(numbers, s, case, 0.0, k) for k in range(of.draws)]) for s in STEPS}
        for case in cases
    ]
    margin = valve.force_margin(numbers)
    return Evaluation(numbers, designed, dynamics, runs[0], tuple(runs[1:]), margin)


def evened(loops: Sequence[Loop]) -> Loop:
    """Return a step whose figures are means of several draws; signals are those of the first.

    A rise is then told within the samples, by straight lines between them.

    Parameters
    ----------
    loops : sequence of Loop
        The same step from the middle.
    """
    if len(loops) == 1:
        return loops[0]
    return replace(
        loops[0],
        rise_s=float(np.mean([_rise(of) for of in loops])),
        overshoot=float(np.mean([of.overshoot for of in loops])),
        settling_s=float(np.mean([of.settling_s for of in loops])),
        graded_s=float(np.mean([of.graded_s for of in loops])),
        error=float(np.mean([of.error for of in loops])),
        loss=float(np.mean([of.loss for of in loops])),
    )


def _rise(of: Loop) -> float:
    if not math.isfinite(of.rise_s):
        return of.rise_s
    shown = dict(of.rows)["position [mm]"]
    place = shown["x"] / shown["wanted"]
    low, high = (_crossed(of.time_s, place, level) for level in (0.1, 0.9))
    return high - low


def _crossed(time_s: FloatArray, place: FloatArray, level: float) -> float:
    k = max(int(np.argmax(place >= level)), 1)
    return float(np.interp(level, place[k - 1 : k + 1], time_s[k - 1 : k + 1]))


def _matched(
    section: Section, curves: CoenergyMap, of: Fidelity, advance: Callable[[], None]
) -> CoenergyMap:
    """Return a map on the mesh of the transient field: two meshes differ by no dynamics."""
    if of.grid.fine == of.fine and of.grid.skin == of.skin:
        return curves
    end = float(curves.currents[-1])
    grid = replace(COARSE, fine=of.fine, skin=of.skin, largest_current=end)
    return compute_map(section, grid, advance)


def _numbers(found: Dynamics) -> tuple[float, float, float, float]:
    return found.b1, found.b2, found.a1, found.a2
