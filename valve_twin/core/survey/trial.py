# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Try every model that takes one command and one answer on a part of a record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.estimation.cycle.memory import Memory, model_in_force
from valve_twin.core.estimation.cycle.sequence import estimate_cycle
from valve_twin.core.prediction import fit_percent, restart_marks, run_model
from valve_twin.core.quantity import describe
from valve_twin.core.types import Cycle, Estimate, EstimateStatus, Frames, Restart
from valve_twin.core.valves.registry import complete_options, get_model, model_names

if TYPE_CHECKING:
    from collections.abc import Mapping

    from valve_twin.core.survey.choose import Halves
    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.interface import ValveModel

GENERIC = "any"
"""What a black box is proposed for: it is no model of a valve, and not tried beside them."""

_MARGIN = 1.1  # a misfit less than this many times the least is not worth more terms, assumed
_HELPS = 0.5  # a term that adds less to the fit is not built on [%], assumed
_BASELINE_SAMPLES = 800  # of a half that a black box is chosen on: it bounds the time, assumed
_REACH = 4  # samples that the scan of the delay reaches beyond twice the lag found


@dataclass(frozen=True, slots=True)
class Mapping01:
    """signal = scale * column + offset."""

    scale: float
    offset: float

    def of(self, values: FloatArray) -> FloatArray:
        """Return mapped values, (N,) [1]."""
        mapped: FloatArray = self.scale * values + self.offset
        return mapped


@dataclass(frozen=True, slots=True)
class Trial:
    """What a model made of a part of the record.

    Attributes
    ----------
    model : str
        Its name.
    options : dict
        Options other than the defaults.
    fit : float
        Free run on the half that was not trained on [%]; NaN = none.
    reason : str
        Why there is none.
    command, answer : Mapping01
        Columns to the model's signals.
    simulated : (N,) array
        The free run over that half [unit of the column]; empty = none.
    """

    model: str
    options: dict[str, object]
    fit: float
    reason: str
    command: Mapping01
    answer: Mapping01
    simulated: FloatArray


def try_models(
    halves: Halves,
    period_s: float,
    lag: int,
    *,
    falls: bool,
    kind: str,
    maps: tuple[Mapping01, Mapping01],
) -> list[Trial]:
    """Fit the models to the first half and run them freely over the second; the best first.

    Of misfits within a tenth the one of fewer terms comes first, an example model last.

    Parameters
    ----------
    halves : Halves
        Command and answer.
    period_s : float
        Of the answer in the record [s].
    lag : int
        Command to answer in the record [samples].
    falls : bool
        Whether the answer falls as the command rises.
    kind : str
        What the answer is, "" = unknown: a model of a pressure takes no position.
    maps : pair of Mapping01
        Command and answer to 0..1 for models that want parts of full scale.
    """
    trials = []
    for model in _valves():
        if len(model.inputs) != 1 or not _accepts(model, kind):
            continue
        given = maps if model.normalised else _symmetric(halves, falls=falls)
        trials += _grown(model, halves, period_s, given, 2 * lag + _REACH)
    best = max((t.fit for t in trials if np.isfinite(t.fit)), default=0.0)

    def rank(trial: Trial) -> tuple[bool, int, bool, float]:
        near = as_good(trial.fit, best)
        terms = sum(value is True for value in trial.options.values()) if near else 0
        example = near and not get_model(trial.model).proposed_for
        return not near, terms, example, -float(np.nan_to_num(trial.fit, nan=-1e9))

    return sorted(trials, key=rank)


def as_good(fit: float, best: float, margin: float = _MARGIN) -> bool:
    """Return whether a misfit is at most so many times the least.

    Parameters
    ----------
    fit, best : float
        Fits, NaN = none [%].
    margin : float
        That many times [1].
    """
    return 100.0 - fit <= margin * (100.0 - best)


def _valves() -> list[ValveModel]:
    """Return the models of valves, without one that is the law of another by its own name."""
    found = [get_model(name) for name in model_names()]
    proposed = {type(m) for m in found if m.proposed_for}
    return [
        m
        for m in found
        if m.proposed_for != GENERIC
        and (m.proposed_for or not proposed.intersection(type(m).__mro__[1:]))
    ]


