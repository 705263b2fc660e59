# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Which cycle rule would cut a record, and with which limits."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.cycle_config import CycleConfig
from valve_twin.core.types import CycleRule

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.survey.pairs import Signal
    from valve_twin.core.types import BoolArray, FloatArray, IntArray

_LEVEL = 0.02  # share of a command's range above its rest that opens a cycle, assumed
_RETURN = 0.3  # share of the greatest return command that no correction in a hold reaches, assumed
_AT_REST = 0.1  # share of the record that a command must rest for a rule on it, assumed
_LEAST_CYCLES = 2
_LEVELS, _ON_LEVELS = 12, 0.95  # a switched command is on so few levels for that share, assumed
_SWITCHED = 0.2  # share of its range above which it is on, assumed
_NEAR_END = 0.1  # share of its range from its end where an answer sets off, assumed
_SHORT = 0.1  # quantile of the intervals that counts as a short one, assumed
_EVEN = 2.0  # long interval over a short one of a program with a rest in mid-range, assumed
_MORE = 1.5  # times as often, assumed
_LEAST_IN_MIDDLE = 10  # cycles; of fewer nobody knows whether it rests there or passes, assumed
_EVENER = 0.5  # of that of the intervals from the lowest level, assumed
_SHORTEST = 0.5  # of the shortest interval found: the least length that is proposed
_INSIDE = 0.1  # share of its range from its ends where a command is in mid-range, assumed
_WINDOW_S = 300.0  # fixed window, assumed
_LEAST_WINDOWS = 3
_LEAST_IN_WINDOW = 100  # samples
_MOVES = 6  # turns of the command in a window, moves of each way thrice, assumed
_IN_SHORT = 200  # samples of a window of a short record at least, assumed
_FOR_VERDICT = 13  # windows: five make the reference, eight more a verdict
_ENOUGH = 40  # windows that a short record is divided into at most: a reference and a verdict
_TURN = 0.1  # share of its range by which a command turns, as a move of a response, assumed
_COUNTED = "a counter is there"


@dataclass(frozen=True, slots=True)
class CyclePlan:
    """A cycle rule to check.

    Attributes
    ----------
    rule : CycleRule
        What cuts.
    reason : str
        The figure it rests on.
    values : dict
        Fields of `CycleConfig` that it needs, [s] or [1].
    count : int
        Cycles in the record; 0 = not known.
    opened_ns : tuple of int
        Where those of two commands begin [ns]; empty = not known.
    """

    rule: CycleRule
    reason: str
    values: dict[str, float | str] = field(default_factory=dict)
    count: int = 0
    opened_ns: tuple[int, ...] = ()


def plan_cycles(commands: Sequence[Signal], period_s: float, *, has_counter: bool) -> CyclePlan:
    """Propose a cycle rule.

    Parameters
    ----------
    commands : sequence of Signal
        Commands of the model in its order, mapped to 0..1.
    period_s : float
        Sampling time of the position [s].
    has_counter : bool
        Whether a cycle counter was found.
    """
    if len(commands) > 1:
        plan = _from_commands(commands[0], commands[1], period_s)
        counted = CyclePlan(CycleRule.COUNTER, _COUNTED, opened_ns=plan.opened_ns)
        return counted if has_counter else plan
    if has_counter:
        return CyclePlan(CycleRule.COUNTER, _COUNTED)
    return _from_reference(commands[0], period_s) or _windows(commands[0], period_s)


def _from_commands(start: Signal, rearm: Signal, period_s: float) -> CyclePlan:
    threshold = min(CycleConfig().threshold, 0.1 * float(start.values.max()))
    returning = min(CycleConfig().rearm_threshold, _RETURN * float(rearm.values.max()))
    edges = _rises(start.values, threshold, threshold)
    opened: list[int] = []
    active = rearm.stamp_ns[rearm.values > returning]
    for stamp in start.stamp_ns[edges].tolist():
        if not opened or np.any((active > opened[-1]) & (active < stamp)):
            opened.append(stamp)
    values: dict[str, float | str] = {
        "start_signal": start.name,
        "rearm_signal": rearm.name,
        "rearm_threshold": returning,
        "threshold": threshold,
        "min_cycle_s": _least(opened, period_s),
    }
    return CyclePlan(CycleRule.COMMANDS, _found(opened), values, len(opened), tuple(opened))


