# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Guess what the signals of an unknown record are, and how its cycles could be cut.

A proposal for a person to check, not a verdict: every guess carries the figure it rests on. Two
one-sided commands that drive the rate of a position both ways make a cartridge valve; a command
that a position follows makes a positioner. The correlations are in `survey_pairs`, the cycle rules
in `survey_cycles`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.gaps import GAP_PERIODS
from valve_twin.core.survey.cycles import CyclePlan, plan_cycles
from valve_twin.core.survey.pairs import (
    Driven,
    Followed,
    Signal,
    Views,
    find_driven,
    find_followed,
)
from valve_twin.core.valves.registry import get_model, model_names

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from valve_twin.core.types import FloatArray
    from valve_twin.core.valves.interface import ValveModel

MIN_SAMPLES = 50
"""Fewest samples of a signal that can be judged [1]."""

_MIN_FINITE = 0.9  # share of finite numbers that a signal needs
_PERCENT = (20.0, 110.0)  # a largest value in here is taken for percent
_NORMALISED = 1.5  # a largest value up to here is taken as it is
_UPPER_HALF = 0.5  # a position that stays above and reaches 1 may count from the other end
_NEGATIVE = 0.1  # a position that rises no higher than this share of its depth is inverted
_SMALL_OFFSET = 0.005  # an offset below this share of full scale is not worth proposing
_REST_BINS = 12  # over a quarter of the range: about 2 % of it each
_DELAY_MARGIN = 4  # samples that the delay scan may reach beyond twice the lag found


@dataclass(frozen=True, slots=True)
class Role:
    """What one signal seems to be.

    Attributes
    ----------
    signal : str
        Signal of the model, e.g. "v_in".
    source : str
        Name of the column.
    scale, offset : float
        Proposed mapping to 0..1: value * scale + offset.
    evidence : str
        The figure it rests on.
    """

    signal: str
    source: str
    scale: float
    offset: float
    evidence: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """A configuration to check.

    Attributes
    ----------
    model : str
        Name of the valve model.
    roles : tuple of Role
        Which column is which signal.
    period_s : float
        Sampling time of the position [s].
    period_evidence : str
        How regular it is.
    lag : int
        Command to position [samples of the position].
    correlation : float
        Of commands and position, the lesser of two [1].
    max_delay_s : float
        Longest delay worth trying [s].
    cycles : CyclePlan
        How the stream could be cut.
    left_out : tuple of str
        Columns that got no role.
    """

    model: str
    roles: tuple[Role, ...]
    period_s: float
    period_evidence: str
    lag: int
    correlation: float
    max_delay_s: float
    cycles: CyclePlan
    left_out: tuple[str, ...]


def propose(signals: Mapping[str, Signal], *, position: str = "") -> Proposal | None:
    """Propose a configuration for an unknown record.

    Parameters
    ----------
    signals : mapping
        Numeric columns by name.
    position : str
        Name of the position column where it is known.

    Returns
    -------
    Proposal or None
        None where no command moves a position.
    """
    usable = {k: s for k, v in signals.items() if (s := _cleaned(v)) is not None}
    counters = [k for k, s in usable.items() if _is_counter(s.values)]
    names = sorted(usable, key=lambda k: k != position)  # the one that is named comes first
    movers = {k: usable[k] for k in names if not _only_rises(usable[k].values)}
    views = Views(movers)
    targets = [position] if position else list(movers)
    found = find_driven(views, targets) or find_followed(views, targets)
    model = _model_for("driven" if isinstance(found, Driven) else "followed")
    if isinstance(found, Driven):
        roles = _driven_roles(model, movers, found)
    elif found is not None:
        roles = _roles(model, movers, found)
    else:
        mirrored = _find_inverted(model, movers, targets)
        if mirrored is None:
            return None
        found, roles = mirrored
    if counters:
        roles.append(Role("cycle_counter", counters[0], 1.0, 0.0, "whole numbers that count up"))
    period_s, evidence = _period(movers[found.position])
    taken = {r.source for r in roles}
    return Proposal(
        model=model.name,
        roles=tuple(roles),
        period_s=period_s,
        period_evidence=evidence,
        lag=found.lag,
        correlation=min(found.rising, -found.falling)
        if isinstance(found, Driven)
        else found.correlation,
        max_delay_s=(2 * found.lag + _DELAY_MARGIN) * period_s,
        cycles=plan_cycles(
            [_mapped(movers[r.source], r) for r in roles if r.source in movers][1:],
            period_s,
            has_counter=bool(counters),
        ),
        left_out=tuple(k for k in signals if k not in taken),
    )


def _model_for(kind: str) -> ValveModel:
    """Return the valve that is proposed for a kind of record."""
    return next(m for m in map(get_model, model_names()) if m.proposed_for == kind)


def _cleaned(signal: Signal) -> Signal | None:
    """Drop what is no number; None where too little is left or nothing changes."""
    finite = np.isfinite(signal.values)
    n = int(np.count_nonzero(finite))
    if n < MIN_SAMPLES or n < _MIN_FINITE * len(finite):
        return None
    values = signal.values[finite]
    if float(np.ptp(values)) == 0.0:
        return None
    return Signal(signal.name, signal.stamp_ns[finite], values)


def _only_rises(values: FloatArray) -> bool:
    return bool(np.all(np.diff(values) >= 0))


def _is_counter(values: FloatArray) -> bool:
    """Whether it counts cycles: whole numbers that rise twice at least, but not every sample."""
    rises = int(np.count_nonzero(np.diff(values)))
    whole = bool(np.all(values == np.rint(values)))
    return whole and _only_rises(values) and 2 <= rises <= len(values) // 8


