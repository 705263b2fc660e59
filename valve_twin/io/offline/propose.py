# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Propose a commented configuration for an unknown bag."""

from __future__ import annotations

from dataclasses import replace
from math import copysign, nan
from textwrap import shorten
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.diagnosis.features import ESTIMATOR as FEATURES
from valve_twin.core.quantity import describe, listed, suggest
from valve_twin.core.survey.choose import Pair, halve, with_baselines
from valve_twin.core.survey.pairs import Signal
from valve_twin.core.survey.record import Proposal, Role, propose
from valve_twin.core.survey.sides import compare_sides, difference_of
from valve_twin.core.survey.trial import Mapping01, try_baseline, try_models
from valve_twin.core.types import CycleRule
from valve_twin.core.valves.interface import estimator_choices
from valve_twin.core.valves.registry import get_model
from valve_twin.io.bags.read import bag_info, bag_types, read_signals
from valve_twin.io.cdr.signals import SignalSource
from valve_twin.io.errors import BagError, ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from valve_twin.core.survey.trial import Trial
    from valve_twin.core.types import FloatArray, IntArray
    from valve_twin.io.bags.read import TopicInfo
    from valve_twin.io.cdr.message_types import TypeSystem

MAX_ELEMENTS = 8
"""How many elements of an array without a fixed size are tried."""

