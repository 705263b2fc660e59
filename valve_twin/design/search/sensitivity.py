# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""What each dimension does: one at a time, as paper 000, and shares of the variance (Sobol')."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import Kind, describe, suggest
from valve_twin.design.search.surrogate import fit_surrogate
from valve_twin.design.search.tasks import DesignTask
from valve_twin.design.search.variables import changed, dimensions, key_of, make_variable, value_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.design.geometry import DoubleStroke
    from valve_twin.design.search.archive import Archive
    from valve_twin.design.search.surrogate import Surrogate
    from valve_twin.design.search.tasks import Outcome, Run

SHARE = 0.05
"""Change of a number, up and down; paper 000 [1]."""

LOOP = ("rise_s", "settling_s", "overshoot", "loss")
"""Figures of the closed loop."""

STATIC = ("force", "flux", "margin")
"""Largest force and flux linkage of coil A on the static curves, least force left on the way."""

POLES = ("current_pole_2_hz", "force_pole_2_hz")
"""Faster poles of G_A and G_F; the slower ones lie on or near their bound."""

POOREST = 0.7
"""Share of the variance that a surrogate must tell of designs it has not seen, assumed [1]."""

_SALTELLI = 1024  # base points of the indices on the surrogate


@dataclass(frozen=True, slots=True)
class Study:
    """A design and how changes of it are evaluated.

    Attributes
    ----------
    design : DoubleStroke
        The design; its stroke is kept unless the stroke's own ratio is changed.
    archive : Archive
        What it has is not computed again.
    run : callable
        Evaluates tasks anywhere.
    valve, fidelity : str
        As of `DesignTask`.
    advance : callable
        Called once a design.
    """

    design: DoubleStroke
    archive: Archive
    run: Run
    valve: str = ""
    fidelity: str = "evened"
    advance: Callable[[], None] = lambda: None

    def outcomes(self, wanted: Sequence[Mapping[str, float]]) -> list[Outcome]:
        """Return the outcomes of the design with changed numbers, by dotted name [their units]."""
        tasks = [
            DesignTask(
                key_of(v), changed(self.design, v), v, self.valve, self.fidelity, like=self.design
            )
            for v in wanted
        ]
        return self.archive.outcomes(tasks, self.run, self.advance)


@dataclass(frozen=True, slots=True)
class Effect:
    """What a number of a design does when it alone is lower and higher.

    Attributes
    ----------
    name : str
        The number.
    lower, upper : float
        Its two values [its unit].
    force, flux : float
        Largest change of the static curve of either, over its largest value [1].
    figures : mapping
        By name of a figure, its values at the lower and the higher number [SI].
    error : str
        One line where either design failed; the figures are then NaN there.
    """

    name: str
    lower: float
    upper: float
    force: float
    flux: float
    figures: Mapping[str, tuple[float, float]]
    error: str = ""


@dataclass(frozen=True, slots=True)
class Indices:
    """Sobol' indices of one figure.

    Attributes
    ----------
    figure : str
        Its name.
    surrogate : Surrogate
        What stands for the field computation, with its error.
    first, total : mapping
        By name of a number: index, and the lower and upper end of its 95 % interval, over the
        points of the estimate and over surrogates that each lack a part of the designs [1].
    refused : str
        Why there are none.
    """

    figure: str
    surrogate: Surrogate | None
    first: Mapping[str, tuple[float, float, float]]
    total: Mapping[str, tuple[float, float, float]]
    refused: str = ""