def _period(position: Signal) -> tuple[float, str]:
    """Return the sampling time [s] and how regular it is."""
    steps = np.diff(position.stamp_ns) / 1e9
    period_s = float(np.median(steps))
    regular = float(np.mean(np.abs(steps - period_s) < 0.1 * period_s))
    gaps = int(np.count_nonzero(steps > GAP_PERIODS * period_s))
    return period_s, f"median step; {100 * regular:.4g} % lie within a tenth of it, {gaps} gaps"


def _driven_roles(model: ValveModel, signals: Mapping[str, Signal], found: Driven) -> list[Role]:
    """Propose position and commands: the first input opens, the second closes."""
    opening, closing = model.inputs
    up = f"the position rises with it (correlation with its rate {found.rising:.2f})"
    down = f"the position falls with it (correlation with its rate {found.falling:.2f})"
    position = signals[found.position]
    if _negative(position.values):
        mirror = replace(position, values=-position.values)
        role = _position_role(model.output, mirror)
        seen = f"values {position.values.min():.4g} .. {position.values.max():.4g}; inverted"
        return [
            replace(role, scale=-role.scale, evidence=f"{seen}: they are negative"),
            _command_role(opening, signals[found.down], down),
            _command_role(closing, signals[found.up], up),
        ]
    return [
        _position_role(model.output, signals[found.position]),
        _command_role(opening, signals[found.up], up),
        _command_role(closing, signals[found.down], down),
    ]


def _find_inverted(
    model: ValveModel, signals: Mapping[str, Signal], targets: Sequence[str]
) -> tuple[Followed, list[Role]] | None:
    """Find a position that falls as its command rises: its mirror image follows the command."""
    best: tuple[Followed, dict[str, Signal]] | None = None
    for target in targets:
        if target not in signals:
            continue
        column = signals[target]
        ends = float(column.values.min() + column.values.max())
        mirror = (0.0 if _negative(column.values) else ends) - column.values
        table = {**signals, target: replace(column, values=mirror)}
        found = find_followed(Views(table), [target])
        if found is not None and (best is None or found.correlation > best[0].correlation):
            best = found, table
    if best is None:
        return None
    found, table = best
    position, command = _roles(model, table, found)
    column, given = signals[found.position], signals[found.command]
    total = float(column.values[0] + table[found.position].values[0])
    if found.gain == 1.0:  # both count in one unit: at rest they add up to the other end of it
        at = np.searchsorted(given.stamp_ns, column.stamp_ns, side="right") - 1
        total = float(np.median(column.values + given.values[np.maximum(at, 0)]))
    seen = f"values {column.values.min():.4g} .. {column.values.max():.4g}"
    inverted = replace(
        position,
        scale=-position.scale,
        offset=_offset(total * position.scale),
        evidence=f"{seen}; inverted: it falls as the command rises",
    )
    return found, [inverted, command]


def _position_role(signal: str, column: Signal) -> Role:
    """Propose a position that is 0 where it rests at the bottom."""
    scale = _scale(column.values)
    rest = _rest(column.values)
    low, high = float(column.values.min()) * scale, float(column.values.max()) * scale
    seen = f"values {column.values.min():.4g} .. {column.values.max():.4g}, rests at {rest:.4g}"
    if low > _UPPER_HALF and abs(high - 1.0) < 0.1 * (high - low):
        seen += (
            f"; if it counts from the other end: scale {-scale:g}, offset 1.0, commands swapped"
        )
    return Role(signal, column.name, scale, _offset(-rest * scale), seen)


def _command_role(signal: str, column: Signal, evidence: str) -> Role:
    """Propose a command that is 0 at rest."""
    scale = _scale(column.values)
    rest = _rest(column.values)
    text = f"{evidence}; at rest {rest:.4g}, at most {column.values.max():.4g}"
    return Role(signal, column.name, scale, _offset(-rest * scale), text)


def _roles(model: ValveModel, signals: Mapping[str, Signal], found: Followed) -> list[Role]:
    """Propose position and command of a positioner, both in the same scale."""
    column = signals[found.position].values
    scale = _scale(column)
    seen = f"values {column.min():.4g} .. {column.max():.4g}"
    follows = (
        f"the position follows it after {found.lag} samples "
        f"(correlation of the increments {found.correlation:.2f})"
    )
    gain, level = found.gain * scale, _offset(found.level * scale)
    if found.gain != 1.0:
        follows += "; scale and offset from a line through both"
    return [
        Role(model.output, found.position, scale, 0.0, seen),
        Role(model.inputs[0], found.command, gain, level, follows),
    ]


def _negative(values: FloatArray) -> bool:
    """Whether a position lies below 0 but for its noise."""
    return float(values.max()) < _NEGATIVE * -float(values.min())


def _scale(values: FloatArray) -> float:
    """Return 1 for normalised values, 0.01 for percent, else one over the largest value."""
    largest = float(np.abs(values).max())
    if largest <= _NORMALISED:
        return 1.0
    return 0.01 if _PERCENT[0] < largest <= _PERCENT[1] else 1.0 / largest


def _rest(values: FloatArray) -> float:
    """Return the value that is taken most often in the lowest quarter of the range."""
    low, span = float(values.min()), float(np.ptp(values))
    counts, edges = np.histogram(values, bins=_REST_BINS, range=(low, low + 0.25 * span))
    most, width = int(np.argmax(counts)), float(edges[1] - edges[0])
    centre = 0.5 * float(edges[most] + edges[most + 1])
    return float(np.median(values[np.abs(values - centre) <= width]))


def _offset(value: float) -> float:
    return value if abs(value) >= _SMALL_OFFSET else 0.0


def _mapped(signal: Signal, role: Role) -> Signal:
    return Signal(role.signal, signal.stamp_ns, signal.values * role.scale + role.offset)
