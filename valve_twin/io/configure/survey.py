# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Look at the channels of files: which one is what, which model follows, how cycles are cut."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import suggest
from valve_twin.core.survey.choose import Halves, Pair, choose_pairs, find_integrated, halve
from valve_twin.core.survey.cycles import CyclePlan, plan_cycles, switched_cycles
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.record import MIN_SAMPLES, Proposal, propose
from valve_twin.core.survey.repeats import Repeat, find_repeat
from valve_twin.core.survey.trial import Mapping01, Trial, try_models
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.registry import get_model
from valve_twin.io.errors import BagError, ConfigError
from valve_twin.io.instruments.read import read_recording
from valve_twin.io.instruments.units import known_unit, roles_of, split_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from valve_twin.core.types import FloatArray
    from valve_twin.io.instruments.clock import ClockChoice
    from valve_twin.io.instruments.table import Recording

MOST_FILES = 8
"""Files that are looked at; the import reads all."""

GAP_S = 5.0
"""Pause between two files, at least [s]."""

_GAP_PERIODS = 10.0
_PERCENT = (20.0, 110.0)
_WINDOW_S = 300.0  # usual length of a window, assumed
_WINDOWS = 3  # at least, where each still has enough samples
_IN_WINDOW = 400  # samples that a window has at least, assumed
_ACTIVE = 0.1  # share of the command's range that is no rest
_SURE = 60.0  # ARX fit of one command beside which two nameless ones are not looked for [%]
_POOR = 30.0  # free-run fit below which the next pair is tried, too [%]
_SLACK = 0.3  # of the answer's range that a command of the same unit may lie outside it


