# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""Whether a valve between two limit switches reaches both, and how long it takes to close.

What is followed is 1 between the switches and 0 at each. Which of them it rests at is known from
the order: the command opens the valve at the first sample of a cycle and closes it within it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from valve_twin.core.types import Cycle
    from valve_twin.core.valves.cycle_timing.parameters import CycleTimingOptions

_BETWEEN = 0.5  # what is followed, above which the valve is between its switches [1]


@dataclass(frozen=True, slots=True)
class Strokes:
    """What the strokes of a cycle did.

    Attributes
    ----------
    opened, closed : float
        1 = the open, the closed end was reached, 0 = it was not, NaN = the cycle does not tell.
    close_time : float
        From leaving the open end to reaching the closed one, NaN where it was not seen [s].
    """

    opened: float = np.nan
    closed: float = np.nan
    close_time: float = np.nan


def find_strokes(cycle: Cycle, options: CycleTimingOptions) -> Strokes:
    """Return what the strokes of a cycle did.

    Parameters
    ----------
    cycle : Cycle
        One cycle of N >= 1 samples; `position` is 1 between the switches, 0 at each.
    options : CycleTimingOptions
        The valve rests at its open end in the steady window.
    """
    frames = cycle.frames
    t = (frames.stamp_ns - frames.stamp_ns[0]) * 1e-9
    rests = (t >= options.steady_start_s) & (t <= options.steady_end_s)
    if not rests.any() or not (frames.valid & np.isfinite(frames.position)).all():
        return Strokes()
    between = frames.position > _BETWEEN
    edges = np.flatnonzero(np.diff(between, prepend=False, append=False))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not runs:
        return Strokes(opened=0.0)  # it stays at one of its ends
    lasts = bool(between[-1])
    if float(between[rests].mean()) > _BETWEEN:
        return Strokes(opened=0.0, closed=0.0 if lasts else np.nan)
    away = [(a, b) for a, b in runs if t[a] > options.steady_start_s]
    opened = float(len(away) < len(runs))
    if not away or lasts:
        return Strokes(opened, closed=0.0)
    first, last = max(away, key=lambda run: run[1] - run[0])  # a switch may bounce
    return Strokes(opened, 1.0, (last - first) * cycle.period_s)