def try_baseline(
    halves: Halves, period_s: float, lag: int, *, maps: tuple[Mapping01, Mapping01]
) -> Trial | None:
    """Return what a black box makes of the same halves, None where there is none.

    Parameters
    ----------
    halves : Halves
        Command and answer.
    period_s : float
        Of the answer in the record [s].
    lag : int
        Command to answer in the record [samples].
    maps : pair of Mapping01
        Command and answer to 0..1.
    """
    generic = [m for m in map(get_model, model_names()) if m.proposed_for == GENERIC]
    if not generic:
        return None
    thin = max(1, -(-len(halves.y) // _BASELINE_SAMPLES))
    part = replace(
        halves,
        every=halves.every * thin,
        u=halves.u[::thin],
        y=halves.y[::thin],
        unseen_u=halves.unseen_u[::thin],
        unseen_y=halves.unseen_y[::thin],
        begins=tuple(b // thin for b in halves.begins),
        unseen_begins=tuple(b // thin for b in halves.unseen_begins),
    )
    tried = _grown(generic[0], part, period_s, maps, lag + _REACH)[0]
    if thin > 1:  # one value a sample, as the others
        simulated = np.repeat(tried.simulated, thin)[: len(halves.unseen_y)]
        tried = replace(tried, simulated=simulated)
    return tried


def try_sides(model: ValveModel, halves: Halves, period_s: float, answer: Mapping01) -> Trial:
    """Return what a model of two one-sided commands makes of the two sides of one, at 0 at rest.

    It is fitted cycle by cycle, as its twin does it.

    Parameters
    ----------
    model : ValveModel
        That model.
    halves : Halves
        Command to 0..1 on either side of 0, and answer.
    period_s : float
        Of the answer in the record [s].
    answer : Mapping01
        Answer to 0..1.
    """
    return _try(
        model, {}, halves, period_s * halves.every, (Mapping01(1.0, 0.0), answer), halves.begins
    )


def _accepts(model: ValveModel, kind: str) -> bool:
    return not kind or model.normalised or kind.endswith(model.output)


def _symmetric(halves: Halves, *, falls: bool) -> tuple[Mapping01, Mapping01]:
    """Return maps for a model in its own units: the command to +-1, the answer to deviation 1."""
    largest = float(np.abs(halves.u).max()) or 1.0
    spread = float(np.std(halves.y)) or 1.0
    centre = float(np.mean(halves.y))
    centre = centre if abs(centre) > 3.0 * spread else 0.0
    sign = -1.0 if falls else 1.0
    return Mapping01(sign / largest, 0.0), Mapping01(1.0 / spread, -centre / spread)


def _grown(
    model: ValveModel,
    halves: Halves,
    period_s: float,
    maps: tuple[Mapping01, Mapping01],
    reach: int,
) -> list[Trial]:
    """Try the defaults, then add terms of the model's variants one by one while they help.

    Options are those of the record: `period_s` [s] and `reach` [samples] are not thinned.
    """
    known = {d.name: d for d in describe(model.options)}
    options: dict[str, object] = {}
    if "max_delay_s" in known:
        options["max_delay_s"] = min(reach * period_s, known["max_delay_s"].upper)
    if "max_lag" in known:
        most = min(reach, int(known["max_lag"].upper))
        options["max_lag"] = max(most, complete_options(model, {}).max_lag)
    step_s = period_s * halves.every
    tried = [_try(model, options, halves, step_s, maps)]
    best = tried[0]
    terms = {name: value for variant in model.variants for name, value in variant.items()}
    while terms:
        more = [
            _try(model, best.options | {name: value}, halves, step_s, maps)
            for name, value in terms.items()
        ]
        tried += more
        found = max(more, key=lambda t: float(np.nan_to_num(t.fit, nan=-1e9)))
        if not np.nan_to_num(found.fit, nan=-1e9) > np.nan_to_num(best.fit, nan=-1e9) + _HELPS:
            break
        best = found
        terms = {k: v for k, v in terms.items() if k not in best.options}
    return tried


def _try(
    model: ValveModel,
    options: Mapping[str, object],
    halves: Halves,
    step_s: float,
    maps: tuple[Mapping01, Mapping01],
    begins: tuple[int, ...] = (),
) -> Trial:
    command, answer = maps
    u, y = command.of(halves.u), answer.of(halves.y)
    cuts = [0, *begins[1:], len(y)]
    unseen = _frames(
        model, command.of(halves.unseen_u), answer.of(halves.unseen_y), len(halves.u), step_s
    )
    given = dict(options)  # a thinned part has coarser steps
    if isinstance(reach := given.get("max_delay_s"), float):
        given["max_delay_s"] = max(reach, step_s)
    if isinstance(reach := given.get("max_lag"), int):
        given["max_lag"] = -(-reach // halves.every)
    complete = complete_options(model, given)
    estimates: list[Estimate] = []
    memory = Memory.empty()
    for number, (a, b) in enumerate(pairwise(cuts), start=1):
        train = _frames(model, u[a:b], y[a:b], a, step_s)
        made, memory = estimate_cycle(model, complete, Cycle(number, step_s, train), memory)
        estimates += made
    force = model_in_force(model, memory, step_s, complete)
    fit, reason, simulated = float("nan"), "", np.empty(0)
    if force is None:
        refused = [e.reason for e in estimates if e.status is EstimateStatus.REFUSED]
        reason = refused[0] if refused else "not every parameter is known"
    else:
        marks = restart_marks(unseen, step_s)
        anew = np.array(halves.unseen_begins, dtype=np.int64)
        anew = anew[marks[anew] == Restart.GO_ON]
        marks[anew] = Restart.NEW_CYCLE
        run = run_model(model, model.initial_state(), force.coefficients, unseen, marks)
        fit = fit_percent(unseen.position[unseen.valid], run.simulated[unseen.valid])
        simulated = (run.simulated - answer.offset) / answer.scale
    return Trial(model.name, dict(options), fit, str(reason), command, answer, simulated)


def _frames(
    model: ValveModel, command: FloatArray, answer: FloatArray, first: int, step_s: float
) -> Frames:
    sides = (command,) if len(model.inputs) == 1 else (command.clip(min=0), (-command).clip(min=0))
    inputs = np.column_stack(sides)
    n = len(answer)
    nothing = np.full(n, np.nan)
    stamps = np.rint((first + np.arange(n)) * step_s * 1e9).astype(np.int64)
    valid = np.isfinite(answer) & np.isfinite(command)
    return Frames(stamps, answer, inputs, nothing, nothing, valid)
