# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
"""When a command acts: its delay to a part of a sample, and the pole of what follows.

In a closed loop the command falls with the distance that is left, so a response that is a part of
a sample late looks like a larger gain. An integer lag left 1 to 5 % in K_out, whatever the noise.
One cycle shows the part of a sample only where its noise is low; the valve's own cycles before
show it together, and a cycle that does not contradict them takes it from them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from valve_twin.core.valves.press_cartridge.estimation.free_run import (
    acting_command,
    find_phases,
)
from valve_twin.core.valves.press_cartridge.estimation.output_error_kernel import (
    N_COLUMNS,
    N_LINEAR,
    POLE_MAX,
    Stretch,
    search_pole_near,
)
from valve_twin.core.valves.press_cartridge.estimation.solvers.line_search import (
    BEST_VALUE,
    line_next,
    line_start,
    line_update,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from valve_twin.core.types import BoolArray
    from valve_twin.core.valves.press_cartridge.estimation.free_run import OutputErrorOptions, Run

_PARTS = (-0.8, -0.4, 0.0, 0.4)
"""Where the search of the part of a sample begins, about the lag [samples]."""

_REACH = 0.4  # on either side of the best of them [samples]
_POLES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of which the best begins the search [1]
_WHOLE = 0.05  # a delay nearer to the lag is compared with it [samples]
_WIDTH = 0.003  # of the result [samples]
_POLE_WIDTH, _LAST_WIDTH = 1e-3, 1e-6  # of the pole, on the way and at the end [1]

_USUAL = 0.15
"""Standard deviation of the part of a sample where nothing is known of the valve, assumed."""

_LEAST_POOLED = 5
"""Fewest cycles that are pooled."""

_MOST_POOLED = 20
"""So many of the last cycles are pooled: what changes is followed."""

_DECIDES = 12.0
"""A cycle decides for itself where its own timing is better by this, twice the log likelihood.

Three values are searched in a cycle by itself: chance gives 12 in one of 130, and what a free run
leaves is not white, so the share is larger."""


@dataclass(frozen=True, slots=True)
class Timing:
    """When a command acts.

    Attributes
    ----------
    delay : float
        Command to position delay [samples].
    pole : float
        Pole of the speed [1].
    pooled : bool
        Whether the cycles before say so.
    """

    delay: float
    pole: float
    pooled: bool = False

    @property
    def total(self) -> float:
        """Mean time from command to speed [samples]."""
        return self.delay + self.pole / (1.0 - self.pole)


def find_timing(run: Run, lag: int, columns: BoolArray, options: OutputErrorOptions) -> Timing:
    """Search delay and pole about a lag.

    Parameters
    ----------
    run : Run
        The cycle.
    lag : int
        Command to position lag about which the delay is searched [samples].
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted; a fixed pole and a fixed delay stay.
    """
    phases = find_phases(run, lag, options)
    held = phases.stretch(run.position, run.use)
    pole = options.pole
    if pole < 0.0:
        pole = min(_POLES, key=lambda z: _value(held, columns, options, z, width=0.0)[0])

    def value(part: float, width: float = _POLE_WIDTH) -> tuple[float, float]:
        start = _shifted(pole, best_part - part) if options.pole < 0.0 else pole
        acting = [acting_command(v, lag + part) for v in (run.v_in, run.v_out)]
        data = held._replace(v_in=acting[0], v_out=acting[1])
        found, at = _value(data, columns, options, start, width=width)
        return found + (part / _USUAL) ** 2, at

    best, best_part = np.inf, 0.0
    for part in _PARTS if options.delay < 0.0 else (0.0,):
        if lag + part >= 0.0:
            found, at = value(part)
            if found < best:
                best, best_part, pole = found, part, at
    if options.delay >= 0.0:
        return Timing(float(lag), value(0.0, _LAST_WIDTH)[1])
    low = max(best_part - _REACH, -float(lag))
    state = line_start(low, best_part + _REACH, best_part, best)
    part = line_next(state, _WIDTH)
    while not np.isnan(part):
        found, at = value(part)
        if found <= state[BEST_VALUE]:
            pole, best_part = at, part
        line_update(state, part, found)
        part = line_next(state, _WIDTH)
    best, pole = value(best_part, _LAST_WIDTH)
    if 0.0 < abs(best_part) < _WHOLE:  # exact data: one of the two is, and only at its own pole
        whole, at = value(0.0, _LAST_WIDTH)
        best_part, pole = (0.0, at) if whole <= best else (best_part, pole)
    return Timing(lag + best_part, pole)


def pool_timing(alone: Sequence[tuple[float, float]]) -> Timing | None:
    """Pool what single cycles found; None where they are too few.

    Parameters
    ----------
    alone : sequence of (float, float)
        Delay [samples] and pole [1] of each cycle by itself, oldest first; NaN = not known.
    """
    known = [Timing(d, p) for d, p in alone if np.isfinite(d + p)][-_MOST_POOLED:]
    if len(known) < _LEAST_POOLED:
        return None
    pole = float(np.median([t.pole for t in known]))
    total = float(np.median([t.total for t in known]))
    return Timing(max(total - pole / (1.0 - pole), 0.0), pole, pooled=True)


def choose_timing(
    run: Run, own: Timing, pooled: Timing | None, columns: BoolArray, options: OutputErrorOptions
) -> Timing:
    """Return the pooled timing, or a cycle's own where the cycle contradicts it.

    Parameters
    ----------
    run : Run
        The cycle.
    own, pooled : Timing
        Of the cycle alone, and of those before.
    columns : (5,) bool array
        Parameters that are fitted.
    options : OutputErrorOptions
        How the free run is fitted.
    """
    if pooled is None or options.delay >= 0.0:
        return own
    alone, together = (
        _value(
            find_phases(run, t.delay, options).stretch(run.position, run.use),
            columns,
            options,
            t.pole,
            width=0.0,
        )[0]
        for t in (own, pooled)
    )
    return own if together - alone > _DECIDES else pooled


def _shifted(pole: float, samples: float) -> float:
    """Return the pole whose mean time is so much longer [samples]."""
    mean = max(pole / (1.0 - pole) + samples, 0.0)
    return min(mean / (1.0 + mean), POLE_MAX)


def _value(
    data: Stretch,
    columns: BoolArray,
    options: OutputErrorOptions,
    pole: float,
    *,
    width: float = _POLE_WIDTH,
) -> tuple[float, float]:
    """Return minus twice the log likelihood, and the pole, searched near `pole`."""
    p, gram = np.zeros(N_LINEAR), np.zeros((N_COLUMNS, N_COLUMNS))
    width = width if options.pole < 0.0 else 0.0
    return search_pole_near(data, options.v_max, options.wander, columns, pole, width, p, gram)
