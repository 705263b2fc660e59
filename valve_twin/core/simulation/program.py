# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""The production cycle: which position the press asks for, and when."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.quantity import assumed, check_quantities, setting

if TYPE_CHECKING:
    from valve_twin.core.types import BoolArray, FloatArray

KINDS = ("hold", "step", "ramp")


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of a cycle: `position` (N,) [1]; `hold` (N,), True where it stands still."""

    position: FloatArray
    hold: BoolArray


@dataclass(frozen=True, slots=True)
class CycleProgram:
    """A production cycle as a list of moves.

    Attributes
    ----------
    times_s : tuple of float
        Start of each move from the start of the cycle; increasing, the first is 0 [s].
    kinds : tuple of str
        "hold": the target applies at once and stands; "step": go to the target in `step_time_s`,
        then stand; "ramp": go to the target until the next move starts.
    targets : tuple of float
        Target of each move [1].
    duration_s : float
        Length of the cycle [s].
    step_time_s : float
        Rise time of a step [s].
    """

    times_s: tuple[float, ...] = assumed(
        (0.0, 1.0, 7.5, 9.0, 18.0), "s", "Start of each move of the cycle", 0.0, 3600.0
    )
    kinds: tuple[str, ...] = setting(
        ("hold", "step", "ramp", "hold", "step"), "Kind of each move: hold, step or ramp"
    )
    targets: tuple[float, ...] = assumed(
        (0.0, 0.2, 0.28, 0.28, 0.0), "1", "Target position of each move", 0.0, 1.0
    )
    duration_s: float = assumed(25.5, "s", "Length of the cycle", 0.1, 3600.0)
    step_time_s: float = assumed(0.03, "s", "Rise time of a step of the reference", 0.0, 10.0)

    def __post_init__(self) -> None:
        """Refuse a program that is not a cycle."""
        check_quantities(self)
        if not len(self.times_s) == len(self.kinds) == len(self.targets) > 0:
            message = (
                f"CycleProgram: times_s, kinds and targets have {len(self.times_s)}, "
                f"{len(self.kinds)} and {len(self.targets)} entries: must be as many, at least 1"
            )
            raise ValueError(message)
        for kind in self.kinds:
            if kind not in KINDS:
                message = f"CycleProgram.kinds = {kind!r}: must be one of {', '.join(KINDS)}"
                raise ValueError(message)
        rising = all(a < b for a, b in pairwise((*self.times_s, self.duration_s)))
        if self.times_s[0] != 0.0 or not rising:
            message = (
                f"CycleProgram.times_s = {self.times_s!r}: must start at 0, increase, "
                f"and end before duration_s = {self.duration_s!r}"
            )
            raise ValueError(message)

    def reference(self, tick_s: float) -> Reference:
        """Return the reference of one cycle, one value every `tick_s` [s]."""
        ticks = round(self.duration_s / tick_s)
        t_s = np.arange(ticks) * tick_s
        position = np.empty(ticks)
        hold = np.ones(ticks, dtype=np.bool_)
        level = self.targets[0]
        ends = (*self.times_s[1:], self.duration_s)
        moves = zip(self.times_s, ends, self.kinds, self.targets, strict=True)
        for start, end, kind, target in moves:
            part = (t_s >= start - 1e-9) & (t_s < end - 1e-9)
            rise = end - start if kind == "ramp" else min(self.step_time_s, end - start)
            rise = 0.0 if kind == "hold" else rise
            since = t_s[part] - start
            share = np.minimum(since / rise, 1.0) if rise > 0.0 else np.ones(len(since))
            position[part] = level + share * (target - level)
            hold[part] = (share <= 0.0) | (share >= 1.0) | (level == target)
            level = target
        return Reference(position, hold)
