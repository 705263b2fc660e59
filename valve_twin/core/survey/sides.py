# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Two one-sided commands that drive a position: a valve of two, or what follows their difference.

A cartridge between two pilots and a cylinder behind a valve with two solenoids look alike: both
rise with one command and fall with the other. What follows later cycles better is proposed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, nan
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.survey.choose import Halves, Pair, halve_cycles, with_baselines
from valve_twin.core.survey.pairs import Signal, hold
from valve_twin.core.survey.trial import Mapping01, as_good, try_baseline, try_models, try_sides
from valve_twin.core.valves.registry import get_model

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from valve_twin.core.survey.record import Proposal, Role
    from valve_twin.core.survey.trial import Trial

_CLEARLY = 2.0
"""Times the misfit of the best from which on two commands are taken for one [1].

Set on 16 strangers' presses (73000 to 73016): where it reads them at all its misfit is at most
1.5 times that of an integrator, that of cylinders with a dead band 4 times and more."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """What models of one and of two commands make of a record.

    Attributes
    ----------
    pair : Pair
        The difference of the commands, and the answer.
    halves : Halves
        Cycles that were fitted and cycles that were not.
    trials : list of Trial
        That of the choice first.
    baseline : Trial, optional
        A black box.
    two : bool
        Whether the model of two commands is the choice.
    """

    pair: Pair
    halves: Halves
    trials: list[Trial]
    baseline: Trial | None
    two: bool


def roles_of_sides(driven: Proposal) -> tuple[Role, Role, Role]:
    """Return the roles of the answer, of what raises it and of what lowers it."""
    model = get_model(driven.model)
    roles = {r.signal: r for r in driven.roles}
    answer, up, down = (roles[name] for name in (model.output, *model.inputs))
    return answer, up, down


def difference_of(signals: Mapping[str, Signal], driven: Proposal, *, mapped: bool) -> Signal:
    """Return the difference of two commands, which is nameless.

    Parameters
    ----------
    signals : mapping
        Columns by name.
    driven : Proposal
        Which commands.
    mapped : bool
        Whether as their model takes them, in parts of full scale, else as they are.
    """
    sides = roles_of_sides(driven)[1:]
    at = signals[sides[0].source].stamp_ns
    up, down = (
        hold(signals[r.source], at) * (r.scale if mapped else 1.0) + (r.offset if mapped else 0.0)
        for r in sides
    )
    return Signal("", at, up - down)


def compare_sides(
    signals: Mapping[str, Signal],
    driven: Proposal,
    whole: Signal,
    maps_of: Callable[[Pair], tuple[Mapping01, Mapping01]],
    *,
    period_s: float,
    kind: str = "",
    named: bool = False,
) -> Comparison | None:
    """Return which models follow two commands, None where there are too few cycles.

    Each is fitted to the first cycles and runs freely through each of those that follow.

    Parameters
    ----------
    signals : mapping
        Columns by name.
    driven : Proposal
        The two commands.
    whole : Signal
        Their difference.
    maps_of : callable
        Gives the maps of the difference and the answer to 0..1.
    period_s : float
        Of the answer [s].
    kind : str
        What the answer is, empty = unknown.
    named : bool
        Whether names say that they are commands.
    """
    answer = roles_of_sides(driven)[0]
    opened = driven.cycles.opened_ns
    both = {whole.name: whole, answer.source: signals[answer.source]}
    halves = halve_cycles(both, whole.name, answer.source, opened)
    both[""] = difference_of(signals, driven, mapped=True)
    apart = halve_cycles(both, "", answer.source, opened)
    if halves is None or apart is None:
        return None
    alike = copysign(driven.correlation, answer.scale)
    pair = Pair(whole.name, answer.source, driven.lag, alike, nan, nan, named)
    pair, maps = with_baselines(halves, pair), maps_of(pair)
    own = [  # what is seen counts as from stop to stop, as for the others
        try_sides(get_model(driven.model), apart, period_s, of)
        for of in (maps[1], Mapping01(answer.scale, answer.offset))
    ]
    of_two = max(own, key=lambda t: float(np.nan_to_num(t.fit, nan=-1e9)))
    falls = alike < 0.0
    trials = try_models(halves, period_s, pair.lag, falls=falls, kind=kind, maps=maps)
    baseline = try_baseline(halves, period_s, pair.lag, maps=maps)
    best = trials[0]
    two = not best.fit > 0.0 or as_good(of_two.fit, best.fit, _CLEARLY)
    trials = [of_two, *trials] if two else [*trials, of_two]
    return Comparison(pair, halves, trials, baseline, two)
