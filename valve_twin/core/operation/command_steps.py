# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Where the commands of a cycle step, and between which changes they are held."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from valve_twin.core.operation.way import HELD

if TYPE_CHECKING:
    from valve_twin.core.types import FloatArray

_NEAR = 3  # samples between two changes of one command that are no hold


class Hold(NamedTuple):
    """Samples `begin` .. `end` - 1 over which all commands are held."""

    begin: int
    end: int

    @property
    def samples(self) -> int:
        """How many they are [1]."""
        return self.end - self.begin


class Transition(NamedTuple):
    """One change of one command.

    Attributes
    ----------
    column, at : int
        Which command, and the first sample with a new value.
    size : float
        Change from hold to hold [unit of the command].
    before, after : Hold
        Where all commands are held before and after it.
    reason : str
        Why it is no step; empty = it is one.
    """

    column: int
    at: int
    size: float
    before: Hold
    after: Hold
    reason: str = ""


def find_transitions(inputs: FloatArray) -> list[Transition]:
    """Return the changes of all commands, in the order of time.

    Changes by less than 2 % of a command's range in the cycle count as held.

    Parameters
    ----------
    inputs : (N, M) array
        Commands, finite [unit by command].
    """
    runs = [(*run, m) for m in range(inputs.shape[1]) for run in _runs(inputs[:, m])]
    runs.sort()
    out = []
    for k, (first, last, column) in enumerate(runs):
        others = [r for j, r in enumerate(runs) if j != k]
        begin = max((r[1] for r in others if r[0] < first), default=0)
        end = min((r[0] for r in others if r[1] > last), default=len(inputs))
        before, after = Hold(min(begin, first), first), Hold(last, max(end, last))
        u = inputs[:, column]
        size = float(u[min(last, len(u) - 1)] - u[first - 1])
        reason = ""
        if last > first:
            reason = f"the command is not a step: it changes over {last - first + 1} samples"
        elif any(r[0] <= last and r[1] >= first for r in others):
            reason = "the command is not a step: two commands change at once"
        elif size == 0.0 or _drifts(u, before, size) or _drifts(u, after, size):
            reason = "the command is not a step: it is not held before and after"
        out.append(Transition(column, first, size, before, after, reason))
    return out


def _runs(u: FloatArray) -> list[tuple[int, int]]:
    """Return first and last sample of each change of one command."""
    changed = np.flatnonzero(np.abs(np.diff(u)) > HELD * float(np.ptp(u))) + 1
    if not len(changed):
        return []
    cuts = np.flatnonzero(np.diff(changed) > _NEAR)
    first, last = changed[np.r_[0, cuts + 1]], changed[np.r_[cuts, len(changed) - 1]]
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _drifts(u: FloatArray, hold: Hold, size: float) -> bool:
    """Return whether a command moves while it counts as held."""
    held = u[hold.begin : hold.end]
    return bool(len(held)) and float(np.ptp(held)) > 2.0 * HELD * abs(size)