def names_of(design: DoubleStroke, given: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the numbers to change: those given, else all dimensions of the solenoid.

    Parameters
    ----------
    design : DoubleStroke
        The design.
    given : sequence of str
        Dotted names.

    Raises
    ------
    ValueError
        If the design has no such number or it is 0.
    """
    known = {d.name for d in describe(design) if d.kind in {Kind.FLOAT, Kind.INT}}
    for name in given:
        if name not in known:
            message = f"'{name}' is no number of the design; {suggest(name, known)}"
            raise ValueError(message)
        if not value_of(design, name):
            message = f"{name} = 0: a share of it is no change; leave it out"
            raise ValueError(message)
    return tuple(given) or dimensions(design)


def one_at_a_time(
    study: Study, names: Sequence[str], share: float = SHARE
) -> tuple[Outcome, tuple[Effect, ...]]:
    """Evaluate a design with each number lower and higher.

    Parameters
    ----------
    study : Study
        The design and how it is evaluated.
    names : sequence of str
        Numbers to change.
    share : float
        Change of a number over its value [1].

    Raises
    ------
    ValueError
        If the design itself cannot be evaluated.
    """
    design = study.design
    base: dict[str, float] = {}
    sides = {
        name: tuple(_scaled(design, name, 1.0 + sign * share) for sign in (-1.0, 1.0))
        for name in names
    }
    wanted = [base, *({n: v} for n, both in sides.items() for v in both)]
    found = study.outcomes(wanted)
    middle, others = found[0], iter(found[1:])
    if middle.error:
        message = f"the design itself cannot be evaluated: {middle.error}"
        raise ValueError(message)
    effects = [_effect(n, sides[n], middle, (next(others), next(others))) for n in names]
    return middle, tuple(effects)


def sobol_indices(
    study: Study,
    names: Sequence[str],
    samples: int,
    *,
    figures: Sequence[str] = (*LOOP, *STATIC, *POLES),
    share: float = SHARE,
    seed: int = 0,
) -> tuple[Indices, ...]:
    """Return the shares of each number, changed together with the others, in the variance.

    Parameters
    ----------
    study : Study
        The design in the middle and how designs are evaluated.
    names : sequence of str
        Two or more numbers, each even within plus and minus `share`.
    samples : int
        Designs to evaluate.
    figures : sequence of str
        Names of figures or of static curves, of which the largest value counts.
    share : float
        Range of a number to either side over its value [1].
    seed : int
        Of the designs and of the indices.

    Raises
    ------
    ValueError
        If there are fewer than two numbers or too few designs.
    """
    from scipy.stats import qmc

    least = fewest_designs(len(names), samples)
    design = study.design
    variables = [
        make_variable(design, n, *sorted(value_of(design, n) * (1.0 + s * share) for s in (-1, 1)))
        for n in names
    ]
    drawn = qmc.LatinHypercube(len(names), rng=np.random.default_rng(seed)).random(samples)
    wanted = [{v.name: v.at(s) for v, s in zip(variables, row, strict=True)} for row in drawn]
    found = study.outcomes(wanted)
    good = np.array([not of.error for of in found])
    points = np.array([[v.share(row[v.name]) for v in variables] for row in wanted])[good]
    kept = [of for of in found if not of.error]
    if len(kept) < least:
        message = f"{len(found) - len(kept)} of {len(found)} designs failed: {_first_error(found)}"
        raise ValueError(message)
    return tuple(
        _indices(f, names, points, np.array([figure_of(of, f) for of in kept]), seed)
        for f in figures
    )


def figure_of(outcome: Outcome, name: str) -> float:
    """Return a figure of an outcome; of a static curve its largest value [SI]."""
    if name in outcome.curves:
        return float(np.abs(outcome.curves[name]).max())
    return outcome.figures[name]


def fewest_designs(numbers: int, samples: int) -> int:
    """Return how many designs the indices of some numbers take at least.

    Parameters
    ----------
    numbers, samples : int
        Numbers that are changed, designs to evaluate.

    Raises
    ------
    ValueError
        If there are fewer than two numbers or too few designs.
    """
    least = 2 * (numbers + 1)
    if numbers < 2 or samples < least:
        message = (
            f"{numbers} numbers, {samples} designs: indices take 2 numbers or more and "
            f"{least} designs or more"
        )
        raise ValueError(message)
    return least


def _scaled(design: DoubleStroke, name: str, factor: float) -> float:
    value = value_of(design, name)
    whole = isinstance(getattr(design, name, 0.0), int)
    return float(round(value * factor)) if whole else float(f"{value * factor:.6g}")


def _effect(
    name: str, sides: Sequence[float], middle: Outcome, both: tuple[Outcome, Outcome]
) -> Effect:
    figures = {
        key: (both[0].figures.get(key, math.nan), both[1].figures.get(key, math.nan))
        for key in middle.figures
    }
    return Effect(
        name,
        sides[0],
        sides[1],
        _largest_change("force", middle, both),
        _largest_change("flux", middle, both),
        figures,
        _first_error(both),
    )


def _largest_change(curve: str, middle: Outcome, both: Sequence[Outcome]) -> float:
    """Return the largest change of a curve over its largest value [1]."""
    own = np.array(middle.curves[curve])
    changes = [
        float(np.abs(np.array(of.curves[curve]) - own).max()) for of in both if not of.error
    ]
    return max(changes) / float(np.abs(own).max()) if changes else math.nan


def _first_error(found: Sequence[Outcome]) -> str:
    return next((of.error for of in found if of.error), "")


def _indices(
    figure: str, names: Sequence[str], points: FloatArray, values: FloatArray, seed: int
) -> Indices:
    """Return the indices of one figure on the surrogate of its values."""
    if not np.ptp(values) > 0.0:
        return Indices(figure, None, {}, {}, "it is the same in all designs")
    surrogate = fit_surrogate(points, values, seed)
    if surrogate.told < POOREST:
        told = (
            f"the best surrogate ({surrogate.kind}) tells {100 * surrogate.told:.0f} % of the "
            f"variance of designs it has not seen; {100 * POOREST:.0f} % are needed: evaluate more"
        )
        return Indices(figure, surrogate, {}, {}, told)
    from SALib.analyze import sobol as analyze
    from SALib.sample import sobol as sample

    space = {"num_vars": len(names), "names": list(names), "bounds": [[0.0, 1.0]] * len(names)}
    at = sample.sample(space, _SALTELLI, calc_second_order=False, seed=seed + 1)
    runs = [
        analyze.analyze(
            space, model(at), calc_second_order=False, seed=seed + 1
        )  # 0 is none to it
        for model in (surrogate.model, *surrogate.parts)
    ]

    def ends(key: str) -> dict[str, tuple[float, float, float]]:
        middle = np.asarray(runs[0][key])
        margin = np.asarray(runs[0][f"{key}_conf"])
        every = np.array([run[key] for run in runs])
        low = np.minimum(middle - margin, every.min(axis=0))
        high = np.maximum(middle + margin, every.max(axis=0))
        return {
            n: (float(m), float(a), float(b))
            for n, m, a, b in zip(names, middle, low, high, strict=True)
        }

    return Indices(figure, surrogate, ends("S1"), ends("ST"))
