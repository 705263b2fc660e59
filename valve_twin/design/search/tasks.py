# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Evaluation of one of many designs, anywhere: a task in, its figures out, a failure as a line."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.designed import Surroundings, find_designable
from valve_twin.design.chain import compute_design, evaluate, find_fidelity, reaching

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from valve_twin.core.physics.coenergy import CoenergyMap
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.designed import Designed
    from valve_twin.design.chain import Evaluation, Fidelity
    from valve_twin.design.dynamics import Dynamics
    from valve_twin.design.geometry import DoubleStroke

    Run = Callable[[Sequence["DesignTask"]], Iterable["Outcome"]]

HEAT_TRANSFER = 12.0
"""Of a yoke's surface to still air, convection and radiation, assumed [W/(m^2 K)]."""

_KEPT = 8  # solenoids whose fields a process keeps
_CURRENTS = (0.75, 1.5, 2.25, 3.0)  # coil A alone, within any map [A]
_PLACES = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of the stroke


@dataclass(frozen=True, slots=True)
class DesignTask:
    """A design to evaluate.

    Attributes
    ----------
    key : str
        What it is known by.
    design : DoubleStroke
        The design.
    values : mapping
        Its changed numbers by dotted name [their units].
    valve : str
        Model of its valve, empty = the first that takes a design.
    fidelity : str
        One of `FIDELITIES`, see `find_fidelity`.
    given : Fidelity, optional
        In place of what the name stands for.
    like : DoubleStroke, optional
        What it is a change of; fields that are `stretched` are on its mesh.
    """

    key: str
    design: DoubleStroke
    values: Mapping[str, float] = field(default_factory=dict)
    valve: str = ""
    fidelity: str = "search"
    given: Fidelity | None = None
    like: DoubleStroke | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a design does, or why it does nothing.

    Attributes
    ----------
    key, fidelity, values : str, str, mapping
        Of its task.
    figures : mapping
        Numbers by name, SI units; see `figures_of`.
    curves : mapping
        "force" [N] and "flux" [Wb] of coil A at 4 currents and 5 places, row by row.
    error : str
        One line where it failed.
    broken : float
        By how much restrictions of the geometry are broken, over their limits [1].
    cpu_s : float
        CPU time [s].
    """

    key: str
    fidelity: str
    values: Mapping[str, float] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    curves: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    error: str = ""
    broken: float = 0.0
    cpu_s: float = 0.0


def evaluate_task(task: DesignTask) -> Outcome:
    """Evaluate a design; what is wrong with it is a value, not an exception.

    Parameters
    ----------
    task : DesignTask
        The design.
    """
    began, known = time.process_time(), (task.key, task.fidelity, task.values)
    try:
        broken = task.design.violations()
        if broken:
            amount = sum(_relative(v.by, v.lower, v.upper) for v in broken)
            said = "; ".join(str(v) for v in broken)
            return Outcome(*known, error=said, broken=amount)
        fidelity = task.given or find_fidelity(task.fidelity)
        valve = find_designable(task.valve)
        solenoid = replace(task.design, valve=Surroundings())
        like = replace(task.like, valve=Surroundings()) if task.like else None
        grid = reaching(fidelity.grid, task.design)
        of = replace(fidelity, grid=grid, draws=1)
        designed, dynamics = _fields_of(solenoid, of, like if fidelity.stretched else None)
        designed = replace(designed, around=task.design.valve)
        found = evaluate(task.design, valve, fidelity=fidelity, computed=(designed, dynamics))
        figures, curves = figures_of(task.design, found), _curves(found.designed.curves)
    except Exception as err:  # one bad design must not stop the others
        kind = "" if isinstance(err, ValueError) else f"{type(err).__name__}: "
        said = kind + " ".join(str(err).split())
        return Outcome(*known, error=said, cpu_s=time.process_time() - began)
    return Outcome(*known, figures, curves, cpu_s=time.process_time() - began)


@lru_cache(maxsize=_KEPT)
def _fields_of(
    solenoid: DoubleStroke, fidelity: Fidelity, like: DoubleStroke | None
) -> tuple[Designed, tuple[Dynamics, Dynamics]]:
    """Return what was computed of a solenoid: springs and controller ask for no new fields."""
    return compute_design(solenoid, fidelity=fidelity, like=like)


def lost_design(task: DesignTask, why: str) -> Outcome:
    """Return the outcome of a design that took its process down.

    Parameters
    ----------
    task : DesignTask
        The design.
    why : str
        One line.
    """
    return Outcome(task.key, task.fidelity, task.values, error=why)


def in_this_process(tasks: Sequence[DesignTask]) -> Iterable[Outcome]:
    """Evaluate designs one after the other."""
    return map(evaluate_task, tasks)


def figures_of(design: DoubleStroke, found: Evaluation) -> dict[str, float]:
    """Return the figures of an evaluation by name.

    A step that does not settle counts as long as it was followed.

    Parameters
    ----------
    design : DoubleStroke
        What was evaluated.
    found : Evaluation
        What it does.

    Returns
    -------
    dict
        rise_s, settling_s, graded_s, loss: means over all steps [s], [W]; overshoot, error: the
        largest [1]; margin [N]; heating: of the yoke over the air [K]; resistance [ohm];
        mass [kg]; poles and zeros of G_A and G_F [Hz].
    """
    loops = found.loops.values()
    followed = min(float(of.time_s[-1]) for of in loops)
    figures = {
        "rise_s": float(np.mean([_limited(of.rise_s, followed) for of in loops])),
        "settling_s": float(np.mean([_limited(of.settling_s, followed) for of in loops])),
        "graded_s": float(np.mean([of.graded_s for of in loops])),
        "overshoot": max(of.overshoot for of in loops),
        "error": max(of.error for of in loops),
        "loss": float(np.mean([of.loss for of in loops])),
        "margin": found.margin,
        "heating": max(of.loss for of in loops) / (HEAT_TRANSFER * surface_of(design)),
        "resistance": found.designed.resistance,
        "mass": found.designed.mass,
    }
    for name, of in zip(("current", "force"), found.dynamics, strict=True):
        for k, (pole, zero) in enumerate(zip(of.poles_hz, _zeros(of), strict=True), start=1):
            figures |= {f"{name}_pole_{k}_hz": pole, f"{name}_zero_{k}_hz": zero}
    return figures


def surface_of(design: DoubleStroke) -> float:
    """Return the outer surface of a solenoid: its yoke and both ends [m^2]."""
    outlines = [p for region in design.section().regions for p in region.outline]
    radius, half = max(r for r, _ in outlines), max(z for _, z in outlines)
    return 2.0 * math.pi * radius * (2.0 * half + radius)


def _zeros(of: Dynamics) -> tuple[float, float]:
    """Return the magnitudes of both zeros, the lower first [Hz]; infinite where there is none."""
    found = sorted(np.abs(np.roots([of.b2, of.b1, 1.0])) / (2.0 * math.pi))
    low, high = (*found, math.inf, math.inf)[:2]
    return float(low), float(high)


def _curves(curves: CoenergyMap) -> dict[str, tuple[float, ...]]:
    """Return force [N] and flux linkage [Wb] of coil A at `_CURRENTS` and `_PLACES`."""
    currents = np.zeros((len(_CURRENTS) * len(_PLACES), len(curves.coils)))
    currents[:, 0] = np.repeat(_CURRENTS, len(_PLACES))
    x: FloatArray = np.tile(np.array(_PLACES) * curves.positions[-1], len(_CURRENTS))
    flux = curves.flux(currents, x)[:, 0]
    return {"force": tuple(curves.force(currents, x).tolist()), "flux": tuple(flux.tolist())}


def _limited(value: float, most: float) -> float:
    return min(value, most) if math.isfinite(value) else most


def _relative(by: float, lower: float, upper: float) -> float:
    """Return how far a value is off over the size of its limits, at most 1 [1]."""
    size = max((abs(v) for v in (lower, upper) if math.isfinite(v)), default=1.0)
    return min(by / size, 1.0) if size > 0.0 else 1.0
