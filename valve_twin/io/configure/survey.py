# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Look at the channels of files: which one is what, which model follows, how cycles are cut."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.core.survey.choose import Halves, Pair, choose_pairs, find_integrated, halve
from valve_twin.core.survey.cycles import (
    CyclePlan,
    plan_cycles,
    short_windows,
    strokes_from_rest,
    switched_cycles,
)
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.record import Proposal, propose
from valve_twin.core.survey.repeats import Repeat, find_repeat
from valve_twin.core.survey.sides import compare_sides, roles_of_sides
from valve_twin.core.survey.trial import Mapping01, Trial, try_baseline, try_models
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.configure.channels import Survey, add_channels, unit_of
from valve_twin.io.configure.made import better_difference, split_command
from valve_twin.io.configure.switches import find_switches
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.instruments.derived import difference, is_reported
from valve_twin.io.instruments.units import known_unit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray

_PERCENT = (20.0, 110.0)
_WINDOW_S = 300.0  # usual length of a window, assumed
_WINDOWS = 3  # at least, where each still has enough samples
_IN_WINDOW = 400  # samples that a window has at least, assumed
_ACTIVE = 0.1  # share of the command's range that is no rest
_SURE = 60.0  # ARX fit of one command beside which two nameless ones are not looked for [%]
_POOR = 30.0  # free-run fit below which the next pair is tried, too [%]
_QUICK = 0.15  # quantile of the steps between reports that one grid keeps, assumed
_ROWS = 10  # rows of that grid a report, before its step is rounded down, assumed
_SLACK = 0.3  # of the answer's range that a command of the same unit may lie outside it


@dataclass(frozen=True, slots=True)
class Choice:
    """What is proposed.

    Attributes
    ----------
    pair : Pair, optional
        Command and answer; None = no command, or two that drive a position.
    trials : list of Trial
        Models tried, the best first.
    halves : Halves, optional
        What they were tried on.
    plan : CyclePlan
        How cycles are cut.
    driven : Proposal, optional
        Two one-sided commands that drive a position.
    repeat : Repeat, optional
        A channel that repeats without a command.
    others : list of Pair
        Pairs that came close.
    copies : dict
        Why answers were refused, by channel.
    baseline : Trial, optional
        A black box on the same halves.
    """

    plan: CyclePlan
    pair: Pair | None = None
    trials: list[Trial] = field(default_factory=list)
    halves: Halves | None = None
    driven: Proposal | None = None
    repeat: Repeat | None = None
    others: list[Pair] = field(default_factory=list)
    copies: dict[str, str] = field(default_factory=dict)
    baseline: Trial | None = None


def choose(survey: Survey, *, position: str = "") -> tuple[Survey, Choice]:
    """Choose signals, model and cycles.

    Parameters
    ----------
    survey : Survey
        Channels.
    position : str
        The channel that answers, where it is known.

    Returns
    -------
    Survey
        With the period of the answer.
    Choice
        What is proposed.

    Raises
    ------
    ConfigError
        If the position is no channel that changes.
    BagError
        If nothing answers a command and nothing repeats.
    """
    signals, roles = survey.signals, survey.roles
    if position and position not in signals:
        msg = f"{_first(survey)}: --position '{position}': {suggest(position, signals)}"
        raise ConfigError(msg)
    timing = None if position else find_switches(survey)
    if timing is not None:
        survey = _timed(timing[0], timing[1].channel)
        return survey, Choice(_doubted(survey, timing[1].plan), repeat=timing[1])
    pairs, copies = choose_pairs(signals, roles, position=position)
    driven = _driven(survey, pairs, position)
    if driven is not None:
        _, up, down = roles_of_sides(driven)
        whole = difference(up.source, down.source)
        added = add_channels(survey, {whole: up.source}, ("command",))
        return _driven_or_not(added, driven, whole, copies)
    split = split_command(survey, pairs[0]) if pairs and pairs[0].named else None
    if split is not None:
        return _driven_or_not(*split, pairs[0].command, copies)
    unsure = not (pairs and (pairs[0].named or pairs[0].arx > _SURE))
    if unsure:
        own = {k: s for k, s in signals.items() if k not in copies}
        summed = find_integrated(own, roles, position=position, nameless=True)
        pairs = [summed, *pairs] if summed is not None else pairs
    if not position:
        survey, pairs = better_difference(survey, pairs, copies)
    if pairs:
        return _followed(survey, pairs, copies)
    free = {
        k: s for k, s in signals.items() if k not in copies and "command" not in roles.get(k, ())
    }
    repeat = find_repeat(free, roles, survey.sizes, position=position)
    if repeat is None:
        msg = f"{_first(survey)}: {_nothing(survey, copies)}"
        raise BagError(msg)
    survey = _timed(survey, repeat.channel)
    if all(r.start_ns is None for r in survey.recordings):  # windows cut on from file to file
        survey = replace(survey, gap_s=survey.period_s)
    return survey, Choice(_doubted(survey, repeat.plan), repeat=repeat, copies=copies)


