# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""NSGA-II over the numbers of a design, by ask and tell, with an archive of all that was tried.

The genetic algorithm follows from its seed alone: an interrupted run asks for the same designs
again, finds those that the archive has, and computes the others only. The search runs on coarse
fields; its front is evaluated again on finer ones. By default these are the usual ones and twice
their elements along a line, and the front that is returned is that of the designs whose figures
agree on both: the loop of some is on the edge of one more rebound.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities
from valve_twin.design.chain import find_fidelity
from valve_twin.design.search.front import (
    Limits,
    agree,
    chosen_of,
    front_of,
    hypervolume,
    objectives,
)
from valve_twin.design.search.tasks import DesignTask, Outcome
from valve_twin.design.search.variables import changed, key_of, make_variable, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from pymoo.core.algorithm import Algorithm

    from valve_twin.core.types import FloatArray
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.search.archive import Archive
    from valve_twin.design.search.tasks import Run
    from valve_twin.design.search.variables import Variable

VARIED: Mapping[str, tuple[float, float]] = {
    "armature_radius": (7.2e-3, 9e-3),
    "gap_ratio": (0.16, 0.24),
    "overlap_ratio": (0.15, 0.6),
    "tip_ratio": (0.12, 0.45),
    "turns": (260, 400),
    "valve.spring_rate": (5e3, 1.6e4),
    "valve.preload": (5.0, 30.0),
    "valve.horizon": (10, 40),
    "valve.overshoot": (2.0, 30.0),
    "valve.speed_time": (5e-5, 5e-4),
}
"""What is searched where nothing else is said: geometry, turns, springs, controller; assumed."""

CHECK, CHECKED = "usual", "twice"
"""Fields of a front on which its figures have to agree where the final ones are the second."""

_DRAWN = (
    8  # first designs drawn for one that is taken: those whose geometry is feasible come first
)
_NOTHING = Outcome("", "", error="not evaluated")  # tells how many objectives and limits there are


@dataclass(frozen=True, slots=True)
class Settings:
    """How a search runs."""

    population: int = assumed(16, "1", "Designs of a generation", 2, 10000)
    generations: int = assumed(10, "1", "Generations", 1, 100000)
    seed: int = assumed(0, "1", "Of all random numbers", 0, 2**31 - 1)
    seconds: float = assumed(
        0.0, "s", "Time after which no generation is begun any more, 0 = any", 0.0, 1e8
    )
    fidelity: str = "search"
    final: str = "twice"
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        """Refuse numbers outside their range."""
        check_quantities(self)
        for name in (self.fidelity, self.final):
            find_fidelity(name)


