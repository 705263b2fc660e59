# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where cycles open and close: compiled rules, and what they remember from block to block."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.kernels import njit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import ByteArray, FloatArray, Frames, IntArray

STAY, OPEN, CLOSE = 0, 1, 2
START, ACTIVE, LAST = 0, 1, 2
ARMED, WAS_HIGH, RUNNING, SEEN = 0, 1, 2, 3

OVERDUE = 3.0
"""Usual lengths after which a cycle is overdue in which nothing answers the command (assumed)."""

BACK, REST = 0.05, 0.1
"""How near to its begin, of the stroke, and for which share of the samples a whole cycle rests
(assumed)."""

_LEAST_USUAL = 3  # closed cycles that say what is usual


@dataclass(frozen=True, slots=True)
class RuleState:
    """What a rule remembers of the samples before, in the order of the kernels' arrays.

    Attributes
    ----------
    start_ns, active_ns : int
        Begin of the running cycle and last time of an active command [ns].
    last_key : int
        Last counter or number of a window.
    armed, was_high, running, seen : bool
        Whether a cycle may open, the command was high, a cycle runs, `last_key` is known.
    """

    start_ns: int = 0
    active_ns: int = 0
    last_key: int = 0
    armed: bool = True
    was_high: bool = False
    running: bool = False
    seen: bool = False

    @staticmethod
    def of(clock: IntArray, flags: ByteArray) -> RuleState:
        """Return the state that the kernels' arrays hold."""
        return RuleState(*clock.tolist(), *map(bool, flags.tolist()))

    def arrays(self) -> tuple[IntArray, ByteArray]:
        """Return new arrays for the kernels: times and key, flags."""
        values = astuple(self)
        return np.array(values[:3], dtype=np.int64), np.array(values[3:], dtype=np.uint8)


def has_returned(frames: Frames) -> bool:
    """Return whether the position stands again where the cycle began, and all signals rest.

    They do where in the last `REST` of the samples no command changes and no position is farther
    than `BACK` of the stroke from the first: a stroke forth and back is whole, though cycles
    beside it may be longer. The command of the first sample is that which opened the cycle.

    Parameters
    ----------
    frames : Frames
        Samples of a cycle, N >= 1.
    """
    rest = max(1, round(REST * len(frames)))
    commands, position = frames.inputs[-rest:], frames.position
    away = np.abs(position[-rest:] - position[0]).max()
    stroke = position.max() - position.min()
    rests = bool((commands == commands[0]).all())
    return rests and bool(stroke > 0.0 and away <= BACK * stroke)


def column_of(name: str, inputs: tuple[str, ...], key: str) -> int:
    """Return the column of a command, -1 without a name.

    Parameters
    ----------
    name : str
        Of the command.
    inputs : tuple of str
        Names of all commands.
    key : str
        Where it is configured.

    Raises
    ------
    ValueError
        If there is no such command.
    """
    if not name:
        return -1
    if name not in inputs:
        msg = f"cycles.{key}: '{name}' is no command of this model; it has {', '.join(inputs)}"
        raise ValueError(msg)
    return inputs.index(name)


def set_overdue(limits_ns: IntArray, lengths: Sequence[int], period_s: float) -> None:
    """Set the length from which on a cycle is overdue.

    Parameters
    ----------
    limits_ns : (4,) int64 array
        Limits of `mark_commands`, the last is overwritten: with the greatest length of a cycle
        while no usual one is known [ns].
    lengths : sequence of int
        Of the cycles before [samples].
    period_s : float
        Sampling time [s].
    """
    greatest_ns = int(limits_ns[1])
    if len(lengths) < _LEAST_USUAL:
        limits_ns[3] = greatest_ns
    else:
        step_ns = round(period_s * 1e9)
        limits_ns[3] = min(round(OVERDUE * median(lengths) * step_ns), greatest_ns)