def even_step(survey: Survey, choice: Choice) -> float:
    """Return the step of one grid for channels stored when they change, 0 = they are not.

    Parameters
    ----------
    survey : Survey
        Channels.
    choice : Choice
        Which of them are command and answer.
    """
    if choice.pair is None or not survey.recordings[0].measured:
        return 0.0
    pair = [survey.signals[k] for k in (choice.pair.command, choice.pair.answer)]
    own = [np.asarray(s.stamp_ns * 1e-9, np.float64) for s in pair]
    if not all(is_reported(seconds) for seconds in own):
        return 0.0
    quick = min(float(np.quantile(np.diff(seconds), _QUICK)) for seconds in own)
    most = _ROWS * max(map(len, own))
    quick = max(quick, max(float(np.ptp(seconds)) for seconds in own) / most)
    size = 10.0 ** np.floor(np.log10(quick))
    return float(size * max(n for n in (1.0, 2.0, 5.0) if n * size <= quick * (1.0 + 1e-9)))


def _doubted(survey: Survey, plan: CyclePlan) -> CyclePlan:
    """Return a plan that says so where its seconds are invented."""
    first = survey.recordings[0]
    if first.measured or survey.clock.period_s:
        return plan
    return replace(plan, reason=f"{plan.reason}; NOT MEASURED: {first.clock}")


def _nothing(survey: Survey, copies: Mapping[str, str]) -> str:
    """Say why nothing can be proposed and what would help."""
    names = ", ".join(list(survey.signals)[:6]) or "none changes"
    still = ", ".join(f"{k} stays at {v:.4g}" for k, v in list(survey.still.items())[:6])
    told = "; ".join(filter(None, [names, still, *list(copies.values())[:1]]))
    return (
        f"no channel answers another and none repeats ({told}); give --position, or record a "
        "longer part"
    )


def _first(survey: Survey) -> Path:
    return survey.recordings[0].path


def _timed(survey: Survey, answer: str) -> Survey:
    steps = np.diff(survey.signals[answer].stamp_ns) * 1e-9
    period_s = float(np.median(steps))
    off = float(np.mean(np.abs(steps - period_s) > 0.1 * period_s))
    return replace(survey, period_s=period_s, jitter=off)


def _driven(survey: Survey, pairs: Sequence[Pair], position: str) -> Proposal | None:
    """Return two commands that drive a position, where names do not speak against it."""
    roles = survey.roles
    proposal = propose(survey.signals, position=position)
    if proposal is None or get_model(proposal.model).proposed_for != "driven":
        return None
    answer, *commands = (r.source for r in proposal.roles if r.signal != "cycle_counter")
    said = [bool(roles.get(c)) and "command" in roles[c] for c in commands]
    unsaid = [not roles.get(c) for c in commands]
    if all(said) or (all(unsaid) and not (pairs and pairs[0].arx > _SURE)):
        return proposal if not roles.get(answer) or "position" in roles[answer] else None
    return None


def _driven_or_not(
    survey: Survey, driven: Proposal, whole: str, copies: dict[str, str]
) -> tuple[Survey, Choice]:
    """Return two commands that drive a position, or `whole` where one follows it better."""
    answer, *sides = roles_of_sides(driven)
    survey = _timed(survey, answer.source)
    plain = Choice(_doubted(survey, driven.cycles), driven=driven, copies=copies)
    found = compare_sides(
        survey.signals,
        driven,
        survey.signals[whole],
        partial(_maps, survey),
        period_s=survey.period_s,
        kind=(list(survey.roles.get(answer.source, ())) or [""])[0],
        named=all("command" in survey.roles.get(r.source, ()) for r in sides),
    )
    if found is None:
        return survey, plain
    tried = replace(
        plain,
        pair=found.pair,
        trials=found.trials,
        halves=found.halves,
        baseline=found.baseline,
    )
    if found.two:
        return survey, tried
    plan = _doubted(survey, _cut(survey, found.pair, found.trials[0]))
    return survey, replace(tried, driven=None, plan=plan)