def _from_reference(command: Signal, period_s: float) -> CyclePlan | None:
    """Cut where the command leaves its rest, if it rests now and then.

    That is its lowest level, or one in mid-range that it goes beyond both ways, if it stays there
    for longer and leaves it more evenly or more often: the lower half of that program is no rest.
    A record of a few moves from there, as of a crane, tells more in windows than cut at each.
    """
    low, span = float(command.values.min()), float(np.ptp(command.values))
    lowest, share = _leaving(command, low), float(np.mean(command.values < low + _LEVEL * span))
    middle = low + _middle(command.values) * span
    here = float(np.mean(np.abs(command.values - middle) < 0.5 * _LEVEL * span))
    opened = _leaving(command, middle)
    spread, often = _spread(opened), len(opened) >= _LEAST_IN_MIDDLE
    evener = spread < _EVENER * _spread(lowest) or len(opened) > _MORE * len(lowest)
    if often and evener and spread < _EVEN and here >= max(share, _AT_REST):
        rest = middle
    elif share >= _AT_REST:
        rest, opened = low, lowest
    else:
        return None
    return _above(rest, _LEVEL * span, opened, period_s, "leaves its rest")


def _above(
    rest: float, rise: float, opened: Sequence[int], period_s: float, what: str
) -> CyclePlan | None:
    """Return the rule that cuts where a command has risen from its rest; None = too seldom."""
    if len(opened) < _LEAST_CYCLES:
        return None
    values: dict[str, float | str] = {
        "reference_level": rest + rise,
        "reference_hysteresis": 0.5 * rise,
        "min_cycle_s": _least(opened, period_s),
    }
    reason = f"the command {what}: {_found(opened)}"
    return CyclePlan(CycleRule.REFERENCE, reason, values, len(opened))


def _leaving(command: Signal, rest: float, share: float = _LEVEL) -> list[int]:
    """Return the stamps at which a command rises from a level by a share of its range [ns]."""
    rise = share * float(np.ptp(command.values))
    rises = _rises(command.values, rest + rise, rest + 0.5 * rise)
    return [int(stamp) for stamp in command.stamp_ns[rises]]


def _middle(values: FloatArray) -> float:
    """Return where a command stays longest but near its ends, as a share of its range [1]."""
    share = (values - values.min()) / np.ptp(values)
    number = np.rint(share / (0.5 * _LEVEL)).astype(np.int64)
    bins = np.bincount(number[np.abs(share - 0.5) < 0.5 - _INSIDE], minlength=1)
    return 0.5 * _LEVEL * int(np.argmax(bins))


def _spread(opened: Sequence[int]) -> float:
    """Return a long interval between some stamps over a short one, pauses left out [1]."""
    intervals = np.diff(opened)
    if not len(intervals):
        return np.inf
    short, long = np.quantile(intervals, (_SHORT, 1.0 - _SHORT))
    return float(long / short)


def switched_cycles(command: Signal, period_s: float) -> CyclePlan | None:
    """Cut where a command that is switched between few levels rises; None = it is not.

    Parameters
    ----------
    command : Signal
        Mapped to 0..1.
    period_s : float
        Sampling time of the position [s].
    """
    low, span = float(command.values.min()), float(np.ptp(command.values))
    bins = np.bincount(np.rint((command.values - low) / (0.01 * span)).astype(np.int64))
    if float(np.sort(bins)[-_LEVELS:].sum()) < _ON_LEVELS * len(command.values):
        return None
    opened = _leaving(command, low, _SWITCHED)
    return _above(low, _SWITCHED * span, opened, period_s, "is switched on")


