# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where cycles open and close: compiled rules, and what they remember from block to block."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from valve_twin.core.types import ByteArray, FloatArray, IntArray

STAY, OPEN, CLOSE = 0, 1, 2
START, ACTIVE, LAST = 0, 1, 2
ARMED, WAS_HIGH, RUNNING, SEEN = 0, 1, 2, 3


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
) -> None:
    """Mark where the commands open and close cycles.

    Parameters
    ----------
    stamp_ns : (N,) int64 array
        Stamps [ns].
    inputs : (N, M) array
        Commands [1].
    columns : (2,) int64 array
        Column of the command that opens and of the one that re-arms, -1 = none.
    limits_ns : (3,) int64 array
        Shortest and greatest length of a cycle, longest time without a command [ns].
    threshold, rearm_threshold : float
        Levels above which a command counts [1].
    clock : (3,) int64 array
        At `START`, `ACTIVE` and `LAST`; goes on from block to block [ns].
    flags : (4,) uint8 array
        At `ARMED`, `WAS_HIGH`, `RUNNING` and `SEEN`; goes on from block to block.
    marks : (N,) uint8 array
        Gets `OPEN` or `CLOSE`.
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
        elif flags[RUNNING] and (age >= limits_ns[1] or t - clock[ACTIVE] >= limits_ns[2]):
            marks[i] = CLOSE
            flags[RUNNING], flags[ARMED] = 0, 1
        flags[WAS_HIGH] = 1 if high else 0


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
    limits_ns : (3,) int64 array
        Shortest and greatest length of a cycle, and one that is not used [ns].
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