EXPLAINED = {
    "start_signal": "its rise opens a cycle ...",
    "rearm_signal": "... if this one, the return stroke, has been above ...",
    "rearm_threshold": "... this level since the last opening [1]",
    "threshold": "command that counts as active [1]",
    "min_cycle_s": "half of the shortest cycle found [s]",
    "reference_level": "a cycle opens where the reference rises through it [1]",
    "reference_hysteresis": "it must have been this far below before [1]",
    "window_s": "length of a window [s]",
    "window_offset_s": "the first window begins with the record [s]",
}
HELD_BACK = "a silent signal delays the others by at most this"
_MOST_SAMPLES = 2_000_000  # of one column; more tells nothing new
_NAMED = 6  # fields named in a message
_MAX_DEPTH = 4
_SKIPPED = (
    "std_msgs/msg/Header",
    "builtin_interfaces/msg/Time",
    "builtin_interfaces/msg/Duration",
)
_NUMBERS = frozenset(
    ["float32", "float64", "float", "double"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


def in_short(reason: str) -> str:
    """Return a reason that fits into a line of several, cut between words."""
    return shorten(reason, 60, placeholder=" ...")


def propose_yaml(
    bag: str | Path, *, position: str = "", on_doubt: Callable[[str], object] = lambda _: None
) -> str:
    """Return a YAML proposal for a bag.

    Parameters
    ----------
    bag : path
        Folder, metadata.yaml or .mcap file.
    position : str
        TOPIC:FIELD of the position where it is known.
    on_doubt : callable
        Called with each line of the proposal that a user should read first.

    Returns
    -------
    str
        A commented configuration, to be checked by a person.

    Raises
    ------
    BagError
        If the bag cannot be read or no pair of its signals moves together.
    ConfigError
        If the position named is not in the bag.
    """
    sources = _numeric_sources(bag)
    if position and position not in sources:
        msg = f"{bag}: --position '{position}' is no numeric field; {suggest(position, sources)}"
        raise ConfigError(msg)
    signals, received = _read(bag, sources)
    proposal = propose(signals, position=position)
    if proposal is None:
        raise BagError(_nothing(bag, sources, position, _still(signals)))
    options: Mapping[str, object] = {}
    if get_model(proposal.model).proposed_for == "driven":
        told, doubts = _compared(bag, signals, proposal)
    else:
        proposal, options, told, doubts = _followed(signals, proposal)
    doubts = [f"doubt: {line}" for line in doubts]
    for line in doubts:
        on_doubt(line)
    told = [*told, *doubts]
    return _text(bag, proposal, sources, received, _still(signals), told, options)


def _compared(
    bag: str | Path, signals: Mapping[str, Signal], proposal: Proposal
) -> tuple[list[str], list[str]]:
    """Say how well models follow later cycles where two commands drive a position; and doubts."""
    whole = difference_of(signals, proposal, mapped=False)
    columns = {**signals, "difference": replace(whole, name="difference")}
    found = compare_sides(
        signals,
        proposal,
        columns["difference"],
        lambda pair: (_range01(columns[pair.command]), _range01(columns[pair.answer])),
        period_s=proposal.period_s,
        kind="position",
    )
    if found is None:
        return [], ["too few cycles to hold any model against; give a longer bag"]
    told = f"free run of each later cycle: {_fits(found.trials, found.pair, found.baseline)}"
    doubts = [found.halves.doubt] if found.halves.doubt else []
    if not found.two:
        doubts.append(
            f"{found.trials[0].model} follows the difference of both commands better (a "
            f"cylinder, a tank, a drive), which no bag holds: valve-twin convert {bag} --config "
            "FILE --out X.csv, then valve-twin configure X.csv"
        )
    return [told], doubts


def _followed(
    signals: Mapping[str, Signal], proposal: Proposal
) -> tuple[Proposal, Mapping[str, object], list[str], list[str]]:
    """Return a proposal with the model and the options that follow one command best.

    Each is fitted to the first half and runs freely over the second. With them how well they do,
    and doubts.
    """
    model = get_model(proposal.model)
    output, given = model.output, model.inputs[0]
    roles = {r.signal: r for r in proposal.roles}
    answer, command = roles[output], roles[given]
    halves = halve(signals, command.source, answer.source)
    maps = Mapping01(command.scale, command.offset), Mapping01(answer.scale, answer.offset)
    alike = copysign(proposal.correlation, answer.scale)
    pair = Pair(command.source, answer.source, proposal.lag, alike, nan, nan, named=False)
    pair, period_s = with_baselines(halves, pair), proposal.period_s
    falls = alike < 0.0
    trials = try_models(halves, period_s, pair.lag, falls=falls, kind="position", maps=maps)
    baseline = try_baseline(halves, period_s, pair.lag, maps=maps)
    told = [f"free run of the half that was not fitted: {_fits(trials, pair, baseline)}"]
    own = [t for t in trials if get_model(t.model).normalised and t.fit > 0.0]
    if not own:
        return proposal, {}, told, [f"no model follows '{answer.source}' better than its mean"]
    best, chosen = own[0], get_model(own[0].model)
    names = {output: chosen.output, given: chosen.inputs[0]}
    now = tuple(replace(r, signal=names.get(r.signal, r.signal)) for r in proposal.roles)
    peer = max((f for f in (pair.arx, pair.line) if np.isfinite(f)), default=0.0)
    doubts = [] if best.fit > peer else [f"{best.model} follows no better than its baselines"]
    return replace(proposal, model=best.model, roles=now), best.options, told, doubts


def _fits(trials: Sequence[Trial], pair: Pair, baseline: Trial | None) -> str:
    """Return how well each model ran freely, in one line with ARX, a line and a black box."""
    tried: dict[str, str] = {}
    for t in trials:
        fit = f"{t.fit:.1f} %" if np.isfinite(t.fit) else f"none ({in_short(t.reason)})"
        tried.setdefault(t.model, f"{t.model} {fit}")
    beside = {"ARX": pair.arx, "a line through the command": pair.line}
    if baseline is not None:
        beside[f"a black box ({baseline.model})"] = baseline.fit
    others = (f"{name} {fit:.1f} %" for name, fit in beside.items() if np.isfinite(fit))
    return ", ".join((*tried.values(), *others))


def _range01(signal: Signal) -> Mapping01:
    low, high = float(signal.values.min()), float(signal.values.max())
    return Mapping01(1.0 / (high - low), -low / (high - low))


def _still(signals: Mapping[str, Signal]) -> dict[str, float]:
    """Return the columns that never change, and where they stay."""
    finite = {k: s.values[np.isfinite(s.values)] for k, s in signals.items()}
    return {k: float(v[0]) for k, v in finite.items() if len(v) and float(np.ptp(v)) == 0.0}


def _nothing(
    bag: str | Path, sources: dict[str, SignalSource], position: str, still: Mapping[str, float]
) -> str:
    names = listed(list(sources), _NAMED) or "none"
    moved = f"'{position}'" if position else "a position"
    remedy = "write the configuration by hand"
    if not position and sources:
        remedy = f"give --position, or {remedy}"
    never = ", ".join(f"{k} stays at {v:.4g}" for k, v in list(still.items())[:_NAMED])
    return (
        f"{bag}: no command that moves {moved} was found among its numeric fields "
        f"({names}); {f'{never}; ' if never else ''}{remedy}"
    )


def _numeric_sources(bag: str | Path) -> dict[str, SignalSource]:
    found: dict[str, SignalSource] = {}
    for topic in bag_info(bag).topics:
        if topic.count == 0 or topic.name in {"/clock", "/rosout", "/parameter_events"}:
            continue
        try:
            types = bag_types(bag, topic.name)
        except BagError:
            continue  # a topic of another encoding has no fields to offer
        for path in _paths(types, topic.type, ""):
            name = f"{topic.name}:{path}"
            found[name] = _source(name, topic, path)
    return found


def _source(name: str, topic: TopicInfo, path: str) -> SignalSource:
    return SignalSource(signal=name, topic=topic.name, type=topic.type, field=path)


def _paths(types: TypeSystem, type_name: str, prefix: str, depth: int = 0) -> Iterator[str]:
    """Yield the paths of all numeric fields; a sequence beside a `period` is a batch."""
    try:
        fields = types.fields(type_name)
    except KeyError:
        return
    for name, kind in fields.items():
        path = f"{prefix}{name}"
        if kind.base in _NUMBERS:
            if not kind.is_array:
                if not (name == "period" and any(f.is_array for f in fields.values())):
                    yield path
            elif kind.size is None and "period" in fields:
                yield f"{path}[]"
            else:
                yield from (f"{path}[{k}]" for k in range(min(kind.size or 8, MAX_ELEMENTS)))
        elif not kind.is_array and kind.base not in _SKIPPED and depth < _MAX_DEPTH:
            yield from _paths(types, kind.base, f"{path}.", depth + 1)


def _read(bag: str | Path, sources: dict[str, SignalSource]) -> tuple[dict[str, Signal], set[str]]:
    """Return the columns of a bag, the first of a long one, and which carry receive times."""
    stamps: dict[str, list[IntArray]] = {k: [] for k in sources}
    values: dict[str, list[FloatArray]] = {k: [] for k in sources}
    counts = dict.fromkeys(sources, 0)
    received: set[str] = set()
    for block in read_signals(bag, sources.values()):
        stamps[block.signal].append(block.stamp_ns)
        values[block.signal].append(block.values)
        counts[block.signal] += len(block.values)
        if not block.has_header:
            received.add(block.signal)
        if counts[block.signal] >= _MOST_SAMPLES:
            break
    signals = {}
    for name in (k for k in sources if counts[k]):
        t, v = np.concatenate(stamps[name]), np.concatenate(values[name])
        rising = np.concatenate(([True], t[1:] > np.maximum.accumulate(t)[:-1]))
        signals[name] = Signal(name, t[rising], v[rising])
    return signals, received


def _text(
    bag: str | Path,
    proposal: Proposal,
    sources: dict[str, SignalSource],
    received: set[str],
    still: Mapping[str, float],
    told: Sequence[str],
    options: Mapping[str, object],
) -> str:
    lines = [
        f"# Proposed from {bag}: every value is a guess with its reason; check each before use.",
        f"#   valve-twin estimate {bag} --config FILE",
        "/**:",
        "  ros__parameters:",
        f"    model: {proposal.model}",
        *(f"    # {line}" for line in told),
        f"    period_s: {number_text(proposal.period_s)}   # {proposal.period_evidence} [s]",
        f"    hold_back_s: {number_text(max(2.0, 5.0 * proposal.period_s))}   # {HELD_BACK} [s]",
        f"    # lag from command to position: {proposal.lag} samples; every cycle is scanned anew",
        "    signals:",
    ]
    for role in _with_reference(proposal):
        lines += _signal_lines(role, sources[role.source], role.source in received)
    lines += [
        "    cycles:",
        f"      rule: {proposal.cycles.rule.value}   # {proposal.cycles.reason}",
    ]
    for key, value in proposal.cycles.values.items():
        text = value if isinstance(value, str) else number_text(value)
        lines.append(f"      {key}: {text}   # {EXPLAINED[key]}")
    lines += _option_lines(proposal, options)
    if proposal.left_out:
        lines += ["    # left out, because nothing shows what they are:"]
        lines += [
            f"    #   {name}" + (f" (stays at {still[name]:.4g})" if name in still else "")
            for name in proposal.left_out
        ]
    return "\n".join(lines) + "\n"


def _with_reference(proposal: Proposal) -> tuple[Role, ...]:
    """Map the command again where it cuts the cycles."""
    if proposal.cycles.rule is not CycleRule.REFERENCE:
        return proposal.roles
    (name,) = get_model(proposal.model).inputs
    command = next(r for r in proposal.roles if r.signal == name)
    return (*proposal.roles, replace(command, signal="reference", evidence="cuts the cycles"))


def _signal_lines(role: Role, source: SignalSource, received: bool) -> list[str]:
    clock = "   # it carries no stamp: the receive time stands for it" if received else ""
    return [
        f"      {role.signal}:   # {role.evidence}",
        f"        topic: {source.topic}{clock}",
        f"        type: {source.type}",
        f'        field: "{source.field}"',
        f"        scale: {number_text(role.scale)}   # signal = scale * field + offset",
        f"        offset: {number_text(role.offset)}",
    ]


def _option_lines(proposal: Proposal, given: Mapping[str, object]) -> list[str]:
    """Have faults told, and let the delay scan reach well beyond the lag that was found."""
    lines = estimator_lines(proposal.model)
    options = get_model(proposal.model).options
    upper = {d.name: d.upper for d in describe(options)}
    if "max_delay_s" in upper:
        longest = min(proposal.max_delay_s, upper["max_delay_s"])
        lines.append(f"      max_delay_s: {number_text(longest)}   # longest delay tried [s]")
    elif "max_lag" in upper and proposal.lag >= options.max_lag:  # the end of the default scan
        most = min(proposal.lag + 2, upper["max_lag"])
        lines.append(f"      max_lag: {most:.0f}   # longest lag tried [samples]")
    lines += option_lines({k: v for k, v in given.items() if k not in ("max_delay_s", "max_lag")})
    return ["    options:", *lines] if lines else []


def option_lines(given: Mapping[str, object]) -> list[str]:
    """Return the lines of options by name: switches, and numbers as floats."""
    texts = {
        k: str(v).lower() if isinstance(v, bool) else number_text(float(str(v)))
        for k, v in given.items()
    }
    return [f"      {k}: {v}" for k, v in texts.items()]


def estimator_lines(name: str) -> list[str]:
    """Return the line of a model's estimators with the one that tells faults, where it has it."""
    model = get_model(name)
    if FEATURES not in estimator_choices(model):
        return []
    names = ", ".join([*model.options.estimators, FEATURES])
    return [f"      estimators: [{names}]   # the last one tells faults, see docs/diagnosis.md"]


def number_text(value: float) -> str:
    """Write a number so that YAML reads it as a float."""
    text = f"{value + 0.0:.7g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"