def strokes_from_rest(command: Signal, answer: Signal) -> CyclePlan | None:
    """Cut where a command leaves its rest in mid-range and the answer its lower end; None = not.

    So does that of a cylinder: each move begins with a rise, and a cycle with one from the end.

    Parameters
    ----------
    command, answer : Signal
        Mapped to 0..1, the answer integrates the command.
    """
    rest, high = float(np.median(command.values)), float(command.values.max())
    level, low_again = rest + _SWITCHED * (high - rest), rest + 0.5 * _SWITCHED * (high - rest)
    opened = command.stamp_ns[_rises(command.values, level, low_again)]
    if float(command.values.min()) > rest - _SWITCHED * (high - rest):
        return None  # it never drives back
    at = np.maximum(np.searchsorted(answer.stamp_ns, opened, side="right") - 1, 0)
    low, span = float(answer.values.min()), float(np.ptp(answer.values))
    starts = np.flatnonzero(answer.values[at] < low + _NEAR_END * span)
    if len(starts) < _LEAST_CYCLES:
        return None
    inner = np.arange(starts[0], len(opened))
    since = opened[starts[np.searchsorted(starts, inner, side="right") - 1]]
    longest_s = float((opened[inner] - since).max()) / 1e9
    begun = opened[starts].tolist()
    shortest_s = float(np.diff(begun).min()) / 1e9
    if longest_s > shortest_s:
        return None
    values: dict[str, float | str] = {
        "reference_level": level,
        "reference_hysteresis": level - low_again,
        "min_cycle_s": max(0.5 * (longest_s + shortest_s), _SHORTEST * shortest_s),
    }
    reason = f"the command drives the answer off its lower end: {_found(begun)}"
    return CyclePlan(CycleRule.REFERENCE, reason, values, len(begun))


def _windows(command: Signal, period_s: float) -> CyclePlan:
    duration_s = float(command.stamp_ns[-1] - command.stamp_ns[0]) / 1e9
    window_s = min(_WINDOW_S, max(duration_s / _LEAST_WINDOWS, _LEAST_IN_WINDOW * period_s))
    short = short_windows(command, duration_s, period_s)
    window_s = min(window_s, duration_s / short) if short else window_s
    reason = "the command does not come back to a rest: fixed windows"
    return CyclePlan(CycleRule.WINDOW, reason, {"window_s": window_s})


def short_windows(command: Signal, whole_s: float, period_s: float) -> int:
    """Return into how many windows a record may be divided that still show enough each.

    A reference takes five cycles and a verdict some more: a record that is short but moves much
    has them. 0 = it has too few for a verdict, so that longer windows show more. Each window has
    moves of both ways and samples enough for every feature.

    Parameters
    ----------
    command : Signal
        In any unit.
    whole_s : float
        Length of the record [s].
    period_s : float
        Sampling time of the position [s].
    """
    samples = int(whole_s / period_s) // _IN_SHORT
    count = min(_turns(command.values) // _MOVES, samples, _ENOUGH)
    return count if count >= _FOR_VERDICT else 0


def _turns(values: FloatArray) -> int:
    """Return how often a command turns by more than a share of its range."""
    least = _TURN * float(np.ptp(values))
    if not least > 0.0:
        return 0
    turns, way, low, high = 0, 0, float(values[0]), float(values[0])
    for x in values[np.flatnonzero(np.diff(values, prepend=np.nan))].tolist():
        low, high = min(low, x), max(high, x)
        if way <= 0 and x > low + least:
            turns, way, high = turns + 1, 1, x
        elif way >= 0 and x < high - least:
            turns, way, low = turns + 1, -1, x
    return turns


def _rises(values: FloatArray, level: float, low: float) -> IntArray:
    """Return where values come up to the level, having been below `low` since the last time."""
    marks = np.where(values > level, 1, np.where(values <= low, -1, 0))
    known = np.flatnonzero(marks)
    state = marks[known]
    up: BoolArray = np.concatenate(([False], (state[1:] > 0) & (state[:-1] < 0)))
    return known[up]


def _least(opened: Sequence[int], period_s: float) -> float:
    intervals = np.diff(opened) / 1e9
    shortest = float(intervals.min()) if len(intervals) else CycleConfig().min_cycle_s
    return max(_SHORTEST * shortest, 2.0 * period_s)


def _found(opened: Sequence[int]) -> str:
    intervals = np.diff(opened) / 1e9
    if len(intervals) == 0:
        return f"{len(opened)} in this record"
    return f"{len(opened)} in this record, every {intervals.min():.4g} .. {intervals.max():.4g} s"