@dataclass(frozen=True, slots=True)
class Problem:
    """What is searched.

    Attributes
    ----------
    start : DoubleStroke
        The reference; its values stand among the first designs.
    variables : tuple of Variable
        What is changed.
    valve : str
        Model of its valve, empty = the first that takes a design.
    """

    start: DoubleStroke
    variables: tuple[Variable, ...]
    valve: str = ""

    def values(self, shares: Iterable[float]) -> dict[str, float]:
        """Return the numbers at shares of the ways between their bounds [1]."""
        return {v.name: v.at(float(s)) for v, s in zip(self.variables, shares, strict=True)}

    def task(self, values: Mapping[str, float], fidelity: str) -> DesignTask:
        """Return the task of a design.

        Parameters
        ----------
        values : mapping
            Its numbers by name [their units].
        fidelity : str
            One of `FIDELITIES`.
        """
        return DesignTask(
            key_of(values), changed(self.start, values), values, self.valve, fidelity
        )


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a search stands.

    Attributes
    ----------
    generation, generations : int
        Done and wanted.
    designs, failed, kept : int
        Different ones so far; of these failed; of these within all limits.
    front : int
        Designs on the front.
    hypervolume : float
        Of the front of all that was found so far [1].
    """

    generation: int
    generations: int
    designs: int
    failed: int
    kept: int
    front: int
    hypervolume: float


@dataclass(frozen=True, slots=True)
class Found:
    """What a search found.

    Attributes
    ----------
    reference : Outcome
        Of the start, on the final fields.
    front : tuple of Outcome
        On the final fields, sorted by rise.
    chosen : Outcome
        One of them: its worse of rise and settling over the reference is the best.
    searched : tuple of Outcome
        All designs of the search, on its fields.
    history : tuple of Progress
        One a generation.
    apart : tuple of Outcome
        Designs on the final fields that were left out: on half the elements along a line, the
        usual fields, their figures differ.
    ended : str
        Which limit ended the search, its generations or its time, one line.
    """

    reference: Outcome
    front: tuple[Outcome, ...]
    chosen: Outcome
    searched: tuple[Outcome, ...]
    history: tuple[Progress, ...]
    apart: tuple[Outcome, ...] = ()
    ended: str = ""


def make_problem(
    start: DoubleStroke, varied: Mapping[str, tuple[float, float]] = VARIED, valve: str = ""
) -> Problem:
    """Return a problem.

    Parameters
    ----------
    start : DoubleStroke
        The reference.
    varied : mapping
        Bounds by dotted name [their units].
    valve : str
        Model of its valve, empty = the first that takes a design.

    Raises
    ------
    ValueError
        If there is nothing to change, a name is unknown, or bounds are reversed or leave out the
        reference.
    """
    if not varied:
        message = "nothing is varied: name a number of the design and its bounds"
        raise ValueError(message)
    variables = tuple(make_variable(start, name, *bounds) for name, bounds in varied.items())
    for v in variables:
        value = value_of(start, v.name)
        if not v.lower <= value <= v.upper:
            message = (
                f"{v.name} = {value:g} of the reference: lies outside its bounds {v.lower:g} to "
                f"{v.upper:g}"
            )
            raise ValueError(message)
    return Problem(start, variables, valve)


def optimise(
    problem: Problem,
    settings: Settings,
    archive: Archive,
    run: Run,
    tell: Callable[[Progress], None] = lambda progress: None,
    advance: Callable[[], None] = lambda: None,
    expect: Callable[[int], None] = lambda more: None,
    clock: Callable[[], float] = time.monotonic,
) -> Found:
    """Search for better designs.

    Parameters
    ----------
    problem : Problem
        What is searched.
    settings : Settings
        How.
    archive : Archive
        Of the same problem; what it has is not computed again.
    run : callable
        Evaluates tasks anywhere.
    tell : callable
        Called once a generation.
    advance : callable
        Called once a design on its fields, also where the archive has it.
    expect : callable
        Called with how many evaluations the search adds to its population times generations: the
        front on the final fields.
    clock : callable
        Returns the time [s].

    Raises
    ------
    ValueError
        If the reference cannot be evaluated or no design keeps all limits; says what was nearest.
    """
    began = clock()
    start = {v.name: value_of(problem.start, v.name) for v in problem.variables}
    start = problem.values([v.share(start[v.name]) for v in problem.variables])
    (reference,) = archive.outcomes([problem.task(start, settings.fidelity)], run)
    if reference.error:
        message = f"the reference cannot be evaluated: {reference.error}"
        raise ValueError(message)
    figures, limits = reference.figures, settings.limits
    algorithm = _algorithm(problem, settings, [v.share(start[v.name]) for v in problem.variables])
    searched: dict[str, Outcome] = {}
    history: list[Progress] = []
    while algorithm.has_next():
        asked = algorithm.ask()
        wanted = [problem.values(row) for row in asked.get("X")]
        tasks = [problem.task(v, settings.fidelity) for v in wanted]
        found = archive.outcomes(tasks, run, advance)
        searched |= {of.key: of for of in found}
        asked.set("F", np.array([objectives(of, figures) for of in found]))
        asked.set("G", np.array([list(limits.broken(of, figures).values()) for of in found]))
        algorithm.tell(infills=asked)
        front = front_of(tuple(searched.values()), limits, figures)
        failed = sum(bool(of.error) for of in searched.values())
        kept = sum(limits.keeps(of, figures) for of in searched.values())
        volume = hypervolume(front, figures)
        counts = (len(searched), failed, kept, len(front))
        history.append(Progress(len(history) + 1, settings.generations, *counts, volume))
        tell(history[-1])
        if settings.seconds and clock() - began >= settings.seconds:
            break
    ended = _ended(history[-1], settings.seconds)
    if not front:
        raise ValueError(_nearest(tuple(searched.values()), limits, figures))
    wanted = [start, *(dict(of.values) for of in front)]
    check = settings.final == CHECKED
    expect((1 + check) * len(wanted))
    finals = archive.outcomes([problem.task(v, settings.final) for v in wanted], run, advance)
    true = finals[0]
    if true.error:
        message = f"the reference cannot be evaluated: {true.error}"
        raise ValueError(message)
    if check:
        archive.outcomes([problem.task(v, CHECK) for v in wanted], run, advance)
    apart = apart_of(finals, archive, settings.final)
    best = front_of([of for of in finals if of not in apart], limits, true.figures)
    if not best:
        raise ValueError(_nearest(finals, limits, true.figures, len(apart)))
    chosen = chosen_of(best, true.figures)
    return Found(true, best, chosen, tuple(searched.values()), tuple(history), apart, ended)


def _ended(at: Progress, seconds: float) -> str:
    """Return which limit ended a search, in one line."""
    done = f"{at.generation} of {at.generations} generations, {at.designs} different designs"
    if at.generation < at.generations:
        return f"the search ended by its time, {seconds:g} s: {done}; the same command goes on"
    return f"the search ended by its generations: {done}"


def apart_of(finals: Sequence[Outcome], archive: Archive, final: str) -> tuple[Outcome, ...]:
    """Return the designs whose figures on the final fields are not those on the fields `CHECK`.

    Parameters
    ----------
    finals : sequence of Outcome
        On the final fields.
    archive : Archive
        Has them on `CHECK` as well, where the final fields are `CHECKED`.
    final : str
        Name of the final fields; others than `CHECKED` are not compared.
    """
    if final != CHECKED:
        return ()
    half = {of.key: archive.get(of.key, CHECK) for of in finals}
    known = {key: of for key, of in half.items() if of is not None}
    return tuple(of for of in finals if of.key not in known or not agree(of, known[of.key]))


def _algorithm(problem: Problem, settings: Settings, start: Sequence[float]) -> Algorithm:
    """Return NSGA-II over shares of the ways between bounds, the start among its first."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import Problem as Space
    from pymoo.operators.sampling.lhs import LHS

    count = len(problem.variables)
    limits = len(settings.limits.broken(_NOTHING, {}))
    space = Space(n_var=count, n_obj=len(objectives(_NOTHING, {})), n_ieq_constr=limits,
                  xl=np.zeros(count), xu=np.ones(count))  # fmt: skip
    rng = np.random.default_rng(settings.seed)
    drawn = LHS().do(space, _DRAWN * settings.population, random_state=rng).get("X")
    broken = [len(changed(problem.start, problem.values(row)).violations()) for row in drawn]
    first: FloatArray = drawn[np.argsort(broken, kind="stable")][: settings.population]
    first[0] = start
    algorithm = NSGA2(pop_size=settings.population, sampling=first)
    algorithm.setup(
        space, termination=("n_gen", settings.generations), seed=settings.seed, verbose=False
    )
    return algorithm


def _nearest(
    found: Sequence[Outcome], limits: Limits, reference: Mapping[str, float], apart: int = 0
) -> str:
    """Return one line about the design that came nearest to keeping all limits."""
    nearest = min(found, key=lambda of: sum(max(v, 0.0) for v in
                                            limits.broken(of, reference).values()))  # fmt: skip
    said = limits.said(nearest, reference)
    if not said:
        return f"none of {len(found)} designs is left: {apart} differ on {CHECK} and {CHECKED}"
    return f"none of {len(found)} designs keeps all limits; the nearest, {nearest.key}: {said}"