@njit(cache=True)
def mark_commands(
    stamp_ns: IntArray,
    inputs: FloatArray,
    columns: IntArray,
    limits_ns: IntArray,
    threshold: float,
    rearm_threshold: float,
    clock: IntArray,
    flags: ByteArray,
    marks: ByteArray,
) -> int:
    """Mark where the commands open and close cycles, up to the first that opens.

    A cycle is overdue where the opening command is still large long after a usual cycle is over,
    and the re-arming one has not come: nothing moves. It closes, and the next one opens only
    after the re-arming command.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    inputs : (N, M) array
        Commands [1].
    columns : (2,) int64 array
        Column of the command that opens and of the one that re-arms, -1 = none.
    limits_ns : (4,) int64 array
        Shortest and greatest length of a cycle, longest time without a command, length from
        which on a cycle is overdue [ns].
    threshold, rearm_threshold : float
        Levels above which a command counts, and above which it is large [1].
    clock : (3,) int64 array
        At `START`, `ACTIVE` and `LAST`; goes on from block to block [ns].
    flags : (4,) uint8 array
        At `ARMED`, `WAS_HIGH`, `RUNNING` and `SEEN`; goes on from block to block.
    marks : (N,) uint8 array
        Gets `OPEN` or `CLOSE`.

    Returns
    -------
    int
        Samples that were judged: what a cycle's length may be changes where one opens.
    """
    start_column, rearm_column = columns[0], columns[1]
    for i in range(len(stamp_ns)):
        t = stamp_ns[i]
        high = inputs[i, start_column] > threshold
        for j in range(inputs.shape[1]):
            if inputs[i, j] > threshold:
                clock[ACTIVE] = t
        if rearm_column >= 0:
            if inputs[i, rearm_column] > rearm_threshold:
                flags[ARMED] = 1
        elif not high:
            flags[ARMED] = 1
        age = t - clock[START]
        if (
            high
            and not flags[WAS_HIGH]
            and flags[ARMED]
            and (not flags[RUNNING] or age >= limits_ns[0])
        ):
            marks[i] = OPEN
            flags[ARMED], flags[RUNNING], clock[START] = 0, 1, t
            flags[WAS_HIGH] = 1
            return i + 1
        if flags[RUNNING] and (age >= limits_ns[1] or t - clock[ACTIVE] >= limits_ns[2]):
            marks[i] = CLOSE
            flags[RUNNING], flags[ARMED] = 0, 1
        elif (
            flags[RUNNING]
            and rearm_column >= 0
            and not flags[ARMED]
            and age >= limits_ns[3]
            and inputs[i, start_column] > rearm_threshold
        ):
            marks[i] = CLOSE
            flags[RUNNING] = 0
        flags[WAS_HIGH] = 1 if high else 0
    return len(stamp_ns)


@njit(cache=True)
def mark_reference(
    stamp_ns: IntArray,
    reference: FloatArray,
    limits_ns: IntArray,
    low: float,
    high: float,
    clock: IntArray,
    flags: ByteArray,
    marks: ByteArray,
) -> None:
    """Mark where the reference opens and closes cycles; `clock`, `flags`, `marks` as above.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    reference : (N,) array
        The reference [1].
    limits_ns : (4,) int64 array
        Shortest and greatest length of a cycle, and two that are not used [ns].
    low, high : float
        Level below which a cycle is armed, and from which one opens [1].
    clock : (3,) int64 array
        As for `mark_commands` [ns].
    flags : (4,) uint8 array
        As for `mark_commands`.
    marks : (N,) uint8 array
        Gets `OPEN` or `CLOSE`.
    """
    for i in range(len(stamp_ns)):
        t, value = stamp_ns[i], reference[i]
        age = t - clock[START]
        if value < low:
            flags[ARMED] = 1
        elif value >= high and flags[ARMED] and (not flags[RUNNING] or age >= limits_ns[0]):
            marks[i] = OPEN
            flags[ARMED], flags[RUNNING], clock[START] = 0, 1, t
            continue
        if flags[RUNNING] and age >= limits_ns[1]:
            marks[i] = CLOSE
            flags[RUNNING] = 0


@njit(cache=True)
def mark_changes(
    keys: IntArray, known: ByteArray, clock: IntArray, flags: ByteArray, marks: ByteArray
) -> None:
    """Mark where a counter or the number of a window changes.

    Parameters
    ----------
    keys : (N,) int64 array
        Counter or number.
    known : (N,) uint8 array
        Where it is known.
    clock : (3,) int64 array
        As for `mark_commands`, the last key at `LAST`.
    flags : (4,) uint8 array
        As for `mark_commands`.
    marks : (N,) uint8 array
        Gets `OPEN`.
    """
    for i in range(len(keys)):
        if known[i] and (not flags[SEEN] or keys[i] != clock[LAST]):
            marks[i] = OPEN
            clock[LAST], flags[SEEN], flags[RUNNING] = keys[i], 1, 1