def _followed(survey: Survey, pairs: list[Pair], copies: dict[str, str]) -> tuple[Survey, Choice]:
    best: tuple[Survey, Choice] | None = None
    for pair in pairs:
        timed = _timed(survey, pair.answer)
        halves = halve(survey.signals, pair.command, pair.answer)
        maps = _maps(survey, pair)
        kind = (list(survey.roles.get(pair.answer, ())) or [""])[0]
        falls = pair.correlation < 0.0
        trials = try_models(halves, timed.period_s, pair.lag, falls=falls, kind=kind, maps=maps)
        baseline = try_baseline(halves, timed.period_s, pair.lag, maps=maps)
        if baseline is not None and not trials[0].fit > 0.0 and baseline.fit > 0.0:
            trials = [baseline, *trials]
        plan = _doubted(survey, _cut(timed, pair, trials[0]))
        others = [p for p in pairs if p is not pair]
        made = Choice(plan, pair, trials, halves, others=others, copies=copies)
        found = timed, replace(made, baseline=baseline)
        if best is None or trials[0].fit > max(best[1].trials[0].fit, _POOR):
            best = found
        if trials[0].fit >= _POOR:
            break
    assert best is not None  # there is a pair
    return best


def _cut(survey: Survey, pair: Pair, trial: Trial) -> CyclePlan:
    """Return how cycles of a command and its answer are cut, both as the model sees them."""
    first, last = survey.signals[pair.command], survey.signals[pair.answer]
    command = Signal("command", first.stamp_ns, trial.command.of(first.values))
    if get_model(trial.model).proposed_for == "integrated":
        answer = Signal("answer", last.stamp_ns, trial.answer.of(last.values))
        strokes = strokes_from_rest(command, answer)
        if strokes is not None:
            return strokes
    return _even(plan_cycles([command], survey.period_s, has_counter=False), survey, command)


def _even(plan: CyclePlan, survey: Survey, command: Signal) -> CyclePlan:
    """Divide a record without strokes into windows of one length, none cut off at its end."""
    if plan.rule is not CycleRule.WINDOW:
        return plan
    switched = switched_cycles(command, survey.period_s)
    if switched is not None:
        return switched
    stamps = command.stamp_ns
    whole_s = float(stamps[-1] - stamps[0]) * 1e-9 + survey.period_s
    count = max(round(whole_s / _WINDOW_S), _WINDOWS)
    count = min(count, int(whole_s / survey.period_s) // _IN_WINDOW)
    count = max(count, short_windows(command, whole_s, survey.period_s))
    level = float(command.values.min()) + _ACTIVE * float(np.ptp(command.values))
    active = command.values > level
    if np.count_nonzero(np.diff(active.astype(np.int8)) > 0) < 2 and not active[0]:
        count = 1  # one stroke
    window_s = whole_s / max(count, 1)
    values: dict[str, float | str] = {"window_s": window_s}
    first_ns = survey.recordings[0].start_ns
    if first_ns is not None:
        values["window_offset_s"] = (first_ns * 1e-9) % window_s
    return replace(plan, values=values, count=max(count, 1))


def _maps(survey: Survey, pair: Pair) -> tuple[Mapping01, Mapping01]:
    """Return the maps of command and answer to 0..1, both alike where they share a unit."""
    u, y = survey.signals[pair.command].values, survey.signals[pair.answer].values
    units = [unit_of(survey, name) for name in (pair.command, pair.answer)]
    alike = units[0] == units[1] and _overlap(u, y) and pair.correlation > 0.0
    answer = _share(np.concatenate((u, y)) if alike else y, units[1])
    if pair.correlation < 0.0:
        answer = Mapping01(-answer.scale, 1.0 - answer.offset)
    if alike:
        return answer, answer
    return _share(u, units[0]), answer


def _overlap(u: FloatArray, y: FloatArray) -> bool:
    span = float(np.ptp(y))
    inside = u.min() >= y.min() - _SLACK * span and u.max() <= y.max() + _SLACK * span
    return bool(inside and np.ptp(u) > _SLACK * span)


def _share(values: FloatArray, unit: str) -> Mapping01:
    """Return percent as parts, parts as they are, anything else from its own range."""
    known = known_unit(unit)
    low, high = float(values.min()), float(values.max())
    percent = known is not None and known.quantity == "share"
    if percent and _PERCENT[0] < high <= _PERCENT[1] and low > -0.1 * high:
        return Mapping01(0.01, 0.0)
    if known is None and low >= -0.1 and 0.5 <= high <= 1.1:
        return Mapping01(1.0, 0.0)
    scale = float(f"{1.0 / (high - low):.6g}")
    return Mapping01(scale, float(f"{-low * scale:.6g}"))