@dataclass(frozen=True, slots=True)
class Survey:
    """What was found in the files.

    Attributes
    ----------
    recordings : list of Recording
        Those that could be read.
    refused : list of str
        Why the others are left out, one line each.
    signals : dict
        Channels that change, all files after each other, by name.
    roles : dict
        What each channel may be, the most likely first.
    still : dict
        Channels that never change, and where they stay.
    sizes : dict
        What 1 of a channel is in SI, 1 where its unit is not known.
    period_s, jitter : float
        Usual step of the answer [s] and the share of steps off it by a tenth [1].
    gap_s : float
        Pause between files [s].
    """

    recordings: list[Recording]
    refused: list[str]
    signals: dict[str, Signal]
    roles: dict[str, tuple[str, ...]]
    still: dict[str, float]
    sizes: dict[str, float]
    period_s: float = 0.0
    jitter: float = 0.0
    gap_s: float = GAP_S


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
    """

    plan: CyclePlan
    pair: Pair | None = None
    trials: list[Trial] = field(default_factory=list)
    halves: Halves | None = None
    driven: Proposal | None = None
    repeat: Repeat | None = None
    others: list[Pair] = field(default_factory=list)
    copies: dict[str, str] = field(default_factory=dict)


def look(paths: Sequence[Path], choice: ClockChoice) -> Survey:
    """Read files and put them after each other.

    Parameters
    ----------
    paths : sequence of path
        The first eight are read. One that cannot be read is left out.
    choice : ClockChoice
        What is known of the time.

    Raises
    ------
    BagError
        If none can be read.
    """
    recordings, refused = [], []
    for path in paths[:MOST_FILES]:
        try:
            recordings.append(read_recording(path, choice))
        except BagError as err:
            refused.append(str(err))
    if not recordings:
        raise BagError(refused[0])
    names = [c.name for c in recordings[0].columns]
    alike = []
    for recording in recordings:
        missing = set(names) - {c.name for c in recording.columns}
        if missing:
            refused.append(f"{recording.path}: has no channel '{min(missing)}' as the first file")
        else:
            alike.append(recording)
    steps = [np.diff(c.seconds) for r in alike for c in r.columns if len(c.seconds) > 1]
    usual = float(np.median(np.concatenate(steps))) if steps else 1.0
    gap_s = max(GAP_S, _GAP_PERIODS * usual)
    signals, still = _joined(alike, gap_s)
    units = {c.name: c.unit for c in alike[0].columns}
    roles = {k: roles_of(*_parts(k, units[k])) for k in signals}
    known = {k: known_unit(_parts(k, units[k])[1]) for k in signals}
    sizes = {k: unit.size if unit else 1.0 for k, unit in known.items()}
    return Survey(alike, refused, signals, roles, still, sizes, gap_s=gap_s)


def _parts(name: str, unit: str) -> tuple[str, str]:
    plain, own = split_name(name)
    return plain, unit or own


def _joined(
    recordings: Sequence[Recording], gap_s: float
) -> tuple[dict[str, Signal], dict[str, float]]:
    signals: dict[str, Signal] = {}
    still: dict[str, float] = {}
    starts, at = [], 0.0
    for recording in recordings:
        starts.append(at)
        at += max(float(c.seconds[-1]) for c in recording.columns) + gap_s
    for column in recordings[0].columns:
        own = [next(c for c in r.columns if c.name == column.name) for r in recordings]
        seconds = np.concatenate([s + c.seconds for s, c in zip(starts, own, strict=True)])
        values = np.concatenate([c.values for c in own])
        known = np.isfinite(values)
        if np.count_nonzero(known) < MIN_SAMPLES:
            continue
        values = values[known]
        if float(np.ptp(values)) == 0.0:
            still[column.name] = float(values[0])
            continue
        stamps = np.rint(seconds[known] * 1e9).astype(np.int64)
        signals[column.name] = Signal(column.name, stamps, values)
    return signals, still


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
    pairs, copies = choose_pairs(signals, roles, position=position)
    driven = _driven(survey, pairs, position)
    if driven is not None:
        answer = driven.roles[0].source
        return _timed(survey, answer), Choice(driven.cycles, driven=driven, copies=copies)
    if not pairs:
        summed = find_integrated(signals, roles, position=position)
        pairs = [summed] if summed is not None else []
    if pairs:
        return _followed(survey, pairs, copies)
    free = {
        k: s for k, s in signals.items() if k not in copies and "command" not in roles.get(k, ())
    }
    repeat = find_repeat(free, roles, survey.sizes, position=position)
    if repeat is None:
        msg = f"{_first(survey)}: {_nothing(survey, copies)}"
        raise BagError(msg)
    return _timed(survey, repeat.channel), Choice(repeat.plan, repeat=repeat, copies=copies)


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


def _followed(survey: Survey, pairs: list[Pair], copies: dict[str, str]) -> tuple[Survey, Choice]:
    best: tuple[Survey, Choice] | None = None
    for pair in pairs:
        timed = _timed(survey, pair.answer)
        halves = halve(survey.signals, pair.command, pair.answer)
        maps = _maps(survey, pair)
        kind = (list(survey.roles.get(pair.answer, ())) or [""])[0]
        falls = pair.correlation < 0.0
        trials = try_models(halves, timed.period_s, pair.lag, falls=falls, kind=kind, maps=maps)
        first = survey.signals[pair.command]
        mapped = Signal("command", first.stamp_ns, trials[0].command.of(first.values))
        plan = _even(plan_cycles([mapped], timed.period_s, has_counter=False), timed, mapped)
        others = [p for p in pairs if p is not pair]
        found = timed, Choice(plan, pair, trials, halves, others=others, copies=copies)
        if best is None or trials[0].fit > max(best[1].trials[0].fit, _POOR):
            best = found
        if trials[0].fit >= _POOR:
            break
    assert best is not None  # there is a pair
    return best


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
    level = float(command.values.min()) + _ACTIVE * float(np.ptp(command.values))
    active = command.values > level
    if np.count_nonzero(np.diff(active.astype(np.int8)) > 0) < 2 and not active[0]:
        count = 1  # one stroke
    window_s = whole_s / max(count, 1)
    values: dict[str, float | str] = {"window_s": window_s}
    first_ns = survey.recordings[0].start_ns
    if first_ns is not None:
        values["window_offset_s"] = (first_ns * 1e-9) % window_s
    return replace(plan, values=values)


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


def unit_of(survey: Survey, name: str) -> str:
    """Return the unit of a channel as it stands in the file, in small letters."""
    column = next(c for c in survey.recordings[0].columns if c.name == name)
    return _parts(name, column.unit)[1].lower()


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
