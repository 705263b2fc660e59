# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Propose a commented configuration for an unknown bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.survey import Proposal, Signal, propose
from valve_twin.core.types import CycleRule
from valve_twin.io.bags import bag_info, bag_types, read_signals
from valve_twin.io.errors import BagError, ConfigError, suggest
from valve_twin.io.mapping import SignalSource

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from valve_twin.io.bags import TopicInfo
    from valve_twin.io.mapping import TypeSystem

MAX_ELEMENTS = 8
"""How many elements of an array without a fixed size are tried."""

_MAX_DEPTH = 4
_SKIPPED = tuple(
    ["std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"]
)
_NUMBERS = frozenset(
    ["float32", "float64", "float", "double"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)


def propose_yaml(bag: str | Path, *, position: str = "") -> str:
    """Return a YAML proposal for a bag.

    Parameters
    ----------
    bag : path
        Folder, metadata.yaml or .mcap file.
    position : str
        TOPIC:FIELD of the position where it is known.

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
    signals = _read(bag, sources)
    proposal = propose(signals, position=position)
    if proposal is None:
        names = ", ".join(sources) or "none"
        msg = (
            f"{bag}: no command that moves a position was found among its numeric fields "
            f"({names}); give --position, or write the configuration by hand"
        )
        raise BagError(msg)
    return _text(bag, proposal, sources)


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


def _read(bag: str | Path, sources: dict[str, SignalSource]) -> dict[str, Signal]:
    stamps: dict[str, list[np.ndarray]] = {k: [] for k in sources}
    values: dict[str, list[np.ndarray]] = {k: [] for k in sources}
    for block in read_signals(bag, sources.values()):
        stamps[block.signal].append(block.stamp_ns)
        values[block.signal].append(block.values)
    signals = {}
    for name in sources:
        if stamps[name]:
            t, v = np.concatenate(stamps[name]), np.concatenate(values[name])
            rising = np.concatenate(([True], t[1:] > np.maximum.accumulate(t)[:-1]))
            signals[name] = Signal(name, t[rising], v[rising])
    return signals


def _text(bag: str | Path, proposal: Proposal, sources: dict[str, SignalSource]) -> str:
    lines = [
        f"# Proposed from {bag}: every value is a guess with its reason; check each before use.",
        "/**:",
        "  ros__parameters:",
        f"    model: {proposal.model}",
        f"    period_s: {_number(proposal.period_s)}   # median step of the position's stamps [s]",
        f"    # command to position lag: {proposal.lag} samples; every cycle is scanned for it anew",
        "    signals:",
    ]
    for role in proposal.roles:
        source = sources[role.source]
        lines += [
            f"      {role.signal}:   # {role.evidence}",
            f"        topic: {source.topic}",
            f"        type: {source.type}",
            f'        field: "{source.field}"',
            f"        scale: {_number(role.scale)}",
            f"        offset: {_number(role.offset)}   # signal = field * scale + offset, 0..1",
        ]
    if proposal.rule is CycleRule.REFERENCE:
        command = next(r for r in proposal.roles if r.signal == "command")
        source = sources[command.source]
        lines += [
            "      reference:   # the command itself cuts the cycles",
            f"        topic: {source.topic}",
            f"        type: {source.type}",
            f'        field: "{source.field}"',
            f"        scale: {_number(command.scale)}",
            f"        offset: {_number(command.offset)}",
        ]
    lines += ["    cycles:", f"      rule: {proposal.rule.value}   # {proposal.rule_reason}"]
    lines += _rule_lines(proposal)
    return "\n".join(lines) + "\n"


def _rule_lines(proposal: Proposal) -> list[str]:
    shortest = _number(max(0.3 * proposal.cycle_s, 2 * proposal.period_s))
    if proposal.rule is CycleRule.COMMANDS:
        return [
            "      start_signal: v_in     # its rise opens a cycle",
            "      rearm_signal: v_out    # once the position has been driven back",
            f"      min_cycle_s: {shortest}",
        ]
    if proposal.rule is CycleRule.REFERENCE:
        return [
            "      reference_level: 0.5   # of full scale",
            f"      min_cycle_s: {shortest}",
        ]
    if proposal.rule is CycleRule.WINDOW:
        return [f"      window_s: {_number(proposal.cycle_s)}"]
    return []


def _number(value: float) -> str:
    text = f"{value:.9g}"
    return text if any(c in text for c in ".en") else f"{text}.0"
