# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Guess what the signals of an unknown record are: position, commands, counter, period, lag, offsets, cycle rule.

A proposal for a person to check, not a verdict: every guess carries the figure it rests on. A position is the signal
that another one explains, either as its rate (two one-sided commands, the cartridge valve) or by being followed (one
command in the same unit, the positioner).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.types import CycleRule, FloatArray, IntArray

if TYPE_CHECKING:
    from collections.abc import Mapping

MIN_SAMPLES = 50
"""Fewest samples of a signal that can be judged."""

_MAX_LAG_S = 0.6  # longest lag that is looked for beyond _LEAST_LAGS samples [A]
_LEAST_LAGS = 16
_ENOUGH = 0.3  # correlation of a rate with its command, or of increments with increments, worth proposing [A]
_ONE_SIDED = 0.02  # share of the span below zero that a one-sided command may have
_MAX_GRID = 20_000


@dataclass(frozen=True, slots=True)
class Signal:
    """One numeric column of a record: stamps (N,) [ns] and values (N,) [its own unit]."""

    name: str
    stamp_ns: IntArray
    values: FloatArray


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
    """A configuration to check: model, roles, sampling time [s], lag [samples] and the cycle rule with its reason."""

    model: str
    roles: tuple[Role, ...]
    period_s: float
    lag: int
    rule: CycleRule
    cycle_s: float
    rule_reason: str


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
        None where no pair of signals moves together.
    """
    usable = {k: s for k, s in signals.items() if _judgeable(s)}
    counters = [k for k, s in usable.items() if _is_counter(s.values)]
    movers = [k for k in usable if k not in counters]
    best = _best_pair(usable, movers, position)
    if best is None:
        return None
    score, lag, command, target, kind = best
    grid_ns, y = _grid(usable[target])
    period_s = float(np.median(np.diff(usable[target].stamp_ns))) / 1e9
    second = _opposite(usable, movers, target, command, lag) if kind == "rate" else None
    if second is not None:
        up, down = (command, second) if score > 0 else (second, command)
        roles = [
            _position_role("spool_position", usable[target]),
            _command_role("v_in", usable[up], "the position rises with it"),
            _command_role("v_out", usable[down], "the position falls with it"),
        ]
        model = "press_cartridge"
    else:
        position_role = _position_role("position", usable[target])
        roles = [
            position_role,
            Role(
                "command",
                command,
                position_role.scale,
                position_role.offset,
                _follow_text(score, lag),
            ),
        ]
        model = "positioner"
    if counters:
        roles.append(
            Role("cycle_counter", counters[0], 1.0, 0.0, "whole numbers that only count up")
        )
    held = _hold(usable[command], grid_ns)
    rule, cycle_s, reason = _cycle_rule(bool(counters), model, held, grid_ns, y)
    return Proposal(model, tuple(roles), period_s, max(lag, 1), rule, cycle_s, reason)


def _judgeable(signal: Signal) -> bool:
    values = signal.values
    return (
        len(values) >= MIN_SAMPLES
        and bool(np.isfinite(values).all())
        and float(np.ptp(values)) > 0
    )


def _is_counter(values: FloatArray) -> bool:
    steps = np.diff(values)
    whole = bool(np.all(values == np.rint(values)))
    few = int(np.count_nonzero(steps)) <= len(values) // MIN_SAMPLES
    return whole and few and bool(np.all(steps >= 0))


def _grid(signal: Signal) -> tuple[IntArray, FloatArray]:
    """Thin a long record to consecutive samples that still tell the lag."""
    n = min(len(signal.values), _MAX_GRID)
    return signal.stamp_ns[:n], signal.values[:n]


def _hold(signal: Signal, at_ns: IntArray) -> FloatArray:
    index = np.searchsorted(signal.stamp_ns, at_ns, side="right") - 1
    return signal.values[np.maximum(index, 0)]


def _best_pair(
    signals: Mapping[str, Signal], movers: list[str], position: str
) -> tuple[float, int, str, str, str] | None:
    best: tuple[float, int, str, str, str] | None = None
    for target, command in permutations(movers, 2):
        if position and target != position:
            continue
        grid_ns, y = _grid(signals[target])
        u = _hold(signals[command], grid_ns)
        for kind, a, b in (("rate", u, np.diff(y)), ("follow", np.diff(u), np.diff(y))):
            if kind == "follow" and not _same_unit(u, y):
                continue
            if kind == "rate" and not _one_sided(u):
                continue
            score, lag = _lagged_correlation(a[: len(b)], b, _max_lag(grid_ns))
            lag += kind == "rate"
            if abs(score) >= _ENOUGH and (best is None or abs(score) > abs(best[0])):
                best = (score, lag, command, target, kind)
    return best


def _same_unit(u: FloatArray, y: FloatArray) -> bool:
    """Whether a command could be a position in the same unit: both cover much of the same range."""
    low, high = max(u.min(), y.min()), min(u.max(), y.max())
    return bool(high - low > 0.3 * max(np.ptp(u), np.ptp(y)))


def _one_sided(u: FloatArray) -> bool:
    span = float(np.ptp(u))
    return bool(span > 0 and u.min() >= -_ONE_SIDED * span and np.median(u) < 0.5 * u.max())


def _max_lag(grid_ns: IntArray) -> int:
    period_s = float(np.median(np.diff(grid_ns))) / 1e9
    return min(max(_LEAST_LAGS, round(_MAX_LAG_S / period_s)), len(grid_ns) // 4)


def _lagged_correlation(a: FloatArray, b: FloatArray, max_lag: int) -> tuple[float, int]:
    """Return the strongest correlation of b[n] with a[n - lag] over 0 <= lag < max_lag, and that lag."""
    best, at = 0.0, 0
    for lag in range(max_lag):
        x, y = a[: len(a) - lag], b[lag:]
        sx, sy = float(np.std(x)), float(np.std(y))
        if sx == 0 or sy == 0:
            continue
        r = float(np.mean((x - x.mean()) * (y - y.mean()))) / (sx * sy)
        if abs(r) > abs(best) + 1e-9:
            best, at = r, lag
    return best, at


def _opposite(
    signals: Mapping[str, Signal], movers: list[str], target: str, command: str, lag: int
) -> str | None:
    """Return the other one-sided command: it moves the position the other way."""
    grid_ns, y = _grid(signals[target])
    rate = np.diff(y)[lag - 1 :]
    first = _hold(signals[command], grid_ns)
    ways: dict[str, float] = {}
    for name in movers:
        u = _hold(signals[name], grid_ns)
        if name in {target, command} or not _one_sided(u) or np.std(u) == 0:
            continue
        n = min(len(rate), len(u))
        r = float(np.corrcoef(u[:n], rate[:n])[0, 1])
        r_first = float(np.corrcoef(first[:n], rate[:n])[0, 1])
        if r * r_first < 0:
            ways[name] = abs(r)
    return max(ways, key=ways.__getitem__) if ways else None


def _position_role(signal: str, column: Signal) -> Role:
    low, high = float(column.values.min()), float(column.values.max())
    scale = _scale(low, high)
    return Role(signal, column.name, scale, 0.0, f"values {low:.4g} .. {high:.4g}")


def _scale(low: float, high: float) -> float:
    """Return 1 for normalised values, 0.01 for percent, else one over the largest value."""
    largest = max(abs(low), abs(high))
    if largest <= 1.5:
        return 1.0
    return 0.01 if largest <= 110.0 and largest > 20.0 else 1.0 / largest


def _command_role(signal: str, column: Signal, evidence: str) -> Role:
    values = column.values
    rest = float(np.quantile(values, 0.1))
    scale = _scale(float(values.min()), float(values.max()))
    return Role(signal, column.name, scale, -rest * scale, f"{evidence}; at rest {rest:.4g}")


def _follow_text(score: float, lag: int) -> str:
    return (
        f"the position follows it after {lag} samples (correlation of the increments {score:.2f})"
    )


def _cycle_rule(
    has_counter: bool, model: str, command: FloatArray, grid_ns: IntArray, position: FloatArray
) -> tuple[CycleRule, float, str]:
    if has_counter:
        return CycleRule.COUNTER, 0.0, "a counter is there"
    period = _repetition_s(position, grid_ns)
    if model == "press_cartridge":
        text = f"about every {period:.3g} s" if period else "no repetition found in the record"
        return CycleRule.COMMANDS, period, f"from the commands: {text}"
    rises = _rises(command)
    if period and rises >= 2:
        return (
            CycleRule.REFERENCE,
            period,
            f"the command rises {rises} times, about every {period:.3g} s",
        )
    return CycleRule.WINDOW, 300.0, "no repetition found: fixed windows"


def _rises(command: FloatArray) -> int:
    low, high = float(command.min()), float(command.max())
    level = low + 0.5 * (high - low)
    return int(np.count_nonzero((command[1:] > level) & (command[:-1] <= level)))


def _repetition_s(values: FloatArray, grid_ns: IntArray) -> float:
    """Return the repetition time from the autocorrelation, 0 where there is none [s]."""
    n = len(values)
    thin = max(1, n // 2000)
    y = values[::thin] - values[::thin].mean()
    power = np.fft.irfft(np.abs(np.fft.rfft(y, 2 * len(y))) ** 2)[: len(y)]
    if power[0] <= 0:
        return 0.0
    weight = np.arange(len(y), 0, -1)
    r = power / power[0] * len(y) / weight
    usable = len(y) // 2
    below = np.flatnonzero(r[:usable] < 0.2)
    if len(below) == 0:
        return 0.0
    after = int(below[0])
    peak = after + int(np.argmax(r[after:usable]))
    if r[peak] < 0.5:
        return 0.0
    return float(peak * thin * np.median(np.diff(grid_ns)) / 1e9)
